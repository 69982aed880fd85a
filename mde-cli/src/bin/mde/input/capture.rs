//! The further photographs that the command line names.

use crate::args::RefineArgs;
use crate::input::camera::{CameraSource, KnownCamera};
use crate::input::opened::{Opened, open_image};
use crate::run::progress::Progress;
use anyhow::{Context, Result, bail, ensure};
use mde_cli::{Capture, Config, Photograph};
use ndarray::Array2;
use std::ffi::OsStr;
use std::path::{Path, PathBuf};

/// Names of photographs within a folder.
const PHOTOGRAPHS: [&str; 7] = ["jpg", "jpeg", "png", "tif", "tiff", "bmp", "webp"];

/// The capture of `--views`, or nothing without it. The reference is the command's photograph.
pub(crate) fn open(
    args: &RefineArgs,
    reference: (&Opened, &KnownCamera),
    config: &Config,
    progress: &mut Progress,
) -> Result<Option<Capture>> {
    if args.views.is_empty() {
        return Ok(None);
    }
    let paths = further(&args.image, &args.views)?;
    let (opened, camera) = reference;
    let mut photographs = vec![photograph(&args.image, opened, camera)];
    for path in &paths {
        let opened = open_image(path, &args.size, config, progress)?;
        let camera = KnownCamera::new(&args.camera, opened.photo.focal_35mm, &opened)
            .with_context(|| path.display().to_string())?;
        photographs.push(photograph(path, &opened, &camera));
    }
    name_apart(&mut photographs, &args.image, &paths);
    let capture = Capture { photographs, reference: 0 };
    capture.validate()?;
    Ok(Some(capture))
}

fn photograph(path: &Path, opened: &Opened, camera: &KnownCamera) -> Photograph {
    Photograph {
        name: path.file_name().unwrap_or(path.as_os_str()).to_string_lossy().into_owned(),
        image: opened.photo.pixels.clone(),
        mask: Array2::from_elem(opened.size, true),
        camera: camera.camera,
        focal_assumed: matches!(camera.source, CameraSource::Assumed(_)),
        pose: None,
    }
}

/// Photographs of one name in two folders get the whole path.
fn name_apart(photographs: &mut [Photograph], reference: &Path, others: &[PathBuf]) {
    let names: Vec<String> = photographs.iter().map(|p| p.name.clone()).collect();
    let paths = std::iter::once(reference).chain(others.iter().map(PathBuf::as_path));
    for ((photograph, path), name) in photographs.iter_mut().zip(paths).zip(&names) {
        if names.iter().filter(|other| *other == name).count() > 1 {
            photograph.name = path.display().to_string();
        }
    }
}

/// The photographs of files and folders but for the reference, each once, folders in the order of their names.
fn further(reference: &Path, views: &[PathBuf]) -> Result<Vec<PathBuf>> {
    let same = |a: &Path, b: &Path| match (a.canonicalize(), b.canonicalize()) {
        (Ok(a), Ok(b)) => a == b,
        _ => a == b,
    };
    let mut paths: Vec<PathBuf> = Vec::new();
    for view in views {
        let found = if view.is_dir() { in_folder(view)? } else { vec![view.clone()] };
        for path in found {
            ensure!(
                path.is_file(),
                "--views {}: there is no such photograph; give files or a folder",
                path.display()
            );
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
