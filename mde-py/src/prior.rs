//! Priors of the package: a network in a file, a callable, a depth map.

use crate::error::raise;
use crate::worker::{Link, pool};
use mde_cli::calibration::hash_files;
use mde_cli::inputs::{PriorForm, PriorOrigin};
use mde_cli::mde_prior::format::{PngContent, ReadOptions, png_content};
use mde_cli::mde_prior::{
    DepthKind, DepthPrior, Error, FilePrior, Metres, ModelSpec, OnnxPrior, PriorDepth, Result, Runtime,
    find_onnxruntime, spec,
};
use mde_cli::pictures16::METRES;
use ndarray::ArrayView3;
use numpy::PyReadonlyArray2;
use pyo3::prelude::*;
use std::path::PathBuf;
use std::str::FromStr;
use std::time::{Duration, Instant};

/// Two aspects that differ by no more are the same up to rounded sides.
const SAME_ASPECT: f64 = 0.02;

enum Source {
    Network(OnnxPrior),
    /// The size of its input, `(height, width)`, where it has one.
    Callable(Option<(usize, usize)>),
    Map(PriorDepth),
}

/// A prior.
#[pyclass(frozen, module = "mdenerf._mdenerf")]
pub(crate) struct Prior {
    source: Source,
    pub(crate) origin: PriorOrigin,
}

#[pymethods]
impl Prior {
    /// A network in an ONNX file, with the name of its profile, the height and width of its input, and the kind of its values.
    #[staticmethod]
    #[pyo3(signature = (path, format, runtime, library, threads))]
    fn network(
        py: Python<'_>,
        path: PathBuf,
        format: (Option<String>, Option<(usize, usize)>, Option<String>),
        runtime: &str,
        library: Option<PathBuf>,
        threads: Option<usize>,
    ) -> PyResult<Self> {
        let (profile, input_size, kind) = format;
        let kind = kind.as_deref().map(DepthKind::from_str).transpose().map_err(raise)?;
        let mut spec = match profile.as_deref() {
            Some(name) => ModelSpec::profile(name).map_err(raise)?,
            // A missing file gets its own error below.
            None if path.exists() => recognised(&path, input_size, kind)?,
            None => ModelSpec::new(1, 1, DepthKind::Metric),
        };
        if let Some((height, width)) = input_size {
            (spec.width, spec.height) = (width, height);
        }
        if let Some(kind) = kind {
            spec = spec.with_output(kind);
        }
        let runtime = self::runtime(runtime, library)?;
        let pool = pool(threads)?;
        let network =
            py.detach(|| pool.install(|| OnnxPrior::open_with(&path, &spec, &runtime))).map_err(raise)?;
        let origin = PriorOrigin {
            form: PriorForm::Network,
            kind: network.kind(),
            source: path.display().to_string(),
            model: Some(spec),
            runtime: Some(network.runtime().to_string()),
            model_hash: Some(hash_files(network.files()).map_err(raise)?),
        };
        Ok(Self { source: Source::Network(network), origin })
    }

    /// A callable of that name.
    #[staticmethod]
    #[pyo3(signature = (name, kind, input_size))]
    fn callable(name: String, kind: &str, input_size: Option<(usize, usize)>) -> PyResult<Self> {
        let kind = DepthKind::from_str(kind).map_err(raise)?;
        let origin = PriorOrigin::new(PriorForm::Callable, kind, name);
        Ok(Self { source: Source::Callable(input_size), origin })
    }

    /// A depth map `[height, width]`.
    #[staticmethod]
    #[pyo3(signature = (map, kind))]
    fn map(map: PyReadonlyArray2<'_, f32>, kind: &str) -> PyResult<Self> {
        let kind = DepthKind::from_str(kind).map_err(raise)?;
        let map = PriorDepth::from_values(map.as_array().to_owned(), kind).map_err(raise)?;
        let origin = PriorOrigin::new(PriorForm::Map, kind, "depth");
        Ok(Self { source: Source::Map(map), origin })
    }

    /// A depth map in a file.
    #[staticmethod]
    #[pyo3(signature = (path, kind))]
    fn file(path: PathBuf, kind: Option<&str>) -> PyResult<Self> {
        let kind = match (kind, png_content(&path)) {
            (Some(kind), _) => DepthKind::from_str(kind).map_err(raise)?,
            // The file states another unit.
            (None, Ok(Some(PngContent::Depth { unit, .. }))) if unit != METRES => DepthKind::RelativeDepth,
            (None, _) => DepthKind::Metric,
        };
        let options =
            ReadOptions { eight_bits: kind == DepthKind::AffineDisparity, ..ReadOptions::default() };
        let map = FilePrior::with_options(&path, kind, &options).map_err(raise)?.prior().clone();
        let origin = PriorOrigin::new(PriorForm::Map, kind, path.display().to_string());
        Ok(Self { source: Source::Map(map), origin })
    }

    /// `metric`, `depth` or `disparity`.
    #[getter]
    fn kind(&self) -> String {
        self.origin.kind.to_string()
    }

    /// What runs the network; none for a callable or a map.
    #[getter]
    fn runtime(&self) -> Option<&str> {
        self.origin.runtime.as_deref()
    }
}

/// The model's format; with size and kind given, that of a network that takes RGB/255.
fn recognised(
    path: &std::path::Path,
    input_size: Option<(usize, usize)>,
    kind: Option<DepthKind>,
) -> PyResult<ModelSpec> {
    match (OnnxPrior::recognise(path), input_size, kind) {
        (Err(Error::UnknownProfile { .. }), Some((height, width)), Some(kind)) => {
            Ok(ModelSpec::new(width, height, kind))
        }
        (Err(Error::UnknownProfile { .. }), ..) => Err(raise(format!(
            "{}: a network that is not recognised by its graph, its folder or its name; give profile ({}), or input_size with kind, or a \
             file {} beside it",
            path.display(),
            spec::PROFILES.join(", "),
            path.with_extension("toml").display()
        ))),
        (spec, ..) => spec.map_err(raise),
    }
}

