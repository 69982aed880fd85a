//! Scenes of photographs with poses, in the files of other programs.

use crate::error::{Error, Result, text};
use crate::refiner::{Observer, Plan, Refiner};
use crate::scene::{CameraSource, GivenCamera, KnownCamera, Photograph, Scene};
use mde_mvs::capture::{CaptureFiles, Distortion, Lens};
use mde_prior::photo::{image_size, read_image};
use mde_prior::pixels::{Pixels, Recent};
use std::path::{Path, PathBuf};

impl Refiner<'_> {
    /// The scene of a capture with its poses, cameras and lenses, and its plan: of `image`, the reference, and its nearest neighbours, or
    /// without one of all photographs. A photograph that can't be read is left out unless it is `image`. `files` are those of `path`; `given` is the camera for files that have none.
    ///
    /// # Errors
    /// [`Error::Argument`] for files that are no capture of the image or need too much memory, and for a photograph that does not fit its
    /// camera; [`Error::Prior`] for one that can't be read; those of [`Photograph::resized`] and [`Scene::several`].
    pub fn capture(
        &self,
        (files, path): (&CaptureFiles, &Path),
        image: Option<&Path>,
        given: &GivenCamera,
        seen: &mut dyn Observer,
    ) -> Result<(Scene, Plan)> {
        let source = path.display().to_string();
        let flag = if image.is_some() { "{views} " } else { "" };
        let fault = |error: mde_mvs::capture::Error| {
            let (text, place) = (text(&error), format!("{source}: "));
            // Most of them name the file.
            Error::Argument(format!("{flag}{}{text}", if text.starts_with(&source) { "" } else { &place }))
        };
        let mut lens = None;
        if let Some(first) = files.first_photograph().map_err(fault)? {
            let shown = image.unwrap_or(&first);
            let size = image_size(shown).ok_or_else(|| {
                Error::Argument(format!("{}: no readable image; check the path", shown.display()))
            })?;
            let camera = KnownCamera::new(given, None, size)?.camera;
            lens = Some(Lens { camera, distortion: Distortion::default() });
        }
        let capture = files.read(lens.as_ref(), &|path| image_size(path)).map_err(fault)?;
        let count = capture.frames.len();
        let (reference, order) = match image {
            Some(image) => {
                let reference = capture.position(image).map_err(fault)?;
                // All of a long capture would not fit into memory; its neighbours in space see the same.
                (reference, capture.nearest(reference, 4 * self.settings.config.multi_view.max_views))
            }
            None => (0, (0..count).collect()),
        };
        let (nearest, size) = (order.len(), capture.frames[reference].lens.camera.dim());
        let plan = self.plan(&format!("{flag}{source}: {nearest} photographs"), size, nearest)?;
        let (mut photographs, mut first, recent) = (Vec::new(), None, Recent::default());
        let lost = |path: &PathBuf| {
            (path.display().to_string(), format!("{}: no readable photograph", path.display()))
        };
        let mut unreadable: Vec<_> = capture.unreadable.iter().map(lost).collect();
        for &index in &order {
            let (frame, sizes) = (capture.frames[index].clone(), self.settings.sizes);
            let name = frame.photograph.display().to_string();
            let open = move || {
                let fault = |error| format!("{}: {}", frame.photograph.display(), text(&error));
                let view = frame.view(read_image(&frame.photograph)?.pixels.view());
                view.map_err(|error| mde_prior::Error::Input(fault(error)))
            };
            let view = match open() {
                Ok(view) => view,
                Err(mde_prior::Error::Input(fault)) => return Err(Error::Argument(fault)),
                Err(error) if image.is_none() || index != reference => {
                    unreadable.push((name, text(&error)));
                    continue;
                }
                Err(error) => return Err(error.into()),
            };
            let camera = KnownCamera { camera: view.camera, source: CameraSource::File(source.clone()) };
            let (mask, pose) = (view.mask, Some(view.pose));
            let photograph = Photograph { mask, pose, ..Photograph::new(name, view.image, camera) };
            let mut one = photograph.resized(&sizes, true, &mut |text| seen.warn(text))?;
            let again = move || Ok(sizes.refined(open()?.image));
            one.image = Pixels::in_file(one.image.read()?, (&recent, one.name.clone()), again);
            photographs.push(one);
            first = first.or(Some(index));
        }
        let (scene, _) = scene_of(photographs, unreadable, seen)?;
        if nearest < count {
            seen.warn(format!("{{views}}: the {nearest} nearest of {count} photographs are considered"));
        }
        let shown =
            capture.points.iter().filter(|point| first.is_some_and(|first| point.frames.contains(&first)));
        let points = shown.map(|point| point.position).collect();
        Ok((Scene { points, ..scene }, plan))
    }
}

/// The scene of the different pictures, by their file names where those are unique, and which these are. Warns of copies and unreadable ones.
///
/// # Errors
/// The fault of a photograph where fewer than two could be read, and those of [`Scene::several`].
pub fn scene_of(
    mut photographs: Vec<Photograph>,
    unreadable: Vec<(String, String)>,
    seen: &mut dyn Observer,
) -> Result<(Scene, Vec<bool>)> {
    let short = |one: &Photograph| {
        Path::new(&one.name)
            .file_name()
            .map_or_else(|| one.name.clone(), |n| n.to_string_lossy().into_owned())
    };
    let names: Vec<String> = photographs.iter().map(short).collect();
    for (photograph, name) in photographs.iter_mut().zip(&names) {
        if names.iter().filter(|other| *other == name).count() == 1 {
            photograph.name.clone_from(name);
        }
    }
    if let ([] | [_], [(_, error), ..]) = (&*photographs, &*unreadable) {
        return Err(Error::Argument(error.clone()));
    }
    unreadable.iter().for_each(|(_, error)| seen.warn(format!("{error}; left out")));
    // Photographs of one lens share their mask.
    for index in 1..photographs.len() {
        let (before, rest) = photographs.split_at_mut(index);
        if rest[0].mask == before[index - 1].mask {
            rest[0].mask = before[index - 1].mask.clone();
        }
    }
    let contents: Vec<_> = photographs.iter().map(|one| one.image.content().ok()).collect();
    let pixels = |index: usize| photographs[index].image.read().ok();
    let same = |index: usize| {
        let is_same = |&other: &usize| contents[other] == contents[index] && pixels(other) == pixels(index);
        (0..index).find(is_same).map(|other| &photographs[other].name)
    };
    let copies: Vec<_> = (0..photographs.len()).map(same).collect();
    for (photograph, other) in photographs.iter().zip(&copies) {
        if let Some(other) = other {
            seen.warn(format!("{}: the same picture as {other}; counted once", photograph.name));
        }
    }
    // Copies of one picture are refused later, for want of parallax.
    let alone = copies.iter().filter(|other| other.is_none()).count() < 2;
    let kept: Vec<bool> = copies.iter().map(|other| alone || other.is_none()).collect();
    let photographs = photographs.into_iter().zip(&kept).filter(|(_, kept)| **kept).map(|(one, _)| one);
    Ok((Scene { unreadable, ..Scene::several(photographs.collect())? }, kept))
}
