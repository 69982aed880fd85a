use std::path::{Path, PathBuf};

use ndarray::{Array2, ArrayView3, Axis, s, stack};

use super::graph::{Graph, Output, fixed_size, image_input};
#[cfg(feature = "onnxruntime")]
use super::onnxruntime::OnnxRuntimeGraph;
use super::outline::Outline;
use super::points;
use super::runtime::{call, external_files};
use super::tract::TractGraph;
use crate::prior::{Certainty, CertaintyMeaning, IMAGENET};
use crate::resample::{Filter, nearest, resize};
use crate::spec::{Aspect, Channels, Layout, ModelSpec};
use crate::{DepthKind, DepthPrior, Error, FileKind, InferenceMemory, PriorDepth, Result, open};

/// The largest input of a kept aspect: more than any monocular model is made for.
const MAX_INPUT_PIXELS: usize = 1 << 24;
/// The largest ratio between the aspects of output and input.
const MAX_STRETCH: f64 = 1.5;

/// Copies of the weights that a runtime keeps: as they are in the file, and as its kernels take them.
pub(super) const COPIES: u64 = 2;

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

/// What a network is recognised by.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum RecognisedBy {
    /// A TOML file beside it.
    Toml,
    /// The files of a model hub.
    Hub,
    /// Its outputs or its layers.
    Graph,
    /// The name of its file.
    Name,
}

/// A network in an ONNX file, run on the CPU.
///
/// ```no_run
/// use mde_prior::{DepthPrior, OnnxPrior, photo};
///
/// let model = "dpt_hybrid_384.onnx";
/// let (spec, _) = OnnxPrior::recognise(model)?;
/// let prior = OnnxPrior::open(model, &spec)?;
/// let depth = prior.predict(photo::read_image("room.jpg")?.pixels.view())?;
/// # Ok::<(), mde_prior::Error>(())
/// ```
pub struct OnnxPrior {
    path: PathBuf,
    spec: ModelSpec,
    graph: Box<dyn Graph>,
    /// Indices of the outputs: depth, then scale, mask, camera, field of view and certainty where there are any.
    outputs: Vec<usize>,
    /// `(height, width)` where the model has them fixed.
    fixed: (Option<usize>, Option<usize>),
    /// Files of weights outside the ONNX file.
    external: Vec<PathBuf>,
    runtime: Runtime,
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
    /// [`Error::Read`] when there is no such file, [`Error::Malformed`] when it is no model for images, [`Error::Config`]
    /// when the specification is out of range.
    pub fn open(path: impl AsRef<Path>, spec: &ModelSpec) -> Result<Self> {
        Self::open_with(path, spec, &Runtime::Tract)
    }

    /// As [`open`](Self::open), for any runtime.
    ///
    /// # Errors
    /// As [`open`](Self::open), and [`Error::Malformed`] where the runtime's library can't be loaded.
    pub fn open_with(path: impl AsRef<Path>, spec: &ModelSpec, runtime: &Runtime) -> Result<Self> {
        let path = path.as_ref();
        spec.validate()?;
        let found = open::check(path, FileKind::Network).map_err(|e| Error::read(path, e))?;
        if found.len() == 0 {
            return Err(Error::malformed(path, "the file is empty; copy the model again"));
        }
        call(path, || {
            let fault = |reason: String| Error::malformed(path, reason);
            let external = external_files(path)?;
            let graph: Box<dyn Graph> = match runtime {
                Runtime::Tract => Box::new(TractGraph::open(path, spec.tokens).map_err(fault)?),
                #[cfg(feature = "onnxruntime")]
                Runtime::OnnxRuntime(library) => {
                    Box::new(OnnxRuntimeGraph::open(path, library, spec.tokens).map_err(fault)?)
                }
            };
            let (inputs, outputs) = graph.ports();
            let names: Vec<String> = outputs.iter().map(|port| port.name.clone()).collect();
            if names.is_empty() {
                return Err(fault("the model has no output; export it again".to_owned()));
            }
            let spec = &spec.clone().for_outputs(&names);
            let index = |key: &str, name: &String| {
                names.iter().position(|other| other == name).ok_or_else(|| {
                    fault(format!("no output {name:?}, but {}; check {key}", names.join(", ")))
                })
            };
            let depth = spec.output_name.as_ref().map_or(Ok(0), |name| index("output-name", name))?;
            let mut outputs = vec![depth];
            for (key, name) in spec.further_outputs() {
                outputs.extend(name.map(|name| index(key, name)).transpose()?);
            }
            let image = image_input(inputs, spec.tokens).map_err(fault)?;
            let fixed = fixed_size(&inputs[image], spec.layout).map_err(fault)?;
            let (path, spec, runtime) = (path.to_owned(), spec.clone(), runtime.clone());
            Ok(Self { path, spec, graph, outputs, fixed, external, runtime })
        })
    }

