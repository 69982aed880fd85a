use crate::{Error, Result};
use mde_prior::{DepthPrior, DisparityRule};
use mde_warp::{PinholeCamera, PosedView};
use ndarray::{Array2, ArrayView2, ArrayView3};

/// Input of a [`Method`]. Never the truth.
#[derive(Clone, Copy)]
pub struct Task<'a> {
    /// The photograph, `[height, width, 3]`, sRGB in 0 to 1.
    pub image: ArrayView3<'a, f32>,
    /// Its camera.
    pub camera: &'a PinholeCamera,
    /// Whether the focal length of this camera, and of those of `views`, is a guess.
    pub focal_assumed: bool,
    /// The monocular depth, `[height, width]`; 0 where missing.
    pub prior: ArrayView2<'a, f32>,
    /// The model that predicted the depth, where it accepts other images; `None` where the depth is from a file.
    pub model: Option<&'a dyn DepthPrior>,
    /// The rule by which the model's prediction becomes depth.
    pub rule: &'a DisparityRule,
    /// Further photographs of the scene, empty for most data sets. The world of their poses is the frame of `camera`.
    pub views: &'a [TaskView<'a>],
    /// Seed of every random draw.
    pub seed: u64,
}

/// A further photograph of the scene of a [`Task`].
#[derive(Clone, Copy)]
pub struct TaskView<'a> {
    /// The photograph with its camera and pose; no depth hypothesis.
    pub view: &'a PosedView,
    /// Whether the pose is known. Where it is not, the pose of `view` must not be read.
    pub posed: bool,
    /// Its monocular depth `[height, width]`, where it is known; 0 where missing.
    pub prior: Option<&'a Array2<f32>>,
}

impl<'a> Task<'a> {
    /// A photograph with its camera and monocular depth; no model, no further photograph, seed 0.
    pub fn new(
        image: ArrayView3<'a, f32>,
        camera: &'a PinholeCamera,
        prior: ArrayView2<'a, f32>,
        rule: &'a DisparityRule,
    ) -> Self {
        Self { image, camera, focal_assumed: false, prior, model: None, rule, views: &[], seed: 0 }
    }

    /// The model's depth of another image, `[height, width]` of that image; 0 where missing.
    ///
    /// # Errors
    /// [`Error::NoModel`] without a model, or the model's own error.
    pub fn predict(&self, image: ArrayView3<'_, f32>) -> Result<Array2<f32>> {
        let model = self.model.ok_or(Error::NoModel)?;
        Ok(model.predict(image)?.to_depth(self.rule)?)
    }
}

/// A refined depth with its standard deviation.
#[derive(Debug, Clone, PartialEq)]
pub struct Refined {
    /// Depth `[height, width]` in the prior's unit; 0 where missing.
    pub depth: Array2<f32>,
    /// Its standard deviation `[height, width]` in the same unit, where the method has one.
    pub sigma: Option<Array2<f32>>,
    /// A report of the run, such as the estimated parameters; null where there is none.
    pub report: serde_json::Value,
}

impl From<Array2<f32>> for Refined {
    fn from(depth: Array2<f32>) -> Self {
        Self { depth, sigma: None, report: serde_json::Value::Null }
    }
}

/// A method that refines the monocular depth of a photograph: a filter, or a whole pipeline. A function of a task is one.
///
/// ```
/// use mde_eval::ndarray::{Array2, Array3};
/// use mde_eval::{Refined, Method, Result, Task};
/// use mde_eval::mde_prior::DisparityRule;
/// use mde_eval::mde_warp::PinholeCamera;
///
/// /// Moves everything a little further away.
/// fn further(task: &Task<'_>) -> Result<Refined> {
///     Ok(task.prior.mapv(|depth| 1.01 * depth).into())
/// }
///
/// let (image, prior) = (Array3::zeros((6, 8, 3)), Array2::from_elem((6, 8), 2.0));
/// let (camera, rule) = (PinholeCamera::from_fov(60.0, 8, 6)?, DisparityRule::default());
/// let task = Task::new(image.view(), &camera, prior.view(), &rule);
/// assert_eq!(further.refine(&task)?.depth[[0, 0]], 2.02);
/// # Ok::<(), mde_eval::Error>(())
/// ```
pub trait Method {
    /// Refines the prior of `task`; the result has the photograph's size.
    ///
    /// # Errors
    /// The method's own.
    fn refine(&self, task: &Task<'_>) -> Result<Refined>;
}

impl<F: Fn(&Task<'_>) -> Result<Refined>> Method for F {
    fn refine(&self, task: &Task<'_>) -> Result<Refined> {
        self(task)
    }
}
