//! COLMAP's models: of one photograph with a thinned cloud, and the dense workspace of a capture.

use super::{IMAGE, RefinedView, subfolder};
use crate::error::Result;
use mde_mvs::capture::{colmap_view, colmap_workspace};
use mde_mvs::cloud::{ConsistentPoint, DepthView};
use mde_prior::photo::write_image;
use mde_prior::write_atomic;
use rayon::prelude::*;
use std::path::Path;

/// The folder of the model or the workspace.
pub const FOLDER: &str = "colmap";

/// Writes a photograph and its model, in the frame of its camera.
pub(crate) fn write(folder: &Path, view: &DepthView<'_>) -> Result<()> {
    for (name, text) in colmap_view(view, IMAGE) {
        write_file(folder, &format!("sparse/0/{name}"), text.as_bytes())?;
    }
    Ok(write_image(subfolder(folder, "colmap/images")?.join(IMAGE), view.image)?)
}

/// Writes the workspace: the photographs as they were refined, named after their folders, their poses, depths and normals, and a subset of
/// the `points`.
pub(crate) fn write_dense(
    folder: &Path,
    views: &[RefinedView<'_>],
    points: &[ConsistentPoint],
) -> Result<()> {
    let images = subfolder(folder, "colmap/images")?;
    let views: Vec<_> = views.iter().map(|view| (view.map, format!("{}.png", view.folder))).collect();
    views.par_iter().try_for_each(|(view, name)| write_image(images.join(name), view.image))?;
    colmap_workspace(&views, points, |name, bytes| write_file(folder, name, bytes))
}

/// Writes a file by its path within [`FOLDER`].
fn write_file(folder: &Path, name: &str, bytes: &[u8]) -> Result<()> {
    let (place, name) = name.rsplit_once('/').unwrap_or(("", name));
    let place = subfolder(folder, &format!("{FOLDER}/{place}"))?;
    Ok(write_atomic(&place.join(name), bytes)?)
}
