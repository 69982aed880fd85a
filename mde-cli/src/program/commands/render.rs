use crate::output::preview::depth_picture;
use crate::program::args::RenderArgs;
use crate::program::interrupt;
use crate::program::open::settings::{camera, limit};
use crate::program::progress::Progress;
use crate::program::provenance::{about, rows, write_record};
use crate::program::store::folder::OutputFolder;
use crate::program::terminal::line_of;
use crate::refinement::event::Event;
use crate::refiner::Observer;
use crate::refiner::plan::render_bytes;
use anyhow::{Context, Result, ensure};
use mde_nerf::{FieldEvent, Nerf, RadianceField, RenderedView};
use mde_prior::format::{DepthPng, write_depth_png, write_npy};
use mde_prior::photo::{write_image, write_rgb_png};
use mde_uncertainty::statistics::median;
use mde_warp::{PinholeCamera, Pose};
use nalgebra::{Translation3, UnitQuaternion, Vector3};
use serde_json::json;
use std::f64::consts::TAU;
use std::path::Path;

/// A field does not store the unit of its prior.
const UNIT: &str = "unknown";
/// Width of the rendering from which the scene's distance is measured.
const PROBE: usize = 64;

pub(super) fn run(args: &RenderArgs) -> Result<()> {
    let mut progress = Progress::start(&args.run)?;
    let folder = OutputFolder::new(&args.run.output(&args.field, "-render"), args.run.force)?;
    let camera = camera(&args.camera, None, args.size)?;
    if let Some(warning) = camera.warning() {
        progress.warn(warning);
    }
    let [width, height] = args.size;
    let count = args.orbit.map_or(1, u64::from);
    limit(&args.memory).check("--size", (height, width), |pixels| render_bytes(pixels, count))?;
    let shown = args.field.display();
    ensure!(args.field.exists(), "{shown}: no such file; check the path");
    ensure!(args.field.is_file(), "{shown}: give a file, not a folder");
    let field = Nerf::load(&args.field)?;
    let poses = poses(args, &field, &camera.camera)?;
    let mut views = Vec::new();
    for (index, pose) in poses.iter().enumerate() {
        let mut listen = |event: &FieldEvent| {
            progress.event(&Event::Field { event: *event, view: index, views: poses.len() })
        };
        views.push(field.render(&camera.camera, pose, &mut listen)?);
    }
    let depths: Vec<f32> = views.iter().flat_map(|view| view.depth.mean().to_owned()).collect();
    let png = DepthPng::new(UNIT, depths.iter().copied());
    folder.write(|path| {
        let mut records = Vec::new();
        for (index, (view, pose)) in views.iter().zip(&poses).enumerate() {
            let number = if poses.len() == 1 { String::new() } else { format!("_{index:03}") };
            write_view(path, &number, view, &png)?;
            records.push(json!({ "colour": format!("colour{number}.png"), "world_to_camera": rows(pose) }));
        }
        let about = about("render", args.field.display().to_string(), &camera, None, &progress);
        write_record(path, about, json!({ "png_scale": png.scale, "views": records }))
    })?;
    let text = format!("{} views\nwrote {}", poses.len(), line_of(folder.path()));
    progress.result(
        &text,
        json!({ "event": "done", "output": folder.path().display().to_string(), "views": poses.len() }),
    );
    Ok(())
}

fn write_view(folder: &Path, number: &str, view: &RenderedView, png: &DepthPng) -> Result<()> {
    write_image(folder.join(format!("colour{number}.png")), view.image.view())?;
    write_npy(folder.join(format!("depth{number}.npy")), view.depth.mean())?;
    write_npy(folder.join(format!("sigma{number}.npy")), view.depth.sigma().view())?;
    write_depth_png(folder.join(format!("depth{number}.png")), view.depth.mean(), png.unit, png.scale)?;
    Ok(write_rgb_png(folder.join(format!("preview{number}.png")), depth_picture(view.depth.mean()).view())?)
}

/// Where the camera stands, world to camera.
fn poses(args: &RenderArgs, field: &Nerf, camera: &PinholeCamera) -> Result<Vec<Pose>> {
    match (args.orbit, args.translate) {
        (Some(count), _) => {
            ensure!(
                args.radius.is_finite() && args.radius.abs() <= 1.0,
                "--radius {}: give a fraction of the median depth, 0 to 1",
                args.radius
            );
            let distance = middle(field, camera)?;
            Ok((0..count)
                .map(|k| on_circle(f64::from(k) / f64::from(count), args.radius, distance))
                .collect())
        }
        (None, Some(translation)) => Ok(vec![Translation3::from(-Vector3::from(translation)).into()]),
        (None, None) => Ok(vec![Pose::identity()]),
    }
}

/// A camera at `radius` times the `distance` from the original one, at a share of the full turn, that looks at the point
/// ahead of the original one at that distance.
fn on_circle(turn: f64, radius: f64, distance: f64) -> Pose {
    let (sin, cos) = (TAU * turn).sin_cos();
    let centre = Vector3::new(cos, sin, 0.0) * (radius * distance);
    let ahead = Vector3::new(0.0, 0.0, distance) - centre;
    // y points down, so "up" of a right-handed frame with z ahead is y itself.
    let rotation = UnitQuaternion::look_at_rh(&-ahead, &Vector3::y());
    Pose::from_parts(Translation3::from(-(rotation * centre)), rotation)
}

/// The field's median depth as seen from the original camera.
fn middle(field: &Nerf, camera: &PinholeCamera) -> Result<f64> {
    let height = (PROBE * camera.height).div_ceil(camera.width).clamp(1, 4 * PROBE);
    let mut listen = |_: &FieldEvent| interrupt::flow();
    let seen = field.render(&camera.resized(PROBE, height)?, &Pose::identity(), &mut listen)?;
    let depths = seen.depth.mean().iter().copied().filter(|d| *d > 0.0).collect::<Vec<_>>();
    median(depths).context("the field shows nothing from the original camera; check the camera")
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Point3;

    #[test]
    fn the_orbit_looks_at_one_point_and_stays_upright() {
        for k in 0..8 {
            let pose = on_circle(f64::from(k) / 8.0, 0.1, 3.0);
            let target = pose * Point3::new(0.0, 0.0, 3.0);
            assert!(target.x.abs() < 1e-12 && target.y.abs() < 1e-12 && target.z > 3.0, "{target}");
            let centre = pose.inverse() * Point3::origin();
            assert!((centre.coords.norm() - 0.3).abs() < 1e-12);
            // The world's down stays down in the picture.
            assert!((pose.rotation * Vector3::y()).y > 0.9);
        }
    }
}
