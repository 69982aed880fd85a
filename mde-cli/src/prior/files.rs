//! Priors from files: maps, and networks with their format.

use crate::error::{Error, Result};
use crate::prior::{METRES, OpenPrior, PriorForm, PriorOrigin};
use mde_prior::format::{PngContent, ReadOptions, png_content};
use mde_prior::{DepthKind, FileKind, FilePrior, open};
use std::io::Read as _;
use std::path::Path;

impl OpenPrior<'_> {
    /// Reads a map, without a kind as metric, or of the unknown unit in its metadata. Eight bits are read as disparity alone, in any case.
    ///
    /// # Errors
    /// [`Error::Prior`] for a file that can't be read.
    pub fn map_file(path: &Path, kind: Option<DepthKind>, options: ReadOptions) -> Result<Self> {
        let source = path.display().to_string();
        let (kind, stated) = match (kind, unit(path)) {
            (Some(kind), _) => (kind, None),
            (None, Some(unit)) if unit != METRES => (DepthKind::RelativeDepth, Some(unit)),
            (None, _) => (DepthKind::Metric, None),
        };
        // Only as disparity: its scale is unknown anyway, and 256 levels of depth in metres would be none.
        let options = ReadOptions { eight_bits: kind == DepthKind::AffineDisparity, ..options };
        let prior = FilePrior::open(path, kind, &options).map_err(|error| match error {
            mde_prior::Error::Malformed { path: file, reason } if has_eight_bits(path, true) => {
                let reason =
                    format!("{reason}; a picture of disparity is read with {{prior-kind}} disparity");
                mde_prior::Error::Malformed { path: file, reason }
            }
            other => other,
        })?;
        let eight_bits = || {
            has_eight_bits(path, false).then(|| {
                format!("{source}: 8 bits hold 256 levels at most, so its depth has steps; write the disparity as floats")
            })
        };
        let unscaled = |unit| {
            format!(
                "{source}: its metadata have the unit \"{unit}\", so it is depth in an unknown unit; with {{prior-kind}} metric it is metres"
            )
        };
        let note = stated.map(unscaled).or_else(eight_bits);
        Ok(Self { note, ..Self::map(prior, PriorOrigin::new(PriorForm::Map, kind, source)) })
    }

    /// Opens a network on a runtime. A profile's name or file gives its format, by default recognised; `kind` that of its values, if any.
    ///
    /// # Errors
    /// [`Error::Prior`] for an unknown profile, or a network that can't be opened; [`Error::Argument`] for one that is not recognised.
    #[cfg(feature = "onnx")]
    pub fn network(
        path: &Path,
        profile: Option<&str>,
        kind: Option<DepthKind>,
        runtime: &mde_prior::Runtime,
    ) -> Result<Self> {
        use mde_prior::{ModelSpec, OnnxPrior, RecognisedBy};
        if let Some(is) = no_network(path) {
            return Err(Error::Argument(format!("{}: {is}", path.display())));
        }
        let mut certain = false;
        let spec = match profile {
            Some(file) if file.ends_with(".toml") => {
                let text = open::read_text(file, FileKind::Settings).map_err(Error::read(file.as_ref()))?;
                ModelSpec::from_toml(&text).map_err(|error| Error::Argument(format!("{file}: {error}")))?
            }
            Some(name) => ModelSpec::profile(name)?,
            // A missing file gets its own error when it is opened.
            None if !path.exists() => ModelSpec::new(1, 1, DepthKind::Metric),
            None => match OnnxPrior::recognise(path) {
                Err(mde_prior::Error::UnknownProfile { .. }) => {
                    return Err(Error::Argument(format!(
                        "{}: a network that is not recognised by its graph, its folder or its name; give {{model-profile}} ({}, or a .toml file), \
                         or a file {} beside it",
                        path.display(),
                        mde_prior::spec::PROFILES.join(", "),
                        path.with_extension("toml").display()
                    )));
                }
                recognised => {
                    let (spec, by) = recognised?;
                    certain = matches!(by, RecognisedBy::Hub | RecognisedBy::Graph);
                    spec
                }
            },
        };
        let recognised = certain.then_some(spec.output);
        let spec = match kind {
            Some(kind) => spec.with_output(kind),
            None => spec,
        };
        let prior = OnnxPrior::open_with(path, &spec, runtime)?;
        let origin = PriorOrigin {
            kind_is_told: recognised == Some(spec.output),
            model_hash: Some(crate::prior::hash_files(prior.files())?),
            model: Some(spec),
            runtime: Some(prior.runtime().to_string()),
            ..PriorOrigin::new(PriorForm::Network, prior.kind(), path.display().to_string())
        };
        Ok(Self::given(Box::new(prior), origin))
    }
}

/// How a map is read with the scale that is given as the argument `name`.
///
/// # Errors
/// [`Error::Argument`] for a scale that is none.
pub fn read_options(name: &str, scale: Option<f64>) -> Result<ReadOptions> {
    let mut options = ReadOptions::default();
    if let Some(scale) = scale {
        if !(scale > 0.0 && scale.is_finite()) {
            return Err(Error::Argument(format!(
                "{name}: {scale} is no scale; give a positive number of steps per unit"
            )));
        }
        (options.png_scale, options.float_scale) = (Some(scale), scale);
    }
    Ok(options)
}

/// The unit in the metadata of a depth map.
fn unit(path: &Path) -> Option<String> {
    let Ok(Some(PngContent::Depth { unit, .. })) = png_content(path) else { return None };
    Some(unit)
}

/// Whether a file is a PNG of 8 bits a sample; `grey`: of one channel.
fn has_eight_bits(path: &Path, grey: bool) -> bool {
    let mut header = [0; 26];
    let read = open::open(path, FileKind::DepthMap).and_then(|mut file| file.read_exact(&mut header));
    read.is_ok() && header.starts_with(b"\x89PNG") && header[24] == 8 && (!grey || header[25] == 0)
}

/// What a file is that is often taken for a network, and what to do.
#[cfg(feature = "onnx")]
fn no_network(path: &Path) -> Option<&'static str> {
    if ["http:", "https:"].iter().any(|scheme| path.starts_with(scheme)) {
        return Some("an address; download the file, and give its path");
    }
    let mut bytes = Vec::new();
    open::open(path, FileKind::Network).ok()?.take(512).read_to_end(&mut bytes).ok()?;
    let begins = |with: &str| bytes.trim_ascii_start().to_ascii_lowercase().starts_with(with.as_bytes());
    Some(match bytes.as_slice() {
        _ if begins("<!doctype") || begins("<html") => "a web page; download the file that it is about",
        _ if begins("version https://git-lfs") => "a pointer of Git LFS; fetch the network with git lfs pull",
        [b'P', b'K', 3, 4, ..] | [0x80, 2, b'c' | b'}' | 0x8a, ..] => {
            "a PyTorch checkpoint; export it to ONNX"
        }
        [_, _, _, _, _, 0, 0, 0, b'{', b'"', ..] => "weights in safetensors; export the network to ONNX",
        _ => return None,
    })
}
