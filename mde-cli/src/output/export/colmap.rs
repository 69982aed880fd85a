//! COLMAP's models: of a photograph and the others with its thinned cloud, and the dense workspace of a capture.

use super::{IMAGE, Placed, subfolder};
use crate::error::Result;
use crate::refiner::finish::Other;
use mde_mvs::capture::{Frame, colmap_view, colmap_workspace};
use mde_mvs::cloud::{ConsistentPoint, DepthView};
use mde_prior::format::write_png16;
use mde_prior::photo::{write_image, write_rgb_png};
use mde_prior::write_atomic;
use ndarray::Array2;
use rayon::prelude::*;
use serde_json::{Map, Value, json};
use std::path::Path;

/// The folder of the model or the workspace.
pub const FOLDER: &str = "colmap";

/// Writes a photograph, the others and their model, in the frame of its camera.
pub(crate) fn write(folder: &Path, view: &DepthView<'_>, others: &[Other]) -> Result<()> {
    let own = Frame::new(view.camera, view.pose, IMAGE);
    let others_too = others.iter().map(|other| Frame::new(other.camera, other.pose, &other.name));
    let frames: Vec<_> = std::iter::once(own).chain(others_too).collect();
    for (name, text) in colmap_view(view, &frames) {
        write_file(folder, &format!("sparse/0/{name}"), text.as_bytes())?;
    }
    let images = subfolder(folder, "colmap/images")?;
    others.iter().try_for_each(|other| write_rgb_png(images.join(&other.name), other.picture.view()))?;
    Ok(write_image(images.join(IMAGE), view.image)?)
}

/// Steps of an inverse depth in trainers of splats.
const STEPS: f64 = 65536.0;

/// Writes the workspace: the photographs of the `maps`, named after their folders, their poses, depths and normals, and a subset of the
/// `points`; for trainers of splats also the inverse depths of sure pixels in 16 bits and the factor that they share.
pub(crate) fn write_dense(
    folder: &Path,
    (placed, maps): (&[Placed<'_>], &[DepthView<'_>]),
    points: &[ConsistentPoint],
) -> Result<()> {
    let images = subfolder(folder, "colmap/images")?;
    let names = placed.iter().map(|placed| format!("{}.png", placed.folder));
    let views: Vec<_> = maps.iter().copied().zip(names).collect();
    let depths = subfolder(folder, "colmap/depths")?;
    let inverse = |view: &DepthView<'_>| {
        Array2::from_shape_fn(view.depth.dim(), |at| view.sure(at).map_or(0.0, |[z, _]| z.recip()))
    };
    let largest = |view: &DepthView<'_>| inverse(view).into_iter().fold(f32::MIN_POSITIVE, f32::max);
    let nearest = views.par_iter().map(|(view, _)| largest(view)).reduce(|| f32::MIN_POSITIVE, f32::max);
    let steps = (STEPS - 1.0) / f64::from(nearest);
    views.par_iter().try_for_each(|(view, name)| {
        write_png16(depths.join(name), inverse(view).view(), steps)?;
        write_image(images.join(name), view.image)
    })?;
    let factor = json!({ "scale": STEPS / steps, "offset": 0.0 });
    let factors: Map<String, Value> =
        views.iter().map(|(_, name)| (name.trim_end_matches(".png").to_owned(), factor.clone())).collect();
    write_file(folder, "sparse/0/depth_params.json", format!("{:#}\n", Value::from(factors)).as_bytes())?;
    colmap_workspace(&views, points, |name, bytes| write_file(folder, name, bytes))
}

/// Writes a file by its path within [`FOLDER`].
fn write_file(folder: &Path, name: &str, bytes: &[u8]) -> Result<()> {
    let (place, name) = name.rsplit_once('/').unwrap_or(("", name));
    let place = subfolder(folder, &format!("{FOLDER}/{place}"))?;
    Ok(write_atomic(&place.join(name), bytes)?)
}
