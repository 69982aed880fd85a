use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError};

use ndarray::{Array2, Array3, ArrayView3, Axis, stack};
use tract_onnx::prelude::*;
use tract_onnx::tract_hir::infer::Factoid as _;
use tract_onnx::tract_hir::internal::DimLike as _;

use super::runtime::{self, model_error, one_line};
use crate::resample::resize;
use crate::spec::{Channels, Layout, ModelSpec};
use crate::{DepthPrior, Error, PriorDepth, Result};

/// The largest input of a kept aspect: more than any monocular model is made for.
const MAX_INPUT_PIXELS: usize = 1 << 24;
/// The largest ratio between the aspects of output and input.
const MAX_STRETCH: f64 = 1.5;

/// A network in an ONNX file, run on the CPU.
///
/// The graph is optimised for a concrete input size, since graphs that compute sizes from symbolic shapes do not run. The plan is
/// kept for the next image of that size.
///
/// ```no_run
/// use mde_prior::{DepthPrior, ModelSpec, OnnxPrior, photo};
///
/// let model = "dpt_hybrid_384.onnx";
/// let prior = OnnxPrior::open(model, &ModelSpec::of(model)?)?;
/// let depth = prior.predict(photo::read_image("room.jpg")?.pixels.view())?;
/// # Ok::<(), mde_prior::Error>(())
/// ```
pub struct OnnxPrior {
    path: PathBuf,
    spec: ModelSpec,
    model: InferenceModel,
    /// `(height, width)` where the model has them fixed.
    fixed: (Option<usize>, Option<usize>),
    /// Files of weights outside the ONNX file.
    external: Vec<PathBuf>,
    plan: Mutex<Option<((usize, usize), Plan)>>,
}

type Plan = Arc<TypedRunnableModel>;

impl std::fmt::Debug for OnnxPrior {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("OnnxPrior")
            .field("path", &self.path)
            .field("spec", &self.spec)
            .field("fixed", &self.fixed)
            .finish_non_exhaustive()
    }
}

impl OnnxPrior {
    /// Loads a model and checks that its input is one image of three channels.
    ///
    /// # Errors
    /// [`Error::Read`] when there is no such file, [`Error::Model`] when it is no model for images, [`Error::Config`]
    /// when the specification is out of range.
    pub fn open(path: impl AsRef<Path>, spec: &ModelSpec) -> Result<Self> {
        let path = path.as_ref();
        spec.validate()?;
        let length = std::fs::metadata(path).map_err(|e| Error::read(path, e))?.len();
        if length == 0 {
            return Err(model_error(path, "the file is empty; copy the model again"));
        }
        runtime::call(path, || {
            let (mut model, external) = runtime::load(path).map_err(|e| {
                model_error(path, format!("the ONNX model cannot be run ({}); export it again", one_line(&e)))
            })?;
            if let Some(name) = &spec.output_name {
                model.select_outputs_by_name([name]).map_err(|e| {
                    model_error(path, format!("no output {name:?} ({}); check output-name", one_line(&e)))
                })?;
            }
            let fixed = fixed_size(&model, spec.layout).map_err(|reason| model_error(path, reason))?;
            let (path, spec) = (path.to_owned(), spec.clone());
            Ok(Self { path, spec, model, fixed, external, plan: Mutex::new(None) })
        })
    }

    /// Loads a model with the specification in the TOML file beside it, or with the profile that matches its name.
    ///
    /// # Errors
    /// Those of [`ModelSpec::of`] and [`open`](Self::open).
    pub fn open_guessed(path: impl AsRef<Path>) -> Result<Self> {
        let spec = ModelSpec::of(&path)?;
        Self::open(path, &spec)
    }

    /// The files with the network's weights: the ONNX file, then those that it names.
    pub fn files(&self) -> impl Iterator<Item = &Path> {
        std::iter::once(&self.path).chain(&self.external).map(PathBuf::as_path)
    }

    /// The specification in use.
    #[must_use]
    pub fn spec(&self) -> &ModelSpec {
        &self.spec
    }

