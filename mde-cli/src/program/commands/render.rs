use crate::output::preview::depth_picture;
use crate::program::open::{camera, limit};
use crate::program::store::OutputFolder;
use crate::program::{Progress, RenderArgs, about, interrupt, line_of, write_record};
use crate::refinement::Event;
use crate::refiner::{Observer, render_bytes};
use anyhow::{Context, Result, ensure};
use mde_eval::table::Document;
use mde_nerf::{FieldEvent, Nerf, RadianceField, RenderedView};
use mde_prior::format::{DepthPng, write_depth_png, write_npy};
use mde_prior::photo::{write_image, write_rgb_png};
use mde_uncertainty::statistics::median;
use mde_warp::{PinholeCamera, Pose, matrix_rows, orbit};
use nalgebra::{Translation3, Vector3};
use serde_json::json;
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
            let colour = format!("colour{number}.png");
            records.push(json!({ "colour": colour, "world_to_camera": matrix_rows(pose) }));
        }
        let about = about("render", args.field.display().to_string(), &camera, None, &progress);
        write_record(path, about, json!({ "png_scale": png.scale, "views": records }))
    })?;
    let text = format!("{} views\nwrote {}", poses.len(), line_of(folder.path()));
    progress.done(&Document::default(), &text, folder.path(), json!({ "views": poses.len() }));
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
            Ok(orbit(count.into(), args.radius, distance))
        }
        (None, Some(translation)) => Ok(vec![Translation3::from(-Vector3::from(translation)).into()]),
        (None, None) => Ok(vec![Pose::identity()]),
    }
}

fn middle(field: &Nerf, camera: &PinholeCamera) -> Result<f64> {
    let height = (PROBE * camera.height).div_ceil(camera.width).clamp(1, 4 * PROBE);
    let mut listen = |_: &FieldEvent| interrupt::flow();
    let seen = field.render(&camera.resized(PROBE, height)?, &Pose::identity(), &mut listen)?;
    let depths = seen.depth.mean().iter().copied().filter(|d| *d > 0.0).collect::<Vec<_>>();
    median(depths).context("the field shows nothing from the original camera; check the camera")
}
