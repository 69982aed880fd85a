//! Scenes that the command line names: one photograph, or several with poses or without.

use crate::program::open::{camera, existing, given_camera};
use crate::program::{CameraArgs, Progress};
use crate::refiner::capture::scene_of;
use crate::refiner::{Observer, Plan, Refiner, Unit};
use crate::scene::{Photograph, Scene};
use anyhow::{Context, Result, bail, ensure};
use mde_mvs::capture::{CaptureFiles, same_file};
use mde_prior::photo::{Photo, image_size, read_image};
use mde_prior::pixels::{Pixels, Recent};
use std::path::{Path, PathBuf};

/// `(height, width)` of a photograph, by its header alone.
pub(crate) fn size(path: &Path) -> (usize, usize) {
    // What has no header has no size, and is refused when it is decoded.
    image_size(path).map_or((1, 1), |[width, height]| (height, width))
}

/// How the photographs of a command are opened: for which refiner, with which camera, and where warnings go.
pub(crate) struct Opener<'a> {
    pub(crate) refiner: &'a Refiner<'a>,
    pub(crate) camera: &'a CameraArgs,
    pub(crate) progress: &'a mut Progress,
}

impl Opener<'_> {
    /// A photograph alone and its plan; at the size of the refinement where it is as one of `several`.
    pub(crate) fn one(&mut self, path: &Path, several: bool) -> Result<(Scene, Plan)> {
        let plan = self.refiner.plan(&path.display().to_string(), size(path), 1)?;
        Ok((Scene::one(self.photograph(path, read_image(path)?, several)?), plan))
    }

    /// A photograph at its size; one of `several`, or alone.
    pub(crate) fn photograph(&mut self, path: &Path, photo: Photo, several: bool) -> Result<Photograph> {
        let (height, width, _) = photo.pixels.dim();
        let camera = camera(self.camera, photo.focal_35mm, [width, height])?;
        let photograph = Photograph::new(path.display().to_string(), photo.pixels, camera);
        let mut warn = |warning| self.progress.warn(warning);
        Ok(photograph.resized(&self.refiner.settings().sizes, several, &mut warn)?)
    }

    /// Several photographs and their plan: those of a capture with the poses of its files, or files and folders without poses. The first is
    /// `image`, the others `--views`; without it all are those of CAPTURE.
    pub(crate) fn several(&mut self, image: Option<&Path>, views: &[PathBuf]) -> Result<(Scene, Plan)> {
        if let [one] = views
            && let Some(files) = CaptureFiles::find(one)
        {
            let given = given_camera(self.camera);
            return Ok(self.refiner.capture((&files, one), image, &given, self.progress)?);
        }
        let (flag, paths) = match (image, views) {
            (Some(image), _) => ("--views", [vec![image.to_owned()], further(image, views)?].concat()),
            (None, [one]) if !one.is_dir() => bail!(
                "{}: no capture; give a folder of photographs, a transforms.json, a COLMAP project or a TUM sequence",
                one.display()
            ),
            (None, _) => ("CAPTURE", existing("CAPTURE", views)?),
        };
        let (scene, plan, _) = self.unposed(flag, image, paths)?;
        Ok((scene, plan))
    }

    /// Photographs without poses that `flag` gave, the reference first, their plan and paths. Of unreadable ones only `image` is an error.
    pub(crate) fn unposed(
        &mut self,
        flag: &str,
        image: Option<&Path>,
        paths: Vec<PathBuf>,
    ) -> Result<(Scene, Plan, Vec<PathBuf>)> {
        ensure!(
            self.refiner.settings().unit == Unit::Prior,
            "--unit capture: the photographs have no poses of their own, so there is no unit but the prior's; give a capture with poses, or \
         --unit prior"
        );
        let first = paths.iter().find(|path| image_size(path).is_some()).or(paths.first());
        let first = first.context("there is no photograph; give one")?;
        let plan =
            self.refiner.plan(&format!("{flag}: {} photographs", paths.len()), size(first), paths.len())?;
        let (mut photographs, mut read, mut unreadable) = (Vec::new(), Vec::new(), Vec::new());
        let recent = Recent::default();
        for path in paths {
            match read_image(&path) {
                Ok(photo) => {
                    let mut one = self.photograph(&path, photo, true)?;
                    let (file, sizes) = (path.clone(), self.refiner.settings().sizes);
                    let again = move || Ok(sizes.refined(read_image(&file)?.pixels.into_shared()));
                    one.image = Pixels::in_file(one.image.read()?, (&recent, one.name.clone()), again);
                    photographs.push(one);
                    read.push(path);
                }
                Err(error) if image != Some(&path) => {
                    unreadable.push((path.display().to_string(), error.to_string()));
                }
                Err(error) => return Err(error.into()),
            }
        }
        let (scene, kept) = scene_of(photographs, unreadable, self.progress)?;
        let read = read.into_iter().zip(kept).filter(|(_, kept)| *kept).map(|(path, _)| path);
        Ok((scene, plan, read.collect()))
    }
}

/// The photographs of files and folders but for the reference, each once, folders in the order of their names.
fn further(reference: &Path, views: &[PathBuf]) -> Result<Vec<PathBuf>> {
    let mut paths = existing("--views", views)?;
    paths.retain(|path| !same_file(path, reference));
    let shown = reference.display();
    ensure!(!paths.is_empty(), "--views: no photograph but {shown} is there; give one or more others");
    Ok(paths)
}
