//! The monocular depth that the command line names.

use crate::args::PriorArgs;
#[cfg(feature = "onnx")]
use crate::args::RuntimeArgs;
use crate::input::camera::KnownCamera;
use crate::input::opened::Opened;
use crate::run::progress::Progress;
use anyhow::{Result, ensure};
use mde_cli::Naming;
use mde_cli::inputs::{MapFile, PriorOrigin, Resampled, read_options};
use mde_prior::ndarray::{Array3, ArrayView3};
use mde_prior::{DepthKind, DepthPrior, Metres};
use std::path::Path;

/// A prior, and its entry in the record.
pub(crate) struct NamedPrior<'p> {
    pub(crate) prior: Box<dyn DepthPrior + 'p>,
    pub(crate) origin: PriorOrigin,
    /// `(height, width)` of a map from a file.
    pub(crate) size: Option<(usize, usize)>,
    /// A warning about the file.
    pub(crate) note: Option<String>,
}

impl NamedPrior<'_> {
    pub(crate) fn open(args: &PriorArgs) -> Result<Self> {
        let kind = args.prior_kind.map(DepthKind::from);
        match (&args.source.prior_model, &args.source.prior_depth) {
            (Some(model), _) => Self::model(model, args, kind),
            (None, Some(file)) => Self::file(file, args, kind),
            (None, None) => anyhow::bail!("no prior is named; give --prior-model or --prior-depth"),
        }
    }

    /// The same for photographs of that camera: a network whose metres depend on the focal length has some only then.
    pub(crate) fn for_camera(&self, camera: &KnownCamera) -> NamedPrior<'_> {
        let spec = self.origin.model.as_ref();
        let metres =
            spec.zip(camera.focal()).and_then(|(spec, focal)| Metres::new(&*self.prior, spec, focal));
        let prior: Box<dyn DepthPrior + '_> = match metres {
            Some(metres) => Box::new(metres),
            None => Box::new(&*self.prior),
        };
        let origin = self.origin.at_focal(camera.focal());
        NamedPrior { prior, origin, size: self.size, note: None }
    }

    /// The network's own camera for an image, in place of an assumed one; it takes a prediction.
    pub(crate) fn camera(
        &self,
        image: ArrayView3<'_, f32>,
        known: &KnownCamera,
    ) -> Result<Option<KnownCamera>> {
        Ok(known.by_network(&*self.prior, &self.origin, image)?)
    }

    /// A map of another size than the image, but of its aspect, is resampled. A map of the size of an image's file is
    /// resized with it, without a note.
    pub(crate) fn resized(self, opened: &Opened, progress: &mut Progress) -> Result<Self> {
        self.note.iter().for_each(|note| progress.warn(note.clone()));
        let (from, to) = (self.size.unwrap_or(opened.original), opened.size);
        if self.origin.model.is_some() {
            return Ok(self);
        }
        let Some(found) = Resampled::find(&self.origin.source, from, opened.original, to) else {
            return Ok(self);
        };
        found.warning.into_iter().for_each(|warning| progress.warn(warning));
        let prior = Box::new(Resized { prior: self.prior, from, to });
        Ok(Self { prior, origin: self.origin, size: Some(to), note: None })
    }

    fn file(path: &Path, args: &PriorArgs, kind: Option<DepthKind>) -> Result<Self> {
        let options = read_options("--png-scale", args.png_scale, args.prior_encoding.into())?;
        let MapFile { prior, origin, note } = MapFile::open(path, kind, options, Naming::Flags)?;
        let size = Some(prior.prior().map.dim());
        Ok(Self { prior: Box::new(prior), origin, size, note })
    }

    #[cfg(feature = "onnx")]
    fn model(path: &Path, args: &PriorArgs, kind: Option<DepthKind>) -> Result<Self> {
        use mde_cli::inputs::{NetworkFormat, open_network};
        let profile = args.model_profile.as_deref();
        let spec = NetworkFormat { profile, input_size: args.input_size, kind }.spec(path, Naming::Flags)?;
        let (prior, origin) = open_network(path, spec, &runtime(&args.runtime)?)?;
        Ok(Self { prior: Box::new(prior), origin, size: None, note: None })
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
        use crate::args::RuntimeName;
        let named = args.onnxruntime.as_deref();
        if args.runtime == RuntimeName::Tract && named.is_none() {
            return Ok(mde_prior::Runtime::Tract);
        }
        if let Some(library) = mde_prior::find_onnxruntime(named) {
            return Ok(mde_prior::Runtime::OnnxRuntime(library));
        }
        ensure!(
            args.runtime == RuntimeName::Auto,
            "--runtime onnxruntime: no library of ONNX Runtime was found; install it (pip install onnxruntime), or give its path with \
             --onnxruntime or ORT_DYLIB_PATH"
        );
    }
    #[cfg(not(feature = "onnxruntime"))]
    let _ = args;
    Ok(mde_prior::Runtime::Tract)
}

/// A prior of the image's original size, resampled to the working size.
struct Resized<'p> {
    prior: Box<dyn DepthPrior + 'p>,
    /// `(height, width)`.
    from: (usize, usize),
    to: (usize, usize),
}

impl DepthPrior for Resized<'_> {
    fn predict(&self, _: ArrayView3<'_, f32>) -> mde_prior::Result<mde_prior::PriorDepth> {
        // A map from a file depends on the size alone.
        let blank = Array3::zeros((self.from.0, self.from.1, 3));
        self.prior.predict(blank.view())?.resized(self.to)
    }
}
