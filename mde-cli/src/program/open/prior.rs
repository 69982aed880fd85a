//! The monocular depth that the command line names.

use crate::program::args::PriorArgs;
#[cfg(feature = "onnx")]
use crate::program::args::RuntimeArgs;
use crate::program::progress::Progress;
use anyhow::Result;
use crate::naming::Naming;
use crate::refiner::prior::bound::BoundPrior;
use crate::refiner::prior::{MapFile, read_options};
use crate::refiner::photograph::Opened;
use crate::refiner::prior::origin::PriorOrigin;
use mde_eval::order_check::OrderCheck;
use mde_prior::{DepthKind, DepthPrior};
use std::path::Path;
use std::sync::OnceLock;

/// A prior, and its entry in the record.
pub(crate) struct NamedPrior {
    pub(crate) prior: Box<dyn DepthPrior>,
    pub(crate) origin: PriorOrigin,
    /// `(height, width)` of a map from a file.
    pub(crate) size: Option<(usize, usize)>,
    /// A warning about the file.
    pub(crate) note: Option<String>,
    /// What was found when it was tried on rooms, once.
    exchanged: OnceLock<Option<String>>,
}

impl NamedPrior {
    pub(crate) fn open(args: &PriorArgs) -> Result<Self> {
        let kind = args.prior_kind.map(DepthKind::from);
        match (&args.source.prior_model, &args.source.prior_depth) {
            (Some(model), _) => Self::model(model, args, kind),
            (None, Some(file)) => Self::file(file, args, kind),
            (None, None) => anyhow::bail!("no prior is named; give --prior-model or --prior-depth"),
        }
    }

    /// The same for a photograph. A map of another size than the image, but of its aspect, is resampled; one of the size of the image's file
    /// is resized with it, without a note.
    pub(crate) fn bind(&self, opened: &Opened, progress: &mut Progress) -> Result<BoundPrior<'_>> {
        self.note.iter().for_each(|note| progress.warn(note.clone()));
        let bound = BoundPrior::new(&*self.prior, &self.origin);
        let from = self.size.unwrap_or(opened.original);
        match self.origin.model {
            Some(_) => Ok(bound),
            None => {
                Ok(bound.resampled(from, opened.original, opened.size(), &mut |note| progress.warn(note))?)
            }
        }
    }

    /// A warning where a network's near and far come out exchanged in rooms. Only one whose kind of output neither its graph nor a model hub
    /// tells is tried, once. Not for threads of a pool: they would take up work that waits for the result.
    pub(crate) fn exchanged(&self) -> Option<&str> {
        let found = self.exchanged.get_or_init(|| {
            // What can't be predicted fails in the run too, with its own error.
            let tried = self.origin.is_doubtful().then(|| OrderCheck::swapped(&*self.prior));
            let trial = tried?.ok()??;
            Some(self.origin.exchanged(trial.mean(), Naming::Flags))
        });
        found.as_deref()
    }

    fn file(path: &Path, args: &PriorArgs, kind: Option<DepthKind>) -> Result<Self> {
        let options = read_options("--png-scale", args.png_scale, args.prior_encoding.into())?;
        let MapFile { prior, origin, note } = MapFile::open(path, kind, options, Naming::Flags)?;
        let size = Some(prior.prior().map.dim());
        Ok(Self { prior: Box::new(prior), origin, size, note, exchanged: OnceLock::new() })
    }

    #[cfg(feature = "onnx")]
    fn model(path: &Path, args: &PriorArgs, kind: Option<DepthKind>) -> Result<Self> {
        use crate::refiner::prior::{NetworkFormat, open_network};
        let profile = args.model_profile.as_deref();
        let spec = NetworkFormat { profile, input_size: args.input_size, kind }.spec(path, Naming::Flags)?;
        let (prior, origin) = open_network(path, spec, &runtime(&args.runtime)?)?;
        Ok(Self { prior: Box::new(prior), origin, size: None, note: None, exchanged: OnceLock::new() })
    }

    #[cfg(not(feature = "onnx"))]
    fn model(path: &Path, _: &PriorArgs, _: Option<DepthKind>) -> Result<Self> {
        let path = path.display();
        anyhow::bail!(
            "{path}: this program was built without ONNX; build it with --features onnx, or use --prior-depth"
        )
    }
}

/// What runs the model.
#[cfg(feature = "onnx")]
pub(crate) fn runtime(args: &RuntimeArgs) -> Result<mde_prior::Runtime> {
    #[cfg(feature = "onnxruntime")]
    {
        use crate::program::args::RuntimeName;
        let named = args.onnxruntime.as_deref();
        let wanted = args.runtime.unwrap_or(match named {
            None => RuntimeName::Tract,
            Some(_) => RuntimeName::Onnxruntime,
        });
        if wanted == RuntimeName::Tract {
            anyhow::ensure!(
                named.is_none(),
                "--runtime tract: runs no library, but --onnxruntime names one; leave one of them out"
            );
            return Ok(mde_prior::Runtime::Tract);
        }
        if let Some(library) = mde_prior::find_onnxruntime(named) {
            return Ok(mde_prior::Runtime::OnnxRuntime(library));
        }
        anyhow::ensure!(
            wanted == RuntimeName::Auto,
            "--runtime onnxruntime: no library of ONNX Runtime was found; install it (pip install onnxruntime), or give its path with \
             --onnxruntime or ORT_DYLIB_PATH"
        );
    }
    #[cfg(not(feature = "onnxruntime"))]
    let _ = args;
    Ok(mde_prior::Runtime::Tract)
}
