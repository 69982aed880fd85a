//! The native module of the Python package `mdenerf`, which documents and types what it holds.

mod error;
mod files;
mod metrics;
mod prior;
mod refine;
mod settings;
mod stages;
mod worker;

use pyo3::prelude::*;

#[pymodule]
mod _mdenerf {
    #[pymodule_export]
    use crate::error::Error;
    #[pymodule_export]
    use crate::files::{decode_photo, encode_png, picture, read_photo, save_npy};
    #[pymodule_export]
    use crate::metrics::{align, costs_by_sigma, edge_curve, reliability, score_maps, sparsification_curve};
    #[pymodule_export]
    use crate::prior::Prior;
    #[pymodule_export]
    use crate::refine::{OneScale, is_capture, list_files, refine, replace_folder, save_all, save_result};
    #[pymodule_export]
    use crate::settings::Settings;
    #[pymodule_export]
    use crate::stages::{affine_wls, forward_warp, fuse, termination_moments};
}
