//! Scenes that the command line names: one photograph, or several with poses or without.

use crate::program::args::{CameraArgs, RefineArgs};
use crate::program::open::photographs::existing;
use crate::program::open::settings::camera;
use crate::program::progress::Progress;
use crate::refiner::{Observer, Plan, Refiner, Unit};
use crate::scene::posed::shorten;
use crate::scene::{Photograph, Scene};
use anyhow::{Context, Result, ensure};
use mde_mvs::capture::{CaptureFiles, Distortion, Lens, PosedCapture, same_file};
use mde_prior::photo::{Photo, image_size, read_image};
use std::path::{Path, PathBuf};

/// `(height, width)` of a photograph, by its header alone.
pub(crate) fn size(path: &Path) -> (usize, usize) {
    // What has no header has no size, and is refused when it is decoded.
    image_size(path).map_or((1, 1), |[width, height]| (height, width))
}

/// A photograph alone and its plan; at the size of the refinement where it is as one of `several`.
pub(crate) fn one(
    refiner: &Refiner<'_>,
    args: &CameraArgs,
    path: &Path,
    several: bool,
    progress: &mut Progress,
) -> Result<(Scene, Plan)> {
    let plan = refiner.plan(&path.display().to_string(), size(path), 1)?;
    let photograph = photograph(refiner, args, path, read_image(path)?, several, progress)?;
    Ok((Scene::one(photograph), plan))
}

/// A photograph at its size; one of `several`, or alone.
pub(crate) fn photograph(
    refiner: &Refiner<'_>,
    args: &CameraArgs,
    path: &Path,
    photo: Photo,
    several: bool,
    progress: &mut Progress,
) -> Result<Photograph> {
    let (height, width, _) = photo.pixels.dim();
    let camera = camera(args, photo.focal_35mm, [width, height])?;
    Ok(refiner.photograph(&path.display().to_string(), photo.pixels, camera, several, progress)?)
}

/// The photographs of IMAGE and `--views`, IMAGE first, and their plan.
pub(crate) fn several(
    refiner: &Refiner<'_>,
    args: &RefineArgs,
    progress: &mut Progress,
) -> Result<(Scene, Plan)> {
    if let [one] = args.several.views.as_slice()
        && let Some(capture) = capture(one, args)?
    {
        return posed(refiner, args, &capture, progress);
    }
    ensure!(
        refiner.settings().unit == Unit::Prior,
        "--unit capture: the photographs have no poses of their own, so there is no unit but the prior's; give a capture with poses, or \
         --unit prior"
    );
    let mut paths = vec![args.image.clone()];
    paths.extend(further(&args.image, &args.several.views)?);
    unposed(refiner, &args.camera, "--views", &paths, progress)
}

/// Photographs without poses, the first the reference; `flag` gave them.
pub(crate) fn unposed(
    refiner: &Refiner<'_>,
    args: &CameraArgs,
    flag: &str,
    paths: &[PathBuf],
    progress: &mut Progress,
) -> Result<(Scene, Plan)> {
    let first = paths.first().context("there is no photograph; give one")?;
    let plan = refiner.plan(&format!("{flag}: {} photographs", paths.len()), size(first), paths.len())?;
    let mut photographs = Vec::new();
    for path in paths {
        photographs.push(photograph(refiner, args, path, read_image(path)?, true, progress)?);
    }
    shorten(&mut photographs);
    Ok((Scene::several(photographs, 0)?, plan))
}

/// The capture with poses, or nothing where the path is none.
fn capture(path: &Path, args: &RefineArgs) -> Result<Option<PosedCapture>> {
    let Some(files) = CaptureFiles::find(path) else { return Ok(None) };
    let mut lens = None;
    if files.needs_lens() {
        let first = image_size(&args.image)
            .with_context(|| format!("{}: no readable image; check the path", args.image.display()))?;
        let camera = camera(&args.camera, None, first)?.camera;
        lens = Some(Lens { camera, distortion: Distortion::default() });
    }
    let capture = files.read(lens.as_ref(), &|path| image_size(path));
    Ok(Some(capture.with_context(|| format!("--views {}", path.display()))?))
}

/// Photographs with the poses, cameras and lenses of a capture.
fn posed(
    refiner: &Refiner<'_>,
    args: &RefineArgs,
    capture: &PosedCapture,
    progress: &mut Progress,
) -> Result<(Scene, Plan)> {
    let reference = capture.position(&args.image)?;
    let frames = &capture.frames;
    // All of a long capture would not fit into memory; its neighbours in space see the same.
    let most =
        if args.several.all { frames.len() } else { 4 * refiner.settings().config.multi_view.max_views };
    let order = capture.nearest(reference, most);
    let plan =
        refiner.plan(&format!("--views: {} photographs", order.len()), size(&args.image), order.len())?;
    let mut warn = |warning| progress.warn(warning);
    let sizes = &refiner.settings().sizes;
    Ok((Scene::posed(capture, &order, &args.several.views[0], sizes, &mut warn)?, plan))
}

/// The photographs of files and folders but for the reference, each once, folders in the order of their names.
fn further(reference: &Path, views: &[PathBuf]) -> Result<Vec<PathBuf>> {
    let mut paths = existing("--views", views)?;
    paths.retain(|path| !same_file(path, reference));
    let shown = reference.display();
    ensure!(!paths.is_empty(), "--views: no photograph but {shown} is there; give one or more others");
    Ok(paths)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_folder_gives_its_photographs_in_order_without_the_reference() {
        let folder = tempfile::tempdir().unwrap();
        for name in ["b.png", "a.JPG", "c.txt", "d.jpeg"] {
            std::fs::write(folder.path().join(name), "").unwrap();
        }
        let reference = folder.path().join("b.png");
        let views = [folder.path().to_owned(), folder.path().join("a.JPG")];
        let names: Vec<_> = further(&reference, &views).unwrap();
        assert_eq!(names, [folder.path().join("a.JPG"), folder.path().join("d.jpeg")]);
        let alone = further(&reference, std::slice::from_ref(&reference)).unwrap_err().to_string();
        assert!(alone.contains("one or more others"), "{alone}");
        let missing = further(&reference, &[folder.path().join("x.png")]).unwrap_err().to_string();
        assert!(missing.contains("x.png"), "{missing}");
    }
}