    /// The specification of a model, and what it is recognised by: a TOML file beside it, else the files of a model hub, else the profile
    /// of a graph that cannot be mistaken by the names of its outputs (MoGe-2, UniDepth V2, Depth Pro, Metric3D v2) or by its layers
    /// (FastDepth), else the profile that matches its name.
    ///
    /// # Errors
    /// Those of [`ModelSpec::beside`], [`ModelSpec::of_hub`] and [`ModelSpec::guess`].
    pub fn recognise(path: impl AsRef<Path>) -> Result<(ModelSpec, RecognisedBy)> {
        let path = path.as_ref();
        if let Some(spec) = ModelSpec::beside(path)? {
            return Ok((spec, RecognisedBy::Toml));
        }
        if let Some(spec) = ModelSpec::of_hub(path)? {
            return Ok((spec, RecognisedBy::Hub));
        }
        // A file that is no graph gets its error when it is opened.
        let outline = call(path, || Outline::read(path)).unwrap_or_default();
        let (spec, by) = match outline.profile() {
            Some(name) => (ModelSpec::profile(name)?, RecognisedBy::Graph),
            None if outline.outputs.is_empty() && ModelSpec::guess(path).is_err() => {
                return Err(Error::malformed(path, "no ONNX graph, or only a part of one; get it again"));
            }
            None => (ModelSpec::guess(path)?, RecognisedBy::Name),
        };
        if spec.aspect == Aspect::Pad && outline.outputs.iter().any(|name| name == "predicted_depth") {
            return Ok((ModelSpec { output_name: Some("predicted_depth".to_owned()), ..spec }, by));
        }
        Ok((spec.for_outputs(&outline.outputs), by))
    }

    /// The files with the network's weights: the ONNX file, then those that it names.
    pub fn files(&self) -> impl Iterator<Item = &Path> {
        std::iter::once(&self.path).chain(&self.external).map(PathBuf::as_path)
    }

    /// The meaning of its predictions: with a [canonical focal length](ModelSpec::canonical_focal) they have no unit;
    /// [`ModelSpec::in_metres`] gives them one for photographs of a known focal length.
    #[must_use]
    pub fn kind(&self) -> DepthKind {
        if self.spec.canonical_focal.is_some() { DepthKind::RelativeDepth } else { self.spec.output }
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
    /// [`ModelSpec::input_size`]. With [`Aspect::Pad`] that of the image within the input.
    #[must_use]
    pub fn input_size(&self, height: usize, width: usize) -> (usize, usize) {
        if self.spec.aspect == Aspect::Pad {
            let (h, w) = self.bounds();
            return ModelSpec { height: h, width: w, ..self.spec.clone() }.input_size(height, width);
        }
        let (h, w) = self.spec.input_size(height, width);
        (self.fixed.0.unwrap_or(h), self.fixed.1.unwrap_or(w))
    }

    /// The model's own `(height, width)` where it is fixed, else that of the specification.
    fn bounds(&self) -> (usize, usize) {
        (self.fixed.0.unwrap_or(self.spec.height), self.fixed.1.unwrap_or(self.spec.width))
    }

    /// The place of an image of that size in the input.
    fn frame(&self, height: usize, width: usize) -> Frame {
        let image = self.input_size(height, width);
        let input = if self.spec.aspect == Aspect::Pad { self.bounds() } else { image };
        Frame { input, image }
    }

    /// The focal length, in pixels of the input, of a horizontal field of view in degrees.
    fn focal(&self, fov: &Output, frame: &Frame) -> Result<f32> {
        match *fov.values.as_slice() {
            [degrees] if degrees > 0.0 && degrees < 180.0 => {
                Ok(0.5 * frame.input.1 as f32 / (0.5 * degrees.to_radians()).tan())
            }
            _ => Err(self.error("fov-output is no field of view of 0 to 180 degrees; check its name")),
        }
    }

    /// The camera of an image: that of the input, scaled.
    fn intrinsics(
        &self,
        output: &Output,
        frame: &Frame,
        (height, width): (usize, usize),
    ) -> Result<[f64; 4]> {
        let (y, x) = (height as f64 / frame.image.0 as f64, width as f64 / frame.image.1 as f64);
        let (top, left) = frame.start(frame.input);
        let values: Vec<f64> = output.values.iter().map(|v| f64::from(*v)).collect();
        let intrinsics = match *values.as_slice() {
            [focal] => centred(focal * x, (height, width)),
            // Centres of the input's pixels are at halves.
            [fx, _, cx, _, fy, cy, ..] if values.len() == 9 => {
                [fx * x, fy * y, (cx - left as f64) * x - 0.5, (cy - top as f64) * y - 0.5]
            }
            _ => {
                let shape = &output.shape;
                return Err(self.error(format!("camera-output is {shape:?}, not a number or a 3x3 matrix")));
            }
        };
        let usable = intrinsics.iter().all(|v| v.is_finite()) && intrinsics[0].min(intrinsics[1]) > 0.0;
        usable
            .then_some(intrinsics)
            .ok_or_else(|| self.error("camera-output is no camera of positive focal length; check its name"))
    }

    fn empty(&self, reason: &str) -> Error {
        Error::Empty(format!("{}: {reason}", self.path.display()))
    }

    fn error(&self, reason: impl Into<String>) -> Error {
        Error::malformed(&self.path, reason)
    }

    /// The image at the input's size, normalised and in the input's order of axes and channels.
    fn values(&self, image: ArrayView3<'_, f32>, frame: &Frame) -> Vec<f32> {
        let plane = |c: usize| {
            let (mean, std) = (self.spec.mean[c], self.spec.std[c]);
            let colours = resize(image.index_axis(Axis(2), c), frame.image, self.spec.input_filter);
            frame.padded(colours, IMAGENET.0[c]).mapv_into(|v| (v - mean) / std)
        };
        let mut planes = [0, 1, 2].map(plane);
        if self.spec.channels == Channels::Bgr {
            planes.reverse();
        }
        let channels = match self.spec.layout {
            Layout::Nchw => Axis(0),
            Layout::Nhwc => Axis(2),
        };
        // Planes of one size.
        let input = stack(channels, &planes.each_ref().map(|plane| plane.view())).unwrap_or_default();
        input.into_iter().collect()
    }

    /// An output as a map of the image, without padding.
    fn map(&self, output: Output, frame: &Frame) -> Result<Array2<f32>> {
        let input = frame.input;
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
        let map = Array2::from_shape_vec((height, width), output.values);
        Ok(frame.cut(map.map_err(|e| self.error(e.to_string()))?))
    }
}

/// Where an image lies in a network's input: in the middle.
struct Frame {
    /// `(height, width)` of the input.
    input: (usize, usize),
    /// `(height, width)` of the image in it.
    image: (usize, usize),
}

impl Frame {
    /// `(height, width)` of the image in a map of that size, which covers the input.
    fn within(&self, (height, width): (usize, usize)) -> (usize, usize) {
        let side = |map: usize, input: usize, image: usize| {
            let scaled = map as f64 * image as f64 / input.max(1) as f64;
            (scaled.round() as usize).clamp(1, map.max(1))
        };
        (side(height, self.input.0, self.image.0), side(width, self.input.1, self.image.1))
    }

