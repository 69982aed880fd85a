//! Priors from files: maps, and networks with their format.

use crate::error::Result;
use crate::prior::origin::{METRES, PriorForm, PriorOrigin};
use mde_prior::format::{PngContent, ReadOptions, png_content};
use mde_prior::{DepthKind, FileKind, FilePrior, open};
use std::io::Read as _;
use std::path::Path;

/// Two aspects that differ by no more are the same up to rounded sides.
const SAME_ASPECT: f64 = 0.02;

/// A map from a file.
#[derive(Debug)]
pub struct MapFile {
    /// The map.
    pub prior: FilePrior,
    /// Where it comes from.
    pub origin: PriorOrigin,
    /// A warning about the file: an unknown unit, or 8 bits.
    pub note: Option<String>,
}

impl MapFile {
    /// Reads a map. Without a kind it is metric, or depth in an unknown unit where the file's metadata have another unit. Eight bits are
    /// read as disparity alone, whatever `options` has.
    ///
    /// # Errors
    /// [`Error::Prior`](crate::error::Error::Prior) for a file that can't be read.
    pub fn open(path: &Path, kind: Option<DepthKind>, options: ReadOptions) -> Result<Self> {
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
        Ok(Self { prior, origin: PriorOrigin::new(PriorForm::Map, kind, source), note })
    }
}

/// How a map is read with the scale that is given as the argument `name`.
///
/// # Errors
/// [`Error::Argument`](crate::error::Error::Argument) for a scale that is none.
pub fn read_options(name: &str, scale: Option<f64>) -> Result<ReadOptions> {
    let mut options = ReadOptions::default();
    if let Some(scale) = scale {
        if !(scale > 0.0 && scale.is_finite()) {
            return Err(crate::error::Error::Argument(format!(
                "{name}: {scale} is no scale; give a positive number of steps per unit"
            )));
        }
        (options.png_scale, options.float_scale) = (Some(scale), scale);
    }
    Ok(options)
}

/// The unit in the metadata of a depth map.
fn unit(path: &Path) -> Option<String> {
    match png_content(path).ok().flatten() {
        Some(PngContent::Depth { unit, .. }) => Some(unit),
        _ => None,
    }
}

/// Whether a file is a PNG of 8 bits a sample; `grey`: of one channel.
fn has_eight_bits(path: &Path, grey: bool) -> bool {
    let mut header = [0; 26];
    let read = open::open(path, FileKind::DepthMap).and_then(|mut file| file.read_exact(&mut header));
    read.is_ok() && header.starts_with(b"\x89PNG") && header[24] == 8 && (!grey || header[25] == 0)
}

/// A map that is resampled to the size of a refinement.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Resampled {
    /// Where the map is not of the photograph's size.
    pub warning: Option<String>,
}

impl Resampled {
    /// Whether a map of the size `from` is resampled for a photograph of `original` pixels that is refined at `to`, all `(height, width)`: where
    /// it has the photograph's aspect. `source` names the map.
    pub fn find(
        source: &str,
        from: (usize, usize),
        original: (usize, usize),
        to: (usize, usize),
    ) -> Option<Self> {
        if from == to {
            return None;
        }
        if from == original {
            return Some(Self { warning: None });
        }
        let aspect = |(height, width): (usize, usize)| width as f64 / height as f64;
        let same = (aspect(from) / aspect(original) - 1.0).abs() <= SAME_ASPECT;
        let ((h, w), (height, width)) = (from, to);
        same.then(|| Self {
            warning: Some(format!(
                "{source}: resized from {w}x{h} to {width}x{height} pixels, each the nearest one; make the prior at the image's size for its edges"
            )),
        })
    }
}

#[cfg(feature = "onnx")]
mod network {
    use super::{Path, PriorForm, PriorOrigin, Result};
    use crate::error::Error;
    use crate::prior::hash_files;
    use mde_prior::{DepthKind, FileKind, ModelSpec, OnnxPrior, RecognisedBy, Runtime, open, spec};

