use crate::{Error, Result};
use mde_prior::{DepthPrior, DisparityRule};
use mde_warp::PinholeCamera;
use ndarray::{Array2, ArrayView2, ArrayView3};

/// What a [`Refiner`] may look at. Never the truth.
#[derive(Clone, Copy)]
pub struct Task<'a> {
    /// The photograph, `[height, width, 3]`, sRGB in 0 to 1.
    pub image: ArrayView3<'a, f32>,
    /// Its camera.
    pub camera: &'a PinholeCamera,
    /// The monocular depth, `[height, width]`; 0 where missing.
    pub prior: ArrayView2<'a, f32>,
    /// What the depth came from, where it can be asked again about another picture: a model, not a file.
    pub model: Option<&'a dyn DepthPrior>,
    /// How the model's answer becomes depth.
    pub rule: &'a DisparityRule,
    /// Where every random draw comes from.
    pub seed: u64,
}

impl Task<'_> {
    /// The model's depth of another picture, `[height, width]` of that picture; 0 where missing.
    ///
    /// # Errors
    /// [`Error::NoModel`] where there is none, or what the model refuses.
    pub fn predict(&self, image: ArrayView3<'_, f32>) -> Result<Array2<f32>> {
        let model = self.model.ok_or(Error::NoModel)?;
        Ok(model.predict(image)?.to_depth(self.rule)?)
    }
}

/// A better depth, and how sure it is.
#[derive(Debug, Clone, PartialEq)]
pub struct Refined {
    /// Depth `[height, width]` in the prior's unit; 0 where missing.
    pub depth: Array2<f32>,
    /// Its standard deviation `[height, width]` in the same unit, where the method has one.
    pub sigma: Option<Array2<f32>>,
    /// What the method says of its run, such as what it estimated; null where it says nothing.
    pub account: serde_json::Value,
}

impl From<Array2<f32>> for Refined {
    fn from(depth: Array2<f32>) -> Self {
        Self { depth, sigma: None, account: serde_json::Value::Null }
    }
}

/// One way from a picture and its monocular depth to a better depth: a filter, or a whole pipeline.
///
/// ```
/// use mde_eval::ndarray::{Array2, Array3};
/// use mde_eval::{Refined, Refiner, Result, Task};
/// use mde_eval::mde_prior::DisparityRule;
/// use mde_eval::mde_warp::PinholeCamera;
///
/// /// Says that everything is a little further away.
/// struct Further;
///
/// impl Refiner for Further {
///     fn refine(&self, task: &Task<'_>) -> Result<Refined> {
///         Ok(task.prior.mapv(|depth| 1.01 * depth).into())
///     }
/// }
///
/// let (image, prior) = (Array3::zeros((6, 8, 3)), Array2::from_elem((6, 8), 2.0));
/// let (camera, rule) = (PinholeCamera::from_fov(60.0, 8, 6)?, DisparityRule::default());
/// let task = Task { image: image.view(), camera: &camera, prior: prior.view(), model: None, rule: &rule, seed: 0 };
/// assert_eq!(Further.refine(&task)?.depth[[0, 0]], 2.02);
/// # Ok::<(), mde_eval::Error>(())
/// ```
pub trait Refiner {
    /// Refines the prior of `task`; the result has the picture's size.
    ///
    /// # Errors
    /// Whatever keeps the method from answering.
    fn refine(&self, task: &Task<'_>) -> Result<Refined>;
}