    /// Row and column at which it begins there.
    fn start(&self, size: (usize, usize)) -> (usize, usize) {
        let (height, width) = self.within(size);
        (size.0.saturating_sub(height) / 2, size.1.saturating_sub(width) / 2)
    }

    /// The input around the image.
    fn padded(&self, image: Array2<f32>, colour: f32) -> Array2<f32> {
        if self.input == self.image {
            return image;
        }
        let mut input = Array2::from_elem(self.input, colour);
        let ((top, left), (height, width)) = (self.start(self.input), self.image);
        input.slice_mut(s![top..top + height, left..left + width]).assign(&image);
        input
    }

    /// The image in a map that covers the input.
    fn cut(&self, map: Array2<f32>) -> Array2<f32> {
        if self.input == self.image {
            return map;
        }
        let ((top, left), (height, width)) = (self.start(map.dim()), self.within(map.dim()));
        map.slice(s![top..top + height, left..left + width]).to_owned()
    }
}

impl DepthPrior for OnnxPrior {
    fn predict(&self, image: ArrayView3<'_, f32>) -> Result<PriorDepth> {
        let (height, width, channels) = image.dim();
        if height == 0 || width == 0 || channels != 3 || !image.fold(true, |all, v| all & v.is_finite()) {
            return Err(Error::Input(format!(
                "an image of shape {:?} cannot be predicted; give finite [height, width, 3]",
                image.dim()
            )));
        }
        let frame = self.frame(height, width);
        let size = frame.input;
        if size.0.saturating_mul(size.1) > MAX_INPUT_PIXELS {
            return Err(Error::Input(format!(
                "a {width}x{height} image needs a {}x{} input with the aspect kept; crop it, or set aspect = \"squash\"",
                size.1, size.0
            )));
        }
        call(&self.path, || {
            let (values, shape) = (self.values(image, &frame), input_shape(self.spec.layout, size));
            let outputs =
                self.graph.run(shape, values, &self.outputs).map_err(|reason| self.error(reason))?;
            let mut outputs = outputs.into_iter();
            let depth =
                outputs.next().ok_or_else(|| self.error("an output is missing; export the model again"))?;
            let [scale, mask, camera, fov, confidence, error] =
                self.spec.further_outputs().map(|(_, name)| name.and_then(|_| outputs.next()));
            let confidence = confidence.map(|values| (CertaintyMeaning::Confidence, values));
            let certainty = confidence.or(error.map(|values| (CertaintyMeaning::Error, values)));
            let focal = fov.map(|fov| self.focal(&fov, &frame)).transpose()?;
            let inverse = focal.map(|focal| frame.input.1 as f32 / focal);
            let camera = camera.or(focal.map(|focal| Output { shape: vec![1], values: vec![focal] }));
            let mask =
                mask.map(|mask| self.map(mask, &frame)).transpose()?.map(|mask| mask.mapv(|m| m > 0.5));
            let certainty = certainty.map(|(meaning, values)| -> Result<_> {
                let map = self.map(values, &frame)?;
                Ok(Certainty { meaning, map: resize(map.view(), (height, width), Filter::Bilinear) })
            });
            let certainty = certainty.transpose()?;
            let mut intrinsics =
                camera.map(|camera| self.intrinsics(&camera, &frame, (height, width))).transpose()?;
            let mut map = match self.spec.output_channel {
                None => self.map(depth, &frame)?,
                Some(channel) => {
                    let points = points::Points::new(depth).map_err(|reason| self.error(reason))?;
                    let mut z = points.channel(channel).map_err(|reason| self.error(reason))?;
                    if self.spec.recover_shift {
                        let (shift, focal) = points.camera(mask.as_ref()).ok_or_else(|| {
                            self.empty("too few valid points to find their shift; check the outputs' names")
                        })?;
                        z.mapv_inplace(|z| z + shift);
                        let focal = focal * width as f64 / frame.within(z.dim()).1 as f64;
                        intrinsics = intrinsics.or(Some(centred(focal, (height, width))));
                    }
                    let shape = vec![z.nrows(), z.ncols()];
                    self.map(Output { shape, values: z.iter().copied().collect() }, &frame)?
                }
            };
            if let Some(scale) = scale {
                match *scale.values.as_slice() {
                    [factor] if factor > 0.0 && factor.is_finite() => map.mapv_inplace(|v| factor * v),
                    _ => return Err(self.error("scale-output is no positive number; check its name")),
                }
            }
            let depth = |value: f32| match inverse {
                None => value,
                // Bounds of Depth Pro's authors.
                Some(factor) => 1.0 / (factor * value).clamp(1e-4, 1e4),
            };
            let floor = self.spec.output_floor;
            // Before resizing, so that 0 does not spread to its neighbours; and after it, since bicubic overshoots.
            if let Some(floor) = floor.filter(|_| inverse.is_none()) {
                map.mapv_inplace(|v| v.max(floor));
            }
            // Depth Pro's authors resize the inverse depth too.
            let mut map = resize(map.view(), (height, width), self.spec.output_filter).mapv_into(depth);
            if let Some(floor) = floor {
                map.mapv_inplace(|v| v.max(floor));
            }
            let prior = match mask {
                None => PriorDepth::from_values(map, self.kind()),
                Some(mask) => PriorDepth::with_mask(map, nearest(mask.view(), (height, width)), self.kind()),
            };
            let prior = prior.map_err(|e| match e {
                Error::Empty(reason) => self.empty(&reason),
                other => self.error(other.to_string()),
            })?;
            Ok(PriorDepth { intrinsics, certainty, ..prior })
        })
    }

