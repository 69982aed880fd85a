//! Baselines: filters, a solver, and further predictions of the model.
//!
//! Each is a [`Method`], so that every table has it beside the whole pipeline. [`named`] returns the baselines of [`METHODS`].
//! Missing depth (0, or not finite) stays missing and is left out of averages.

mod guided;
mod noise;
mod predictions;
pub mod sigma;
#[cfg(feature = "solver")]
mod solver;
mod sweep;
mod unsharp;

pub use guided::guided_filter;
pub use noise::white_noise;
pub use predictions::{ZoomMerge, flip_average};
#[cfg(feature = "solver")]
pub use solver::{fast_bilateral, solve_bilateral};
pub use sweep::{gauged_prior, plane_sweep};
pub use unsharp::Unsharp;

use crate::{Error, Method, Result, Task};
use ndarray::{Array2, ArrayView2, ArrayView3};

/// Names of the baselines. Others: `zoom30`, the grids of [`ZoomMerge`] that 30 predictions allow; `unsharp1.5`, with any number.
pub const METHODS: &[&str] = &[
    "prior",
    "flip",
    "zoom",
    "unsharp0.5",
    "unsharp1",
    "unsharp2",
    "noise",
    "guided",
    #[cfg(feature = "solver")]
    "fbs",
    "gauged",
    "sweep",
];

/// A baseline by its name.
///
/// # Errors
/// [`Error::Unknown`] with the names that exist.
pub fn named(name: &str) -> Result<Box<dyn Method + Send + Sync>> {
    let unknown = || Error::Unknown { what: "method", name: name.to_owned(), known: METHODS.join(", ") };
    Ok(match name {
        "prior" => Box::new(|task: &Task<'_>| Ok(task.prior.to_owned().into())),
        "flip" => Box::new(flip_average),
        "zoom" => Box::new(ZoomMerge::with_predictions(14)),
        "noise" => Box::new(white_noise),
        "guided" => Box::new(guided_filter),
        "gauged" => Box::new(gauged_prior),
        "sweep" => Box::new(plane_sweep),
        #[cfg(feature = "solver")]
        "fbs" => Box::new(fast_bilateral),
        _ => {
            if let Some(predictions) = name.strip_prefix("zoom").and_then(|number| number.parse().ok()) {
                return Ok(Box::new(ZoomMerge::with_predictions(predictions)));
            }
            let amount = name.strip_prefix("unsharp").and_then(|amount| amount.parse::<f64>().ok());
            let amount = amount.filter(|a| a.is_finite()).ok_or_else(unknown)?;
            Box::new(Unsharp { amount })
        }
    })
}

/// Whether a depth is known.
fn known(depth: f32) -> bool {
    depth > 0.0 && depth.is_finite()
}

/// 1 where the depth is known, 0 elsewhere.
fn weights(depth: ArrayView2<'_, f32>) -> Array2<f64> {
    depth.mapv(|d| f64::from(u8::from(known(d))))
}

/// Checks that the image has the size of the depth.
fn check(task: &Task<'_>) -> Result<()> {
    let (height, width, _) = task.image.dim();
    crate::raster::same_shape("the prior", task.prior.dim(), (height, width))
}

/// The three channels, each `[height, width]`, in standard layout.
fn channels(image: ArrayView3<'_, f32>) -> [Array2<f32>; 3] {
    std::array::from_fn(|channel| {
        let plane = image.index_axis(ndarray::Axis(2), channel);
        plane.mapv(|v| if v.is_finite() { v } else { 0.0 }).as_standard_layout().into_owned()
    })
}
