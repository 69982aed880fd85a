//! Rendering of whole views.

use crate::config::NerfConfig;
use crate::field::{FieldCallback, FieldEvent, RenderedView};
use crate::frustum::{Frustum, Ray};
use crate::march::{March, Marcher};
use crate::network::Network;
use crate::train::tile_rays;
use crate::{Error, Result};
use mde_uncertainty::GaussianDepth;
use mde_uncertainty::termination::Moments;
use mde_warp::{PinholeCamera, Pose};
use ndarray::{Array2, Array3};
use rayon::prelude::*;

/// Rows rendered between two events.
const ROWS: usize = 16;
/// Background of rendered views.
const BACKGROUND: f64 = 0.5;
/// Opacity below which the depth is missing.
const MIN_OPACITY: f32 = 0.5;

/// Colour, and the moments of the depth.
type Pixel = ([f32; 3], Moments<f32>);

pub(crate) fn render(
    network: &Network<f32>,
    frustum: &Frustum,
    config: &NerfConfig,
    camera: &PinholeCamera,
    pose: &Pose,
    callback: &mut FieldCallback<'_>,
) -> Result<RenderedView> {
    let (height, width) = (camera.height, camera.width);
    let budget = config.render_budget();
    let tile = tile_rays(&budget);
    let mut image = Array3::zeros((height, width, 3));
    let (mut mean, mut variance) = GaussianDepth::missing(height, width).into_parts();
    let mut opacity = Array2::zeros((height, width));
    let mut in_bin = Array2::zeros((height, width));
    for first in (0..height).step_by(ROWS) {
        let rows = ROWS.min(height - first);
        let tiles: Vec<Vec<Pixel>> = (0..(rows * width).div_ceil(tile))
            .into_par_iter()
            .map_init(Marcher::default, |marcher, chunk| {
                let pixels = chunk * tile..((chunk + 1) * tile).min(rows * width);
                let march = |i: usize| {
                    let ray = Ray::new(camera, pose, (i % width) as f64, (first + i / width) as f64);
                    let interval = frustum.interval(&ray, 0.0);
                    March { ray, interval, guess: None, background: [BACKGROUND; 3], rng: None }
                };
                let mut marches: Vec<March> = pixels.map(march).collect();
                marcher.forward(&|tape| network.forward(tape), frustum, &mut marches, &budget);
                marcher.rendered.iter().map(|r| (r.colour, r.depth)).collect()
            })
            .collect();
        for (i, (colour, depth)) in tiles.into_iter().flatten().enumerate() {
            let at = (first + i / width, i % width);
            for (channel, c) in colour.into_iter().enumerate() {
                image[(at.0, at.1, channel)] = if c.is_nan() { BACKGROUND as f32 } else { c.clamp(0.0, 1.0) };
            }
            opacity[at] = depth.opacity.clamp(0.0, 1.0);
            let finite = depth.mean.is_finite() && depth.variance.is_finite();
            if depth.opacity >= MIN_OPACITY && finite {
                mean[at] = depth.mean;
                variance[at] = depth.variance.max(0.0);
                in_bin[at] = depth.in_bin;
            }
        }
        if callback(&FieldEvent::Render { row: first + rows, rows: height }).is_break() {
            return Err(Error::Interrupted);
        }
    }
    let depth = GaussianDepth::new(mean, variance)?;
    Ok(RenderedView { image, depth, opacity, in_bin: Some(in_bin) })
}
