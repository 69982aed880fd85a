//! The files of a run: the folder, the record, the files of several photographs and the recording.

pub(crate) mod contents;
pub(crate) mod folder;
pub(crate) mod provenance;
pub(crate) mod recording;
pub(crate) mod transforms;
