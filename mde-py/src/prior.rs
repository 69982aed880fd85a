//! Priors of the package: a network in a file, a callable, a depth map.

use crate::error::raise;
use crate::worker::{Link, pool};
use mde_cli::mde_prior::format::Encoding;
use mde_cli::mde_prior::{
    DepthKind, DepthPrior, Error, InferenceMemory, OnnxPrior, PriorDepth, Result, Runtime, find_onnxruntime,
};
use mde_cli::naming::Naming;
use mde_cli::prior::bound::BoundPrior;
use mde_cli::prior::files::{MapFile, NetworkFormat, open_network, read_options};
use mde_cli::prior::origin::{PriorForm, PriorOrigin};
use mde_cli::scene::photograph::Opened;
use mde_eval::order_check::OrderCheck;
use ndarray::ArrayView3;
use numpy::PyReadonlyArray2;
use pyo3::prelude::*;
use std::path::PathBuf;
use std::str::FromStr;
use std::sync::OnceLock;

enum Source {
    Network(OnnxPrior),
    /// The size of its input, `(height, width)`, where it has one.
    Callable(Option<(usize, usize)>),
    /// With a warning about its file.
    Map(PriorDepth, Option<String>),
}

/// A prior.
#[pyclass(frozen, module = "mdenerf._mdenerf")]
pub(crate) struct Prior {
    source: Source,
    pub(crate) origin: PriorOrigin,
    /// What was found when a network was tried on rooms.
    exchanged: OnceLock<Option<String>>,
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
        let input_size = input_size.map(|(height, width)| [width, height]);
        let format = NetworkFormat { profile: profile.as_deref(), input_size, kind };
        let spec = format.spec(&path, Naming::Keywords).map_err(raise)?;
        let runtime = self::runtime(runtime, library)?;
        let pool = pool(threads)?;
        let opened = py.detach(|| pool.install(|| open_network(&path, spec, &runtime)));
        let (network, origin) = opened.map_err(raise)?;
        Ok(Self::new(Source::Network(network), origin))
    }

    /// A callable of that name.
    #[staticmethod]
    #[pyo3(signature = (name, kind, input_size))]
    fn callable(name: String, kind: &str, input_size: Option<(usize, usize)>) -> PyResult<Self> {
        let kind = DepthKind::from_str(kind).map_err(raise)?;
        let origin = PriorOrigin::new(PriorForm::Callable, kind, name);
        Ok(Self::new(Source::Callable(input_size), origin))
    }

    /// A depth map `[height, width]`.
    #[staticmethod]
    #[pyo3(signature = (map, kind))]
    fn map(map: PyReadonlyArray2<'_, f32>, kind: &str) -> PyResult<Self> {
        let kind = DepthKind::from_str(kind).map_err(raise)?;
        let map = PriorDepth::from_values(map.as_array().to_owned(), kind).map_err(raise)?;
        let origin = PriorOrigin::new(PriorForm::Map, kind, "depth");
        Ok(Self::new(Source::Map(map, None), origin))
    }

    /// A depth map in a file; depth = value / `png_scale`, with that encoding in PNG files.
    #[staticmethod]
    #[pyo3(signature = (path, kind, png_scale, encoding))]
    fn file(path: PathBuf, kind: Option<&str>, png_scale: Option<f64>, encoding: &str) -> PyResult<Self> {
        let kind = kind.map(DepthKind::from_str).transpose().map_err(raise)?;
        let encoding = match encoding {
            "plain" => Encoding::Linear,
            "sunrgbd" => Encoding::Sunrgbd,
            _ => return Err(raise(format!("depth_encoding is {encoding:?}; give plain or sunrgbd"))),
        };
        let options = read_options("png_scale", png_scale, encoding).map_err(raise)?;
        let MapFile { prior, origin, note } =
            MapFile::open(&path, kind, options, Naming::Keywords).map_err(raise)?;
        Ok(Self::new(Source::Map(prior.prior().clone(), note), origin))
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

/// The network, the callable or the map as the loop takes it.
pub(crate) struct Linked<'p> {
    prior: &'p Prior,
    link: &'p Link,
}

impl Prior {
    fn new(source: Source, origin: PriorOrigin) -> Self {
        Self { source, origin, exchanged: OnceLock::new() }
    }

    /// A warning where a network's near and far come out exchanged in rooms, as the program has it. A network is tried once.
    pub(crate) fn exchanged(&self) -> Option<&str> {
        let Source::Network(network) = &self.source else { return None };
        if self.exchanged.get().is_none() && self.origin.is_doubtful() {
            // Without a lock: a thread of the pool that waits would take up work that waits for it.
            let trial = OrderCheck::swapped(network).ok().flatten();
            let found = trial.map(|trial| self.origin.exchanged(trial.mean(), Naming::Keywords));
            // Another thread finds the same.
            let _ = self.exchanged.set(found);
        }
        self.exchanged.get()?.as_deref()
    }

    /// Whether it is a map, whose network is unknown.
    pub(crate) fn is_map(&self) -> bool {
        matches!(self.source, Source::Map(..))
    }

    /// The prior with the connection to its callable.
    pub(crate) fn linked<'p>(&'p self, link: &'p Link) -> Linked<'p> {
        Linked { prior: self, link }
    }
}

impl Linked<'_> {
    /// The prior for a photograph. A map of the photograph's aspect is resampled; warnings of it go to `warn`.
    pub(crate) fn bind(
        &self,
        opened: &Opened,
        warn: &mut dyn FnMut(String),
    ) -> mde_cli::error::Result<BoundPrior<'_>> {
        let bound = BoundPrior::new(self, &self.prior.origin);
        let Source::Map(map, note) = &self.prior.source else { return Ok(bound) };
        note.clone().into_iter().for_each(&mut *warn);
        bound.resampled(map.map.dim(), opened.original, opened.size(), warn)
    }
}

impl DepthPrior for Linked<'_> {
    fn predict(&self, image: ArrayView3<'_, f32>) -> Result<PriorDepth> {
        let (height, width, _) = image.dim();
        match &self.prior.source {
            Source::Network(network) => network.predict(image),
            Source::Callable(_) => self
                .link
                .predict(image.as_standard_layout().into_owned())
                .and_then(|map| PriorDepth::from_values(map, self.prior.origin.kind)),
            Source::Map(map, _) if map.map.dim() == (height, width) => Ok(map.clone()),
            Source::Map(map, _) => Err(Error::SizeMismatch {
                path: PathBuf::from(&self.prior.origin.source),
                prior: map.map.dim(),
                image: (height, width),
            }),
        }
    }

    fn accepts_new_images(&self) -> bool {
        !self.prior.is_map()
    }

    fn resolution(&self, height: usize, width: usize) -> Option<(usize, usize)> {
        match &self.prior.source {
            Source::Network(network) => network.resolution(height, width),
            Source::Callable(size) => *size,
            Source::Map(..) => None,
        }
    }

    fn concurrency(&self) -> usize {
        match &self.prior.source {
            Source::Network(network) => network.concurrency(),
            _ => 1,
        }
    }

    fn memory(&self, height: usize, width: usize) -> Option<InferenceMemory> {
        match &self.prior.source {
            Source::Network(network) => network.memory(height, width),
            _ => None,
        }
    }
}