    /// `(height, width)` of the input for an image of that size: the model's own where it is fixed, otherwise
    /// [`ModelSpec::input_size`].
    #[must_use]
    pub fn input_size(&self, height: usize, width: usize) -> (usize, usize) {
        let (h, w) = self.spec.input_size(height, width);
        (self.fixed.0.unwrap_or(h), self.fixed.1.unwrap_or(w))
    }

    /// The network's output at its own size, `[height, width]`, before floor and resizing.
    ///
    /// # Errors
    /// [`Error::Input`] for an image that is not `[height, width, 3]` or not finite; [`Error::Model`] when the model
    /// fails or its output is no map of finite values.
    pub fn predict_native(&self, image: ArrayView3<'_, f32>) -> Result<Array2<f32>> {
        let (height, width, channels) = image.dim();
        if height == 0 || width == 0 || channels != 3 || image.iter().any(|v| !v.is_finite()) {
            return Err(Error::Input(format!(
                "an image of shape {:?} cannot be predicted; give finite [height, width, 3]",
                image.dim()
            )));
        }
        let size = self.input_size(height, width);
        if size.0.saturating_mul(size.1) > MAX_INPUT_PIXELS {
            return Err(Error::Input(format!(
                "a {width}x{height} image needs a {}x{} input with the aspect kept; crop it, or set aspect = \"squash\"",
                size.1, size.0
            )));
        }
        runtime::call(&self.path, || self.run(image, size))
    }

    fn run(&self, image: ArrayView3<'_, f32>, size: (usize, usize)) -> Result<Array2<f32>> {
        let input = self.tensor(image, size)?;
        let outputs = self.plan(size)?.run(tvec!(input.into())).map_err(|e| {
            self.error(format!(
                "the model fails at {}x{} ({}); check its input size",
                size.1,
                size.0,
                one_line(&e)
            ))
        })?;
        let output = outputs
            .first()
            .ok_or_else(|| self.error("the model has no output; export it again".to_owned()))?;
        self.map(output, size)
    }

    fn error(&self, reason: String) -> Error {
        model_error(&self.path, reason)
    }

    /// The image at the input's size, normalised and in the input's order of axes and channels.
    fn tensor(&self, image: ArrayView3<'_, f32>, size: (usize, usize)) -> Result<Tensor> {
        let order = match self.spec.channels {
            Channels::Rgb => [0, 1, 2],
            Channels::Bgr => [2, 1, 0],
        };
        let planes = order.map(|c| {
            let (mean, std) = (self.spec.mean[c], self.spec.std[c]);
            resize(image.index_axis(Axis(2), c), size, self.spec.input_filter).mapv_into(|v| (v - mean) / std)
        });
        let axis = match self.spec.layout {
            Layout::Nchw => Axis(0),
            Layout::Nhwc => Axis(2),
        };
        let views = planes.each_ref().map(|p| p.view());
        let stacked: Array3<f32> = stack(axis, &views).map_err(|e| self.error(e.to_string()))?;
        let values: Vec<f32> = stacked.iter().copied().collect();
        Tensor::from_shape(&input_shape(self.spec.layout, size), &values)
            .map_err(|e| self.error(one_line(&e)))
    }

    fn plan(&self, size: (usize, usize)) -> Result<Plan> {
        // A plan is stored whole, so it is valid even if another thread panicked.
        let mut kept = self.plan.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some((for_size, plan)) = &*kept
            && *for_size == size
        {
            return Ok(Arc::clone(plan));
        }
        let fact = InferenceFact::from(f32::fact(input_shape(self.spec.layout, size)));
        let refused = |e: TractError| {
            self.error(format!(
                "the model takes no {}x{} input ({}); check its input size",
                size.1,
                size.0,
                one_line(&e)
            ))
        };
        let model = self.model.clone().with_input_fact(0, fact).and_then(|model| model.into_optimized());
        let model = model.map_err(refused)?;
        runtime::check_tensors(&model).map_err(|reason| self.error(reason))?;
        let plan = model.into_runnable().map_err(refused)?;
        *kept = Some((size, Arc::clone(&plan)));
        Ok(plan)
    }

