//! Priors of the package: a network in a file, a callable, a depth map.

use crate::error::raise;
use crate::worker::{Link, pool};
use mde_cli::mde_prior::{DepthKind, DepthPrior, FilePrior, PriorDepth, Result, Runtime, find_onnxruntime};
use mde_cli::prior::OpenPrior;
use mde_cli::prior::files::read_options;
use mde_cli::prior::origin::{PriorForm, PriorOrigin};
use ndarray::ArrayView3;
use numpy::PyReadonlyArray2;
use pyo3::prelude::*;
use std::path::PathBuf;
use std::str::FromStr;

/// Source of a map in memory.
const MAP: &str = "prior_depth";

enum Source {
    /// A network, a map, or nothing.
    Open(OpenPrior<'static>),
    Callable(PriorOrigin),
}

/// A prior.
#[pyclass(frozen, module = "mdenerf._mdenerf")]
pub(crate) struct Prior(Source);

#[pymethods]
impl Prior {
    /// A network in an ONNX file, with the name or the file of its profile and the kind of its values.
    #[staticmethod]
    fn network(
        py: Python<'_>,
        path: PathBuf,
        profile: Option<&str>,
        kind: Option<&str>,
        runtime: &str,
        library: Option<PathBuf>,
        threads: Option<usize>,
    ) -> PyResult<Self> {
        let kind = kind.map(named).transpose()?;
        let runtime = self::runtime(runtime, library)?;
        let pool = pool(threads)?;
        let open = || OpenPrior::network(&path, profile, kind, &runtime);
        Ok(Self(Source::Open(py.detach(|| pool.install(open)).map_err(raise)?)))
    }

    /// A callable of that name.
    #[staticmethod]
    fn callable(name: String, kind: &str) -> PyResult<Self> {
        Ok(Self(Source::Callable(PriorOrigin::new(PriorForm::Callable, named(kind)?, name))))
    }

    /// None, for several photographs.
    #[staticmethod]
    fn nothing() -> Self {
        Self(Source::Open(OpenPrior::nothing()))
    }

    /// A depth map `[height, width]`.
    #[staticmethod]
    fn map(map: PyReadonlyArray2<'_, f32>, kind: &str) -> PyResult<Self> {
        let kind = named(kind)?;
        let map = PriorDepth::from_values(map.as_array().to_owned(), kind).map_err(raise)?;
        let prior = FilePrior::of_map(MAP, map);
        let origin = PriorOrigin::new(PriorForm::Map, kind, MAP);
        Ok(Self(Source::Open(OpenPrior::map(prior, origin))))
    }

    /// A depth map in a file; depth = value / `png_scale`.
    #[staticmethod]
    fn file(path: PathBuf, kind: Option<&str>, png_scale: Option<f64>) -> PyResult<Self> {
        let kind = kind.map(named).transpose()?;
        let options = read_options("png_scale", png_scale).map_err(raise)?;
        Ok(Self(Source::Open(OpenPrior::map_file(&path, kind, options).map_err(raise)?)))
    }

    /// What runs the network; none for a callable or a map.
    #[getter]
    fn runtime(&self) -> Option<&str> {
        match &self.0 {
            Source::Open(open) => open.origin().runtime.as_deref(),
            Source::Callable(_) => None,
        }
    }
}

impl Prior {
    /// Lends the prior to `work`; a callable is served through the link.
    pub(crate) fn open<T>(&self, link: &Link, work: impl FnOnce(&OpenPrior<'_>) -> T) -> T {
        match &self.0 {
            Source::Open(open) => work(open),
            Source::Callable(origin) => {
                let served = Served { link, kind: origin.kind };
                work(&OpenPrior::given(Box::new(served), origin.clone()))
            }
        }
    }
}

/// A callable, which the calling thread runs.
struct Served<'l> {
    link: &'l Link,
    kind: DepthKind,
}

impl DepthPrior for Served<'_> {
    fn predict(&self, image: ArrayView3<'_, f32>) -> Result<PriorDepth> {
        let map = self.link.predict(image.as_standard_layout().into_owned())?;
        PriorDepth::from_values(map, self.kind)
    }

    fn accepts_new_images(&self) -> bool {
        true
    }
}

fn named(kind: &str) -> PyResult<DepthKind> {
    DepthKind::from_str(kind).map_err(|error| raise(format!("prior_kind: {error}")))
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