/// What runs a network: `tract`, `onnxruntime`, or `auto` for the second where a library is given.
fn runtime(name: &str, library: Option<PathBuf>) -> PyResult<Runtime> {
    match name {
        "tract" => Ok(Runtime::Tract),
        "auto" => Ok(library.map_or(Runtime::Tract, Runtime::OnnxRuntime)),
        "onnxruntime" => find_onnxruntime(library.as_deref()).map(Runtime::OnnxRuntime).ok_or_else(|| {
            raise(
                "runtime is \"onnxruntime\", but no library of ONNX Runtime was found; install it (pip install onnxruntime), or give \
                 the library's path as onnxruntime",
            )
        }),
        _ => Err(raise(format!("runtime is {name:?}; give auto, tract or onnxruntime"))),
    }
}

/// The network, the callable or the map as the loop takes it, with the time of its predictions.
pub(crate) struct Bound<'p> {
    prior: &'p Prior,
    link: &'p Link,
    /// Focal length / width, where the network's metres depend on it.
    focal: Option<f64>,
    /// A map at another size.
    resized: Option<PriorDepth>,
    seconds: std::sync::Mutex<Duration>,
}

impl Prior {
    /// Whether it is a map, whose network is unknown.
    pub(crate) fn is_map(&self) -> bool {
        matches!(self.source, Source::Map(_))
    }

    /// The origin of predictions for a camera of that focal length / width, if it is known.
    pub(crate) fn origin(&self, focal: Option<f64>) -> PriorOrigin {
        let metres = self.origin.model.as_ref().filter(|_| focal.is_some());
        let kind = metres.map_or(self.origin.kind, |spec| spec.output);
        PriorOrigin { kind, ..self.origin.clone() }
    }

    /// The network's own camera for an image: fx, fy, cx, cy. It takes a prediction, for networks that have one.
    pub(crate) fn camera(&self, image: ArrayView3<'_, f32>) -> Result<Option<[f64; 4]>> {
        let has_one = |spec: &ModelSpec| spec.camera_output.is_some() || spec.recover_shift;
        match &self.source {
            Source::Network(network) if self.origin.model.as_ref().is_some_and(has_one) => {
                Ok(network.predict(image)?.intrinsics)
            }
            _ => Ok(None),
        }
    }

    /// The prior for an image file of `original` pixels that is refined at `size`, both `(height, width)`, with that focal length / width. A map of the image's
    /// aspect is resampled; the second value is the warning of it.
    pub(crate) fn bind<'p>(
        &'p self,
        link: &'p Link,
        original: (usize, usize),
        size: (usize, usize),
        focal: Option<f64>,
    ) -> Result<(Bound<'p>, Option<String>)> {
        let mut bound = Bound { prior: self, link, focal, resized: None, seconds: Default::default() };
        let Source::Map(map) = &self.source else { return Ok((bound, None)) };
        let from = map.map.dim();
        let aspect = |(height, width): (usize, usize)| width as f64 / height as f64;
        let same_aspect = (aspect(from) / aspect(original) - 1.0).abs() <= SAME_ASPECT;
        if from == size || (from != original && !same_aspect) {
            return Ok((bound, None));
        }
        let warning = (from != original).then(|| {
            format!(
                "{}: resized from {}x{} to {}x{} pixels, each the nearest one; make the prior at the image's size for its edges",
                self.origin.source, from.1, from.0, size.1, size.0
            )
        });
        bound.resized = Some(map.resized(size)?);
        Ok((bound, warning))
    }
}

impl Bound<'_> {
    fn metres<'n>(&'n self, network: &'n OnnxPrior) -> Option<Metres<'n>> {
        Metres::new(network, self.prior.origin.model.as_ref()?, self.focal?)
    }

    /// Seconds of the predictions so far.
    pub(crate) fn seconds(&self) -> f64 {
        self.seconds.lock().map_or(0.0, |time| time.as_secs_f64())
    }
}

impl DepthPrior for Bound<'_> {
    fn predict(&self, image: ArrayView3<'_, f32>) -> Result<PriorDepth> {
        let start = Instant::now();
        let (height, width, _) = image.dim();
        let prediction = match (&self.prior.source, &self.resized) {
            (_, Some(map)) => Ok(map.clone()),
            (Source::Network(network), _) => match self.metres(network) {
                Some(network) => network.predict(image),
                None => network.predict(image),
            },
            (Source::Callable(_), _) => self
                .link
                .predict(image.as_standard_layout().into_owned())
                .and_then(|map| PriorDepth::from_values(map, self.prior.origin.kind)),
            (Source::Map(map), _) if map.map.dim() == (height, width) => Ok(map.clone()),
            (Source::Map(map), _) => Err(Error::SizeMismatch {
                path: PathBuf::from(&self.prior.origin.source),
                prior: map.map.dim(),
                image: (height, width),
            }),
        };
        if let Ok(mut seconds) = self.seconds.lock() {
            *seconds += start.elapsed();
        }
        prediction
    }

    fn accepts_new_images(&self) -> bool {
        !self.prior.is_map()
    }

    fn resolution(&self, height: usize, width: usize) -> Option<(usize, usize)> {
        match &self.prior.source {
            Source::Network(network) => network.resolution(height, width),
            Source::Callable(size) => *size,
            Source::Map(_) => None,
        }
    }

    fn concurrency(&self) -> usize {
        match &self.prior.source {
            Source::Network(network) => network.concurrency(),
            _ => 1,
        }
    }
}
