//! What a command begins with: photograph, prior, camera, size and truth.

pub(crate) mod camera;
pub(crate) mod capture;
pub(crate) mod opened;
pub(crate) mod photographs;
pub(crate) mod prior;
pub(crate) mod relative;
pub(crate) mod size;
pub(crate) mod truth;
