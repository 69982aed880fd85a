//! One refinement: the job, its progress, its checkpoints and how it is summarised.

pub(crate) mod batch;
pub(crate) mod checkpoint;
pub(crate) mod every;
pub(crate) mod gain;
pub(crate) mod interrupt;
pub(crate) mod job;
pub(crate) mod progress;
pub(crate) mod resume;
