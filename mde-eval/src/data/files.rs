use crate::{Error, Result};
use mde_prior::format::{ReadOptions, read_depth};
use mde_prior::photo::read_image;
use ndarray::{Array2, Array3};
use serde::de::DeserializeOwned;
use std::fs;
use std::path::{Path, PathBuf};

/// Folders nested deeper than this are not searched (links may make circles).
const MAX_DEPTH: usize = 12;

/// Folders at or below `root` that `is_scene`, by path; a scene is not searched for others within it.
pub(super) fn find_scenes(root: &Path, is_scene: impl Fn(&Path) -> bool) -> Result<Vec<PathBuf>> {
    let mut found = Vec::new();
    walk(root, |folder| {
        let scene = is_scene(folder);
        if scene {
            found.push(folder.to_owned());
        }
        Ok(!scene)
    })?;
    found.sort();
    Ok(found)
}

/// Calls `visit` with `root` and the folders below it; it returns whether to search within.
pub(super) fn walk(root: &Path, mut visit: impl FnMut(&Path) -> Result<bool>) -> Result<()> {
    let mut left = vec![(root.to_owned(), 0)];
    while let Some((folder, depth)) = left.pop() {
        if visit(&folder)? && depth < MAX_DEPTH {
            let below = entries(&folder)?.into_iter().filter(|path| path.is_dir());
            left.extend(below.map(|path| (path, depth + 1)));
        }
    }
    Ok(())
}

/// What is in a folder, by name.
pub(super) fn entries(folder: &Path) -> Result<Vec<PathBuf>> {
    let paths = fs::read_dir(folder).and_then(|found| found.map(|entry| Ok(entry?.path())).collect());
    let mut paths: Vec<PathBuf> = paths.map_err(|source| Error::Io { path: folder.to_owned(), source })?;
    paths.sort();
    Ok(paths)
}

/// The files of a folder with one of the extensions (lower case), by name; hidden ones left out.
pub(super) fn files_with(folder: &Path, extensions: &[&str]) -> Result<Vec<PathBuf>> {
    let fits = |path: &PathBuf| {
        let extension = path.extension().and_then(|e| e.to_str()).unwrap_or_default().to_ascii_lowercase();
        !is_hidden(path) && extensions.contains(&extension.as_str()) && path.is_file()
    };
    Ok(entries(folder)?.into_iter().filter(fits).collect())
}

/// Whether a name begins with a dot, or is no text.
pub(super) fn is_hidden(path: &Path) -> bool {
    path.file_name().and_then(|name| name.to_str()).is_none_or(|name| name.starts_with('.'))
}

/// The sources of scenes, such as their folders, with their identifiers.
#[derive(Debug, Clone)]
pub(super) struct Scenes<S = PathBuf> {
    pub(super) ids: Vec<String>,
    pub(super) sources: Vec<S>,
}

impl<S> FromIterator<(String, S)> for Scenes<S> {
    fn from_iter<I: IntoIterator<Item = (String, S)>>(scenes: I) -> Self {
        let (ids, sources) = scenes.into_iter().unzip();
        Self { ids, sources }
    }
}

impl<S> Scenes<S> {
    pub(super) fn get(&self, index: usize) -> Result<(&S, &str)> {
        let scene = self.sources.get(index).zip(self.ids.get(index).map(String::as_str));
        scene.ok_or(Error::Scene { index, count: self.ids.len() })
    }
}

impl Scenes {
    /// The folders at or below `root`, which holds no `what` without any.
    pub(super) fn find(root: &Path, is_scene: impl Fn(&Path) -> bool, what: &str) -> Result<Self> {
        let folders = find_scenes(root, is_scene)?;
        if folders.is_empty() {
            return Err(layout(root, format!("holds no {what}")));
        }
        Ok(folders.into_iter().map(|scene| (id(root, &scene), scene)).collect())
    }
}

/// The error of a file or folder.
pub(super) fn layout(path: &Path, reason: impl Into<String>) -> Error {
    Error::Layout { path: path.to_owned(), reason: reason.into() }
}

/// The text of a file.
pub(super) fn read_text(path: &Path) -> Result<String> {
    fs::read_to_string(path).map_err(|source| Error::Io { path: path.to_owned(), source })
}

/// The value of a JSON file.
pub(super) fn read_json<T: DeserializeOwned>(path: &Path) -> Result<T> {
    serde_json::from_str(&read_text(path)?).map_err(|fault| layout(path, format!("is not valid: {fault}")))
}

/// The one file of a folder with one of the extensions and, where it is given, that stem.
pub(super) fn only_file(folder: &Path, stem: Option<&str>, extensions: &[&str]) -> Result<PathBuf> {
    if !folder.is_dir() {
        return Err(layout(folder, "the scene has no such folder"));
    }
    let fits = |path: &PathBuf| stem.is_none_or(|stem| path.file_stem().is_some_and(|own| own == stem));
    let files: Vec<_> = files_with(folder, extensions)?.into_iter().filter(fits).collect();
    match files.as_slice() {
        [file] => Ok(file.clone()),
        _ => {
            let (count, endings, stem) = (files.len(), extensions.join(", ."), stem.unwrap_or("*"));
            Err(layout(folder, format!("holds {count} files named {stem} (.{endings}) where one is needed")))
        }
    }
}

/// A scene's identifier: its path below the root with `/`, or the root's own name.
pub(super) fn id(root: &Path, scene: &Path) -> String {
    let below = scene.strip_prefix(root).unwrap_or(scene);
    let parts: Vec<_> = below.components().map(|c| c.as_os_str().to_string_lossy()).collect();
    if parts.is_empty() {
        return root.file_name().map_or_else(|| "scene".into(), |name| name.to_string_lossy().into_owned());
    }
    parts.join("/")
}

/// An image `[height, width, 3]` with the depth map of its pixels.
pub(super) fn read_pair(
    image: &Path,
    depth: &Path,
    options: &ReadOptions,
) -> Result<(Array3<f32>, Array2<f32>)> {
    let (image, map) = (read_image(image)?.pixels, read_depth(depth, options)?);
    same_size(depth, map.dim(), image.dim())?;
    Ok((image, map))
}

/// Checks that depth and image are of one size.
pub(super) fn same_size(
    path: &Path,
    depth: (usize, usize),
    (height, width, _): (usize, usize, usize),
) -> Result<()> {
    if depth == (height, width) {
        return Ok(());
    }
    let reason = format!(
        "the depth is {}x{} but the image is {width}x{height} (width x height); they must be registered to each other",
        depth.1, depth.0
    );
    Err(layout(path, reason))
}
