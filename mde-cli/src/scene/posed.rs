//! Scenes of photographs in the files of other programs.

use crate::error::{Error, Result, text};
use crate::scene::camera::{CameraSource, KnownCamera};
use crate::scene::size::Sizes;
use crate::scene::{Photograph, Scene};
use mde_mvs::capture::PosedCapture;
use mde_prior::photo::read_image;
use std::path::Path;

impl Scene {
    /// Photographs with the poses, cameras and lenses of a capture, the first of `order` the reference; `source` names the capture. Other
    /// sizes are reported to `warn`.
    ///
    /// # Errors
    /// [`Error::Prior`] for a photograph that can't be read, [`Error::Argument`] for one that does not fit its camera, and those of
    /// [`Photograph::resized`] and [`Scene::several`].
    pub fn posed(
        capture: &PosedCapture,
        order: &[usize],
        source: &Path,
        sizes: &Sizes,
        warn: &mut dyn FnMut(String),
    ) -> Result<Self> {
        let mut photographs = Vec::new();
        for &index in order {
            let frame = &capture.frames[index];
            let name = frame.photograph.display().to_string();
            let pixels = read_image(&frame.photograph)?.pixels;
            let view = frame
                .view(pixels.view())
                .map_err(|error| Error::Argument(format!("{name}: {}", text(&error))))?;
            let source = CameraSource::File(source.display().to_string());
            let camera = KnownCamera { camera: view.camera, source };
            let mut photograph = Photograph::new(name, view.image, camera);
            (photograph.mask, photograph.pose) = (view.mask, Some(view.pose));
            photographs.push(photograph.resized(sizes, true, warn)?);
        }
        shorten(&mut photographs);
        if order.len() < capture.frames.len() {
            let (nearest, all) = (order.len(), capture.frames.len());
            warn(format!("{{views}}: the {nearest} nearest of {all} photographs are considered"));
        }
        let seen = |frames: &[usize]| order.first().is_some_and(|first| frames.contains(first));
        let shown = capture.points.iter().filter(|point| seen(&point.frames));
        let points = shown.map(|point| point.position).collect();
        Ok(Self { points, ..Self::several(photographs, 0)? })
    }
}

/// File names instead of paths where they are unique.
pub fn shorten(photographs: &mut [Photograph]) {
    let short = |name: &str| {
        Path::new(name).file_name().map_or_else(|| name.to_owned(), |n| n.to_string_lossy().into_owned())
    };
    let names: Vec<String> = photographs.iter().map(|p| short(&p.name)).collect();
    for (photograph, name) in photographs.iter_mut().zip(&names) {
        if names.iter().filter(|other| *other == name).count() == 1 {
            photograph.name.clone_from(name);
        }
    }
}
