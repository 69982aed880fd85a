//! The further photographs that the command line names, with poses or without.

use crate::program::args::{PosesArgs, RefineArgs, SizeArgs, UnitName};
use crate::program::open::camera;
use crate::program::open::camera::{CameraSource, KnownCamera};
use crate::program::open::opened::Opening;
use crate::program::open::photographs::in_folder;
use crate::program::open::size::{check_memory, sizes};
use crate::program::progress::Progress;
use anyhow::{Context, Result, bail, ensure};
use crate::scene::photograph::Opened;
use crate::refiner::plan::capture_bytes;
use crate::several::{Capture, Photograph};
use crate::config::Config;
use mde_mvs::capture::{Capture as Posed, CaptureFiles, Distortion, Lens, same_file};
use mde_prior::photo::image_size;
use ndarray::Array2;
use std::path::{Path, PathBuf};

/// The capture of `--views`, or nothing without it. The command's photograph is the reference, which changes where the
/// capture has other intrinsics or lens distortion for it.
pub(crate) fn open(
    args: &RefineArgs,
    reference: &mut Opened,
    config: &Config,
    progress: &mut Progress,
) -> Result<Option<Capture>> {
    let estimated = "--unit capture: the photographs have no poses of their own, so there is no unit but the prior's; give a \
                     capture with poses, or --unit prior";
    let capture = match args.several.views.as_slice() {
        [] => return Ok(None),
        [one] => match read(one, args)? {
            Some(capture) => posed(args, &capture, reference, config, progress)?,
            None => unposed(args, reference, config, progress)?,
        },
        _ => unposed(args, reference, config, progress)?,
    };
    capture.validate()?;
    let posed = capture.photographs.iter().all(|photograph| photograph.pose.is_some());
    ensure!(posed || args.several.unit == UnitName::Prior, estimated);
    let first = &capture.photographs[capture.reference];
    if first.pose.is_some() {
        reference.image = first.image.clone();
        reference.camera = KnownCamera {
            camera: first.camera,
            source: CameraSource::File(args.several.views[0].display().to_string()),
        };
    }
    Ok(Some(capture))
}

/// The capture with poses, or nothing where the path is none.
fn read(path: &Path, args: &RefineArgs) -> Result<Option<Posed>> {
    let Some(files) = CaptureFiles::find(path) else { return Ok(None) };
    let mut lens = None;
    if files.needs_lens() {
        let first = image_size(&args.image)
            .with_context(|| format!("{}: no readable image; check the path", args.image.display()))?;
        let camera = camera::of_size(&args.camera, None, first)?.camera;
        lens = Some(Lens { camera, distortion: Distortion::default() });
    }
    let capture = files.read(lens.as_ref(), &|path| image_size(path));
    Ok(Some(capture.with_context(|| format!("--views {}", path.display()))?))
}

/// Photographs with the poses of a file.
fn posed(
    args: &RefineArgs,
    capture: &Posed,
    opened: &Opened,
    config: &Config,
    progress: &mut Progress,
) -> Result<Capture> {
    let reference = capture.position(&args.image)?;
    let frames = &capture.frames;
    // All of a long capture would not fit into memory; its neighbours in space see the same.
    let most = if args.several.all { frames.len() } else { 4 * config.multi_view.max_views };
    let order = capture.nearest(reference, most);
    check(args, opened, order.len(), config)?;
    let mut photographs = Vec::new();
    for &index in &order {
        let frame = &frames[index];
        let opened = mde_prior::photo::read_image(&frame.photograph)?;
        let view =
            frame.view(opened.pixels.view()).with_context(|| frame.photograph.display().to_string())?;
        let (height, width) = view.mask.dim();
        let sizes = sizes(&args.size);
        let (to_height, to_width) = sizes.of_refinement(sizes.of_results((height, width)));
        let (image, camera, mask) = if (to_height, to_width) == (height, width) {
            (view.image, view.camera, view.mask)
        } else {
            let mask = mde_prior::resample::nearest(view.mask.view(), (to_height, to_width));
            let image = crate::scene::size::shrink(&view.image, (to_height, to_width));
            (image, view.camera.resized(to_width, to_height)?, mask)
        };
        photographs.push(Photograph {
            name: frame.photograph.display().to_string(),
            image,
            mask,
            camera,
            focal_assumed: false,
            pose: Some(view.pose),
        });
    }
    shorten(&mut photographs);
    if order.len() < frames.len() {
        progress.warn(format!(
            "--views: the {} nearest of {} photographs are considered",
            order.len(),
            frames.len()
        ));
    }
    let shown = capture.points.iter().filter(|point| point.frames.contains(&reference));
    let points = shown.map(|point| point.position).collect();
    Ok(Capture { photographs, reference: 0, points })
}

