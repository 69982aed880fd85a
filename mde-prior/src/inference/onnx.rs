use std::path::{Path, PathBuf};

use ndarray::{Array2, Array3, ArrayView3, Axis, stack};

use super::graph::{Graph, Output, fixed_size};
#[cfg(feature = "onnxruntime")]
use super::onnxruntime::OnnxRuntimeGraph;
use super::runtime::{call, model_error};
use super::tract::TractGraph;
use crate::resample::resize;
use crate::spec::{Channels, Layout, ModelSpec};
use crate::{DepthPrior, Error, PriorDepth, Result};

/// The largest input of a kept aspect: more than any monocular model is made for.
const MAX_INPUT_PIXELS: usize = 1 << 24;
/// The largest ratio between the aspects of output and input.
const MAX_STRETCH: f64 = 1.5;
/// What runs a network.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
#[non_exhaustive]
pub enum Runtime {
    /// tract, which is part of the program. Several predictions run at once, each on one thread.
    #[default]
    Tract,
    /// ONNX Runtime, the library in that file. One prediction runs at a time, on all threads.
    #[cfg(feature = "onnxruntime")]
    OnnxRuntime(PathBuf),
}

impl std::fmt::Display for Runtime {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Tract => f.write_str("tract"),
            #[cfg(feature = "onnxruntime")]
            Self::OnnxRuntime(library) => write!(f, "ONNX Runtime ({})", library.display()),
        }
    }
}

/// A network in an ONNX file, run on the CPU.
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
    graph: Box<dyn Graph>,
    /// Index of the output.
    output: usize,
    /// `(height, width)` where the model has them fixed.
    fixed: (Option<usize>, Option<usize>),
    /// Files of weights outside the ONNX file.
    external: Vec<PathBuf>,
    runtime: Runtime,
    concurrency: usize,
}

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
    /// Loads a model for [`Runtime::Tract`] and checks that its input is one image of three channels.
    ///
    /// # Errors
    /// [`Error::Read`] when there is no such file, [`Error::Model`] when it is no model for images, [`Error::Config`]
    /// when the specification is out of range.
    pub fn open(path: impl AsRef<Path>, spec: &ModelSpec) -> Result<Self> {
        Self::open_with(path, spec, &Runtime::Tract)
    }

    /// As [`open`](Self::open), for any runtime.
    ///
    /// # Errors
    /// As [`open`](Self::open), and [`Error::Model`] where the runtime's library can't be loaded.
    pub fn open_with(path: impl AsRef<Path>, spec: &ModelSpec, runtime: &Runtime) -> Result<Self> {
        let path = path.as_ref();
        spec.validate()?;
        let length = std::fs::metadata(path).map_err(|e| Error::read(path, e))?.len();
        if length == 0 {
            return Err(model_error(path, "the file is empty; copy the model again"));
        }
        call(path, || {
            let fault = |reason: String| model_error(path, reason);
            let (graph, external): (Box<dyn Graph>, _) = match runtime {
                Runtime::Tract => {
                    let (graph, external) = TractGraph::open(path).map_err(fault)?;
                    (Box::new(graph), external)
                }
                #[cfg(feature = "onnxruntime")]
                Runtime::OnnxRuntime(library) => {
                    let external = super::runtime::external_files(path).map_err(fault)?;
                    (Box::new(OnnxRuntimeGraph::open(path, library).map_err(fault)?), external)
                }
            };
            let output = match &spec.output_name {
                None => 0,
                Some(name) => {
                    let names = || graph.outputs().iter().map(|port| port.name.as_str());
                    names().position(|other| other == name).ok_or_else(|| {
                        let names = names().collect::<Vec<_>>().join(", ");
                        fault(format!("no output {name:?}, but {names}; check output-name"))
                    })?
                }
            };
            let fixed = fixed_size(&*graph, spec.layout).map_err(fault)?;
            let (path, spec, concurrency) = (path.to_owned(), spec.clone(), graph.concurrency());
            let runtime = runtime.clone();
            Ok(Self { path, spec, graph, output, fixed, external, runtime, concurrency })
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

    /// At most `predictions` (1 or more) at once; without, as many as there are threads. Each needs the memory of its activations.
    #[must_use]
    pub fn with_concurrency(mut self, predictions: usize) -> Self {
        self.concurrency = self.graph.concurrency().min(predictions.max(1));
        self
    }

    /// What runs the network.
    #[must_use]
    pub fn runtime(&self) -> &Runtime {
        &self.runtime
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
        call(&self.path, || {
            let values = self.values(image, size)?;
            let shape = input_shape(self.spec.layout, size);
            let output = self.graph.run(shape, values, self.output).map_err(|reason| self.error(reason))?;
            self.map(output, size)
        })
    }

    fn error(&self, reason: String) -> Error {
        model_error(&self.path, reason)
    }

    /// The image at the input's size, normalised and in the input's order of axes and channels.
    fn values(&self, image: ArrayView3<'_, f32>, size: (usize, usize)) -> Result<Vec<f32>> {
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
        Ok(stacked.iter().copied().collect())
    }

    fn map(&self, output: Output, input: (usize, usize)) -> Result<Array2<f32>> {
        let sides: Vec<usize> = output.shape.iter().copied().filter(|&n| n != 1).collect();
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
                    output.shape
                )));
            }
        };
        if let Some(value) = output.values.iter().find(|v| !v.is_finite()) {
            return Err(self.error(format!("the output holds {value}; check mean, std and channels")));
        }
        Array2::from_shape_vec((height, width), output.values).map_err(|e| self.error(e.to_string()))
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

    fn resolution(&self, height: usize, width: usize) -> Option<(usize, usize)> {
        Some(self.input_size(height, width))
    }

    fn concurrency(&self) -> usize {
        self.concurrency
    }
}

fn input_shape(layout: Layout, (height, width): (usize, usize)) -> [usize; 4] {
    match layout {
        Layout::Nchw => [1, 3, height, width],
        Layout::Nhwc => [1, height, width, 3],
    }
}
