//! The monocular depth that the command line names.

use crate::args::PriorArgs;
#[cfg(feature = "onnx")]
use crate::args::RuntimeArgs;
use crate::input::camera::{CameraSource, KnownCamera};
use crate::input::opened::Opened;
use crate::run::progress::Progress;
use anyhow::{Context, Result, ensure};
use mde_cli::inputs::{PriorForm, PriorOrigin};
use mde_cli::pictures16::METRES;
use mde_prior::format::{Encoding, PngContent, ReadOptions, png_content};
use mde_prior::ndarray::{Array3, ArrayView3};
use mde_prior::{DepthKind, DepthPrior, FilePrior, Metres, ModelSpec, PriorDepth};
use mde_warp::PinholeCamera;
use std::path::Path;

/// A prior, and its entry in the record.
pub(crate) struct NamedPrior<'p> {
    pub(crate) prior: Box<dyn DepthPrior + 'p>,
    pub(crate) origin: PriorOrigin,
    /// `(height, width)` of a map from a file.
    pub(crate) size: Option<(usize, usize)>,
    /// What to know of the file.
    pub(crate) note: Option<String>,
}

/// Two aspects that differ by no more are the same up to rounded sides.
const SAME_ASPECT: f64 = 0.02;

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
        let mut origin = self.origin.clone();
        let prior: Box<dyn DepthPrior + '_> = match (metres, spec) {
            (Some(metres), Some(spec)) => {
                origin.kind = spec.output;
                Box::new(metres)
            }
            _ => Box::new(&*self.prior),
        };
        NamedPrior { prior, origin, size: self.size, note: None }
    }

    /// The network's own camera for an image, in place of an assumed one; it takes a prediction.
    pub(crate) fn camera(
        &self,
        image: ArrayView3<'_, f32>,
        known: &KnownCamera,
    ) -> Result<Option<KnownCamera>> {
        let has_one = |spec: &ModelSpec| spec.camera_output.is_some() || spec.recover_shift;
        if !(matches!(known.source, CameraSource::Assumed(_))
            && self.origin.model.as_ref().is_some_and(has_one))
        {
            return Ok(None);
        }
        let Some([fx, fy, cx, cy]) = self.prior.predict(image)?.intrinsics else { return Ok(None) };
        let (height, width, _) = image.dim();
        let camera = PinholeCamera::new(fx, fy, cx, cy, width, height)
            .with_context(|| format!("{}: its own camera", self.origin.source))?;
        Ok(Some(KnownCamera { camera, source: CameraSource::Network }))
    }

    /// A map of another size than the image, but of its aspect, is resampled. A map of the size of an image's file is
    /// resized with it, without a note.
    pub(crate) fn resized(self, opened: &Opened, progress: &mut Progress) -> Result<Self> {
        self.note.iter().for_each(|note| progress.warn(note.clone()));
        let (from, to) = (self.size.unwrap_or(opened.original), opened.size);
        if from == to || self.origin.model.is_some() {
            return Ok(self);
        }
        if from != opened.original {
            let aspect = |(height, width): (usize, usize)| width as f64 / height as f64;
            if (aspect(from) / aspect(opened.original) - 1.0).abs() > SAME_ASPECT {
                return Ok(self);
            }
            let ((h, w), (height, width)) = (from, to);
            progress.warn(format!(
                "{}: resized from {w}x{h} to {width}x{height} pixels, each the nearest one; make the prior at the image's size for its edges",
                self.origin.source
            ));
        }
        let prior = Box::new(Resized { prior: self.prior, from, to });
        Ok(Self { prior, origin: self.origin, size: Some(to), note: None })
    }

    fn file(path: &Path, args: &PriorArgs, kind: Option<DepthKind>) -> Result<Self> {
        let source = path.display().to_string();
        let unit = unit(path);
        let (kind, stated) = match (kind, unit) {
            (Some(kind), _) => (kind, None),
            (None, Some(unit)) if unit != METRES => (DepthKind::RelativeDepth, Some(unit)),
            (None, _) => (DepthKind::Metric, None),
        };
        let options = read_options("--png-scale", args.png_scale, args.prior_encoding.into())?;
        // Only as disparity: its scale is unknown anyway, and 256 levels of depth in metres would be none.
        let options = ReadOptions { eight_bits: kind == DepthKind::AffineDisparity, ..options };
        let prior = Box::new(FilePrior::with_options(path, kind, &options)?);
        let size = Some(prior.prior().map.dim());
        let eight_bits = || {
            has_eight_bits(path).then(|| {
                format!("{source}: 8 bits hold 256 levels at most, so its depth has steps; write the disparity as floats")
            })
        };
        let unscaled = |unit| {
            format!(
                "{source}: its metadata have the unit \"{unit}\", so it is depth in an unknown unit; with --prior-kind metric it is metres"
            )
        };
        let note = stated.map(unscaled).or_else(eight_bits);
        let origin = PriorOrigin::new(PriorForm::Map, kind, source);
        Ok(Self { prior, origin, size, note })
    }

    #[cfg(feature = "onnx")]
    fn model(path: &Path, args: &PriorArgs, kind: Option<DepthKind>) -> Result<Self> {
        use mde_cli::calibration::hash_files;
        use mde_prior::OnnxPrior;
        let mut spec = match &args.model_profile {
            Some(name) => ModelSpec::profile(name)?,
            // A missing file gets its own error below.
            None if path.exists() => recognised(path, args, kind)?,
            None => ModelSpec::new(1, 1, DepthKind::Metric),
        };
        if let Some([width, height]) = args.input_size {
            (spec.width, spec.height) = (width, height);
        }
        if let Some(kind) = kind {
            spec = spec.with_output(kind);
        }
        let prior = Box::new(OnnxPrior::open_with(path, &spec, &runtime(&args.runtime)?)?);
        let model_hash = Some(hash_files(prior.files())?);
        let origin = PriorOrigin {
            form: PriorForm::Network,
            kind: prior.kind(),
            source: path.display().to_string(),
            model: Some(spec),
            runtime: Some(prior.runtime().to_string()),
            model_hash,
        };
        Ok(Self { prior, origin, size: None, note: None })
    }

    #[cfg(not(feature = "onnx"))]
    fn model(path: &Path, _: &PriorArgs, _: Option<DepthKind>) -> Result<Self> {
        let path = path.display();
        anyhow::bail!(
            "{path}: this program was built without ONNX; build it with --features onnx, or use --prior-depth"
        )
    }
}