/// Photographs alone.
fn unposed(args: &RefineArgs, opened: &Opened, config: &Config, progress: &mut Progress) -> Result<Capture> {
    let paths = further(&args.image, &args.several.views)?;
    check(args, opened, 1 + paths.len(), config)?;
    let mut photographs = vec![photograph(&args.image, opened)];
    let opening = Opening { size: &args.size, camera: &args.camera, several: true };
    for path in paths {
        photographs.push(photograph(&path, &opening.open(&path, progress)?));
    }
    shorten(&mut photographs);
    Ok(Capture { photographs, reference: 0, points: Vec::new() })
}

/// Refuses more photographs of the reference's size than the memory limit allows.
fn check(args: &RefineArgs, opened: &Opened, photographs: usize, config: &Config) -> Result<()> {
    let threads = rayon::current_num_threads() as u64;
    check_memory(&args.size.memory, &format!("--views: {photographs} photographs"), opened.size(), |pixels| {
        capture_bytes(pixels, photographs as u64, threads, config)
    })
}

/// The file of a photograph and its size there, `[width, height]`.
pub(crate) type SourceFile = (PathBuf, [usize; 2]);

/// Photographs without poses, the first the reference.
pub(crate) fn photographs(
    args: &PosesArgs,
    size: &SizeArgs,
    config: &Config,
    progress: &mut Progress,
) -> Result<(Capture, Vec<SourceFile>, Opened)> {
    let paths = unique("PHOTO", &args.photographs, |_| false)?;
    ensure!(
        paths.len() > 1,
        "{}: one photograph has no parallax; give two or more, or a folder of them",
        paths.first().unwrap_or(&PathBuf::new()).display()
    );
    let (mut photographs, mut files, mut first) = (Vec::new(), Vec::new(), None);
    let count = paths.len() as u64;
    let opening = Opening { size, camera: &args.camera, several: true };
    for path in paths {
        let opened = opening.open(&path, progress)?;
        if first.is_none() {
            let (what, threads) =
                (format!("PHOTO: {count} photographs"), rayon::current_num_threads() as u64);
            check_memory(&size.memory, &what, opened.size(), |pixels| {
                capture_bytes(pixels, count, threads, config)
            })?;
        }
        photographs.push(photograph(&path, &opened));
        files.push((path, [opened.original.1, opened.original.0]));
        first.get_or_insert(opened);
    }
    shorten(&mut photographs);
    let capture = Capture { photographs, reference: 0, points: Vec::new() };
    capture.validate()?;
    let first = first.context("no photograph; give two or more")?;
    Ok((capture, files, first))
}

fn photograph(path: &Path, opened: &Opened) -> Photograph {
    Photograph {
        name: path.display().to_string(),
        image: opened.image.clone(),
        mask: Array2::from_elem(opened.size(), true),
        camera: opened.camera.camera,
        focal_assumed: opened.camera.is_assumed(),
        pose: None,
    }
}

/// File names instead of paths where they are unique.
fn shorten(photographs: &mut [Photograph]) {
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

/// The photographs of files and folders but for the reference, each once, folders in the order of their names.
fn further(reference: &Path, views: &[PathBuf]) -> Result<Vec<PathBuf>> {
    let paths = unique("--views", views, |path| same_file(path, reference))?;
    if paths.is_empty() {
        bail!("--views: no photograph but {} is there; give one or more others", reference.display());
    }
    Ok(paths)
}

/// The photographs of files and folders, each once, without those that `skip` names; `flag` gave them.
fn unique(flag: &str, views: &[PathBuf], skip: impl Fn(&Path) -> bool) -> Result<Vec<PathBuf>> {
    let mut paths: Vec<PathBuf> = Vec::new();
    for view in views {
        let found = if view.is_dir() { in_folder(flag, view)? } else { vec![view.clone()] };
        for path in found {
            ensure!(path.is_file(), "{flag} {}: no such photograph; give files or a folder", path.display());
            if !skip(&path) && !paths.iter().any(|known| same_file(known, &path)) {
                paths.push(path);
            }
        }
    }
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