    fn map(&self, output: &Tensor, input: (usize, usize)) -> Result<Array2<f32>> {
        let sides: Vec<usize> = output.shape().iter().copied().filter(|&n| n != 1).collect();
        // A depth map has the input's aspect; features and class scores do not.
        let covers = |height: usize, width: usize| {
            let stretch = (height * input.1) as f64 / (width * input.0) as f64;
            (1.0 / MAX_STRETCH..=MAX_STRETCH).contains(&stretch)
        };
        let (height, width) = match *sides.as_slice() {
            [height, width] if covers(height, width) => (height, width),
            _ => {
                return Err(self.error(format!(
                    "the output's shape is {:?}, not a depth map; check the model, or name another output with output-name",
                    output.shape()
                )));
            }
        };
        let output = output.cast_to::<f32>().map_err(|e| self.error(one_line(&e)))?;
        let values = output.to_plain_array_view::<f32>().map_err(|e| self.error(one_line(&e)))?;
        if let Some(value) = values.iter().find(|v| !v.is_finite()) {
            return Err(self.error(format!("the output holds {value}; check mean, std and channels")));
        }
        Array2::from_shape_vec((height, width), values.iter().copied().collect())
            .map_err(|e| self.error(e.to_string()))
    }
}

impl DepthPrior for OnnxPrior {
    fn predict(&self, image: ArrayView3<'_, f32>) -> Result<PriorDepth> {
        let mut native = self.predict_native(image.view())?;
        let floor = self.spec.output_floor;
        // Before resizing, so that 0 does not spread to its neighbours; and after it, since bicubic overshoots.
        if let Some(floor) = floor {
            native.mapv_inplace(|v| v.max(floor));
        }
        let (height, width, _) = image.dim();
        let mut map = resize(native.view(), (height, width), self.spec.output_filter);
        if let Some(floor) = floor {
            map.mapv_inplace(|v| v.max(floor));
        }
        PriorDepth::from_values(map, self.spec.output).map_err(|e| self.error(e.to_string()))
    }

    fn accepts_new_images(&self) -> bool {
        true
    }
}

fn input_shape(layout: Layout, (height, width): (usize, usize)) -> [usize; 4] {
    match layout {
        Layout::Nchw => [1, 3, height, width],
        Layout::Nhwc => [1, height, width, 3],
    }
}

/// Height and width where the model's input has them fixed; an error when the input is no image of three channels.
fn fixed_size(model: &InferenceModel, layout: Layout) -> Result<(Option<usize>, Option<usize>), String> {
    let inputs = model.input_outlets().map_err(|e| one_line(&e))?;
    if inputs.len() != 1 || model.output_outlets().map_err(|e| one_line(&e))?.is_empty() {
        return Err(format!("the model has {} inputs; give a model with one, an image", inputs.len()));
    }
    let fact = model.input_fact(0).map_err(|e| one_line(&e))?;
    if let Some(kind) = fact.datum_type.concretize().filter(|kind| *kind != f32::datum_type()) {
        return Err(format!("the input is {kind:?}; export the model with float32 input"));
    }
    let Some(rank) = fact.shape.rank().concretize() else { return Ok((None, None)) };
    if rank != 4 {
        return Err(format!("the input has {rank} axes; export it with 4, [1, 3, height, width]"));
    }
    let side = |axis| fact.shape.dim(axis).and_then(|d| d.concretize()).and_then(|d| d.to_usize().ok());
    let (channel, height, width) = match layout {
        Layout::Nchw => (1, 2, 3),
        Layout::Nhwc => (3, 1, 2),
    };
    match (side(0), side(channel)) {
        (Some(batch), _) if batch != 1 => {
            Err(format!("the input takes {batch} images at once; export it for 1"))
        }
        (_, Some(channels)) if channels != 3 => {
            Err(format!("axis {channel} of the input has {channels} channels, not 3; check layout"))
        }
        _ => Ok((side(height), side(width))),
    }
}