/// The model's format; with size and kind given, that of a network that takes RGB/255.
#[cfg(feature = "onnx")]
fn recognised(path: &Path, args: &PriorArgs, kind: Option<DepthKind>) -> Result<ModelSpec> {
    use mde_prior::{Error, OnnxPrior};
    match (OnnxPrior::recognise(path), args.input_size, kind) {
        (Err(Error::UnknownProfile { .. }), Some([width, height]), Some(kind)) => {
            Ok(ModelSpec::new(width, height, kind))
        }
        (Err(Error::UnknownProfile { .. }), ..) => anyhow::bail!(
            "{}: a network that is not recognised by its graph, its folder or its name; give --model-profile ({}), or --input-size WxH \
             with --prior-kind, or a file {} beside it",
            path.display(),
            mde_prior::spec::PROFILES.join(", "),
            path.with_extension("toml").display()
        ),
        (spec, ..) => Ok(spec?),
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

/// The unit in the metadata of a depth map.
fn unit(path: &Path) -> Option<String> {
    match png_content(path).ok().flatten() {
        Some(PngContent::Depth { unit, .. }) => Some(unit),
        _ => None,
    }
}

/// Whether a file is a PNG of 8 bits a sample.
fn has_eight_bits(path: &Path) -> bool {
    let mut header = [0; 25];
    let read =
        std::fs::File::open(path).and_then(|mut file| std::io::Read::read_exact(&mut file, &mut header));
    read.is_ok() && header.starts_with(b"\x89PNG") && header[24] == 8
}

/// A prior of the image's original size, resampled to the working size.
struct Resized<'p> {
    prior: Box<dyn DepthPrior + 'p>,
    /// `(height, width)`.
    from: (usize, usize),
    to: (usize, usize),
}

impl DepthPrior for Resized<'_> {
    fn predict(&self, _: ArrayView3<'_, f32>) -> mde_prior::Result<PriorDepth> {
        // A map from a file depends on the size alone.
        let blank = Array3::zeros((self.from.0, self.from.1, 3));
        self.prior.predict(blank.view())?.resized(self.to)
    }
}

/// How a map is read, with the scale that `flag` gave.
pub(crate) fn read_options(flag: &str, scale: Option<f64>, encoding: Encoding) -> Result<ReadOptions> {
    let mut options = ReadOptions { encoding, ..ReadOptions::default() };
    if let Some(scale) = scale {
        let usable = scale > 0.0 && scale.is_finite();
        ensure!(usable, "{flag}: {scale} is no scale; give a positive number of steps per unit");
        (options.png_scale, options.float_scale) = (Some(scale), scale);
    }
    Ok(options)
}
