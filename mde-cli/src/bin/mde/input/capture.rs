//! The further photographs that the command line names, with poses or without.

use crate::args::RefineArgs;
use crate::input::camera::{CameraSource, KnownCamera};
use crate::input::opened::{Opened, open_image};
use crate::run::progress::Progress;
use anyhow::{Context, Result, bail, ensure};
use mde_cli::{Capture, Config, Photograph};
use mde_mvs::capture::{Distortion, Frame, Lens, PixelCentres, read_colmap, read_transforms, read_tum};
use mde_prior::photo::image_size;
use ndarray::Array2;
use std::ffi::OsStr;
use std::path::{Path, PathBuf};

/// Extensions of photographs within a folder.
const PHOTOGRAPHS: [&str; 7] = ["jpg", "jpeg", "png", "tif", "tiff", "bmp", "webp"];

/// The capture of `--views`, or nothing without it. The command's photograph is the reference; its image and camera change where the
/// capture has other intrinsics or lens distortion for it.
pub(crate) fn open(
    args: &RefineArgs,
    reference: &mut Opened,
    camera: &mut KnownCamera,
    config: &Config,
    progress: &mut Progress,
) -> Result<Option<Capture>> {
    let capture = match args.views.as_slice() {
        [] => return Ok(None),
        [one] => match frames(one, args)? {
            Some(frames) => posed(args, frames, config, progress)?,
            None => unposed(args, reference, camera, config, progress)?,
        },
        _ => unposed(args, reference, camera, config, progress)?,
    };
    capture.validate()?;
    let first = &capture.photographs[capture.reference];
    if first.pose.is_some() {
        reference.photo.pixels = first.image.clone();
        *camera = KnownCamera { camera: first.camera, source: CameraSource::File(args.views[0].clone()) };
    }
    Ok(Some(capture))
}

/// The frames of a capture with poses, or nothing where the path is none.
fn frames(path: &Path, args: &RefineArgs) -> Result<Option<Vec<Frame>>> {
    let size = |path: &Path| image_size(path);
    let within = |name: &str| path.join(name).is_file();
    let read = if path.is_file() && path.extension() == Some(OsStr::new("json")) {
        read_transforms(path, PixelCentres::Integers, &size)
    } else if within("transforms.json") {
        read_transforms(&path.join("transforms.json"), PixelCentres::Integers, &size)
    } else if let Some((model, images)) = colmap_model(path) {
        read_colmap(&model, &images, &size)
    } else if within("groundtruth.txt") && within("rgb.txt") {
        let first = image_size(&args.image)
            .with_context(|| format!("{}: no readable image; check the path", args.image.display()))?;
        let camera = KnownCamera::of_size(&args.camera, None, first)?.camera;
        read_tum(path, &Lens { camera, distortion: Distortion::default() }, &size)
    } else {
        return Ok(None);
    };
    Ok(Some(read.with_context(|| format!("--views {}", path.display()))?.frames))
}

/// Folder of a COLMAP model and of its photographs: `DIR` or `DIR/sparse/0`, beside `DIR/images`.
fn colmap_model(path: &Path) -> Option<(PathBuf, PathBuf)> {
    let is_model =
        |folder: &Path| ["cameras.bin", "cameras.txt"].iter().any(|name| folder.join(name).is_file());
    let images = |root: &Path| {
        let folder = root.join("images");
        if folder.is_dir() { folder } else { root.to_owned() }
    };
    let nested = path.join("sparse").join("0");
    if is_model(&nested) {
        return Some((nested, images(path)));
    }
    let root = match path.ends_with("sparse/0") {
        true => path.parent().and_then(Path::parent).unwrap_or(path),
        false => path,
    };
    is_model(path).then(|| (path.to_owned(), images(root)))
}