    /// What is given of a network's format.
    #[derive(Debug, Clone, Copy, Default)]
    pub struct NetworkFormat<'f> {
        /// Name of its profile.
        pub profile: Option<&'f str>,
        /// Kind of its values.
        pub kind: Option<DepthKind>,
    }

    /// The format of a network.
    #[derive(Debug, Clone, PartialEq)]
    pub struct NetworkSpec {
        /// Its input and output.
        pub spec: ModelSpec,
        /// The kind of output that its graph or the files of its model hub tell, where they do.
        pub told: Option<DepthKind>,
    }

    impl NetworkFormat<'_> {
        /// The format of the network in a file: what is given over its profile, by default the recognised one.
        ///
        /// # Errors
        /// [`Error::Prior`] for an unknown profile, [`Error::Argument`] for a network that is not recognised.
        pub fn spec(&self, path: &Path) -> Result<NetworkSpec> {
            let (spec, by) = match self.profile {
                Some(file) if file.ends_with(".toml") => (read_spec(Path::new(file))?, None),
                Some(name) => (ModelSpec::profile(name)?, None),
                // A missing file gets its own error when it is opened.
                None if path.exists() => self.recognised(path)?,
                None => (ModelSpec::new(1, 1, DepthKind::Metric), None),
            };
            let tells = matches!(by, Some(RecognisedBy::Hub | RecognisedBy::Graph));
            let told = tells.then_some(spec.output);
            let spec = match self.kind {
                Some(kind) => spec.with_output(kind),
                None => spec,
            };
            Ok(NetworkSpec { spec, told })
        }

        fn recognised(&self, path: &Path) -> Result<(ModelSpec, Option<RecognisedBy>)> {
            match OnnxPrior::recognise(path) {
                Err(mde_prior::Error::UnknownProfile { .. }) => Err(Error::Argument(format!(
                    "{}: a network that is not recognised by its graph, its folder or its name; give {{model-profile}} ({}, or a .toml file), or a \
                     file {} beside it",
                    path.display(),
                    spec::PROFILES.join(", "),
                    path.with_extension("toml").display()
                ))),
                recognised => Ok(recognised.map(|(spec, by)| (spec, Some(by)))?),
            }
        }
    }

    fn read_spec(path: &Path) -> Result<ModelSpec> {
        let text = open::read_text(path, FileKind::Settings).map_err(Error::io(path))?;
        ModelSpec::from_toml(&text).map_err(|error| Error::Argument(format!("{}: {error}", path.display())))
    }

    /// Opens a network of that format, on that runtime.
    ///
    /// # Errors
    /// [`Error::Prior`] for a network that can't be opened, [`Error::Io`] for files that can't be read.
    pub fn open_network(
        path: &Path,
        network: NetworkSpec,
        runtime: &Runtime,
    ) -> Result<(OnnxPrior, PriorOrigin)> {
        let NetworkSpec { spec, told } = network;
        let prior = OnnxPrior::open_with(path, &spec, runtime)?;
        let model_hash = Some(hash_files(prior.files())?);
        let origin = PriorOrigin {
            form: PriorForm::Network,
            kind: prior.kind(),
            kind_is_told: told == Some(spec.output),
            source: path.display().to_string(),
            model: Some(spec),
            runtime: Some(prior.runtime().to_string()),
            model_hash,
        };
        Ok((prior, origin))
    }
}

#[cfg(feature = "onnx")]
pub use network::{NetworkFormat, NetworkSpec, open_network};

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_map_of_the_photographs_aspect_is_resampled() {
        let find = |from, to| Resampled::find("map", from, (480, 640), to);
        assert_eq!(find((240, 320), (240, 320)), None);
        assert_eq!(find((480, 640), (240, 320)), Some(Resampled { warning: None }));
        let warning = find((120, 160), (240, 320)).and_then(|found| found.warning).unwrap();
        assert!(warning.contains("map: resized from 160x120 to 320x240"), "{warning}");
        assert_eq!(find((100, 320), (240, 320)), None);
    }
}
