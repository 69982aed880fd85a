//! The files of a run: the folder, the previews, the record, the exports and the recording.

pub(crate) mod canvas;
pub(crate) mod export;
pub(crate) mod folder;
pub(crate) mod preview;
pub(crate) mod provenance;
pub(crate) mod recording;
pub(crate) mod run_record;
pub(crate) mod several;
pub(crate) mod transforms;

pub(crate) use mde_cli::pictures16;