/// Photographs with the poses of a file.
fn posed(args: &RefineArgs, frames: Vec<Frame>, config: &Config, progress: &mut Progress) -> Result<Capture> {
    let Some(reference) = frames.iter().position(|frame| same(&frame.photograph, &args.image)) else {
        let some: Vec<String> = frames.iter().take(3).map(|f| f.photograph.display().to_string()).collect();
        bail!(
            "{}: not a photograph of this capture; give one of its {}, such as {}",
            args.image.display(),
            frames.len(),
            some.join(", ")
        );
    };
    // All of a long capture would not fit into memory; its neighbours in space see the same.
    let order = nearest(&frames, reference, 4 * config.multi_view.max_views);
    let mut photographs = Vec::new();
    for &index in &order {
        let frame = &frames[index];
        let opened = mde_prior::photo::read_image(&frame.photograph)?;
        let view =
            frame.view(opened.pixels.view()).with_context(|| frame.photograph.display().to_string())?;
        let (height, width) = view.mask.dim();
        let (to_height, to_width) = crate::input::size::within((height, width), args.size.max_size);
        let (image, camera, mask) = if (to_height, to_width) == (height, width) {
            (view.image, view.camera, view.mask)
        } else {
            let mask = mde_prior::resample::nearest(
                view.mask.mapv(|m| f32::from(u8::from(m))).view(),
                (to_height, to_width),
            );
            let image = crate::input::size::shrink(&view.image, (to_height, to_width));
            (image, view.camera.resized(to_width, to_height)?, mask.mapv(|m| m > 0.5))
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
    Ok(Capture { photographs, reference: 0 })
}

/// The reference, then the frames of the nearest camera centres.
fn nearest(frames: &[Frame], reference: usize, most: usize) -> Vec<usize> {
    let centre = |index: usize| frames[index].pose.inverse().translation.vector;
    let mut order: Vec<usize> = (0..frames.len()).collect();
    let key = |index: &usize| (*index != reference, (centre(*index) - centre(reference)).norm());
    order.sort_by(|a, b| {
        let (a, b) = (key(a), key(b));
        a.0.cmp(&b.0).then(a.1.total_cmp(&b.1))
    });
    order.truncate(most.max(2));
    order
}

/// Photographs alone.
fn unposed(
    args: &RefineArgs,
    opened: &Opened,
    camera: &KnownCamera,
    config: &Config,
    progress: &mut Progress,
) -> Result<Capture> {
    let mut photographs = vec![photograph(&args.image, opened, camera)];
    for path in further(&args.image, &args.views)? {
        let opened = open_image(&path, &args.size, config, progress)?;
        let camera = KnownCamera::new(&args.camera, opened.photo.focal_35mm, &opened)
            .with_context(|| path.display().to_string())?;
        photographs.push(photograph(&path, &opened, &camera));
    }
    shorten(&mut photographs);
    Ok(Capture { photographs, reference: 0 })
}

fn photograph(path: &Path, opened: &Opened, camera: &KnownCamera) -> Photograph {
    Photograph {
        name: path.display().to_string(),
        image: opened.photo.pixels.clone(),
        mask: Array2::from_elem(opened.size, true),
        camera: camera.camera,
        focal_assumed: matches!(camera.source, CameraSource::Assumed(_)),
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

fn same(a: &Path, b: &Path) -> bool {
    match (a.canonicalize(), b.canonicalize()) {
        (Ok(a), Ok(b)) => a == b,
        _ => a == b,
    }
}

/// The photographs of files and folders but for the reference, each once, folders in the order of their names.
fn further(reference: &Path, views: &[PathBuf]) -> Result<Vec<PathBuf>> {
    let mut paths: Vec<PathBuf> = Vec::new();
    for view in views {
        let found = if view.is_dir() { in_folder(view)? } else { vec![view.clone()] };
        for path in found {
            ensure!(path.is_file(), "--views {}: no such photograph; give files or a folder", path.display());
            if !same(&path, reference) && !paths.iter().any(|known| same(known, &path)) {
                paths.push(path);
            }
        }
    }
    if paths.is_empty() {
        bail!("--views: no photograph but {} is there; give one or more others", reference.display());
    }
    Ok(paths)
}

fn in_folder(folder: &Path) -> Result<Vec<PathBuf>> {
    let fault = || format!("--views {}: the folder can't be read; check the path", folder.display());
    let mut paths = Vec::new();
    for entry in std::fs::read_dir(folder).with_context(fault)? {
        let path = entry.with_context(fault)?.path();
        let is_photograph = path
            .extension()
            .and_then(OsStr::to_str)
            .is_some_and(|e| PHOTOGRAPHS.contains(&e.to_ascii_lowercase().as_str()));
        if is_photograph && path.is_file() {
            paths.push(path);
        }
    }
    paths.sort();
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