    fn accepts_new_images(&self) -> bool {
        true
    }

    fn resolution(&self, height: usize, width: usize) -> Option<(usize, usize)> {
        Some(self.input_size(height, width))
    }

    fn concurrency(&self) -> usize {
        self.graph.concurrency()
    }

    fn memory(&self, height: usize, width: usize) -> Option<InferenceMemory> {
        let shape = input_shape(self.spec.layout, self.frame(height, width).input);
        // What a runtime cannot plan fails when it is predicted.
        let memory = || self.graph.memory(shape, &self.outputs).map_err(|reason| self.error(reason));
        let InferenceMemory { model, prediction } = call(&self.path, memory).ok()?;
        let lengths = self.files().filter_map(|path| std::fs::metadata(path).ok());
        let weights: u64 = lengths.map(|file| file.len()).sum();
        Some(InferenceMemory { model: model.saturating_add(COPIES.saturating_mul(weights)), prediction })
    }
}

/// A camera of square pixels with its principal point in the middle of an image of `(height, width)`.
fn centred(focal: f64, (height, width): (usize, usize)) -> [f64; 4] {
    [focal, focal, 0.5 * (width as f64 - 1.0), 0.5 * (height as f64 - 1.0)]
}

fn input_shape(layout: Layout, (height, width): (usize, usize)) -> [usize; 4] {
    match layout {
        Layout::Nchw => [1, 3, height, width],
        Layout::Nhwc => [1, height, width, 3],
    }
}
