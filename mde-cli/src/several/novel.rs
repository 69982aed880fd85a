//! A photograph beside what the field renders from its place.

use crate::error::Result;
use crate::reports::capture::NovelView;
use crate::several::prepared::equalised;
use mde_mvs::consensus::ViewDepth;
use mde_nerf::{FieldCallback, RadianceField};
use mde_prior::resample::{nearest, shrink};
use mde_uncertainty::GaussianDepth;
use mde_warp::{PosedView, WarpConfig, forward_warp};
use ndarray::{Array2, ArrayView3, Zip};

/// Longer side of the rendering, pixels: it takes a few tenths of a second.
const LONGEST: usize = 320;
/// Opacity from which a rendered pixel counts.
const OPAQUE: f32 = 0.5;
/// Share of the pixels below which no PSNR is given.
const LEAST: f64 = 0.2;

/// The photograph that the field renders.
pub(super) struct Candidate {
    pub(super) view: PosedView,
    /// Index among the capture's photographs.
    pub(super) index: usize,
    /// Whether neither sweeps nor fit used it.
    pub(super) withheld: bool,
}

/// Renders a photograph by the field, and by moving the reference with the gauged prior of what is `known` of its depth.
pub(super) fn compare(
    candidate: &Candidate,
    reference: &PosedView,
    known: &ViewDepth,
    field: &dyn RadianceField,
    callback: &mut FieldCallback<'_>,
) -> Result<NovelView> {
    let view = &candidate.view;
    let image = match candidate.withheld {
        true => equalised(reference, view, known)?.1.into_shared(),
        // The fit has it in the reference's exposure already.
        false => view.image.clone(),
    };
    let size = |view: &PosedView| {
        let (height, width) = view.mask.dim();
        let scale = (LONGEST as f64 / height.max(width) as f64).min(1.0);
        [height, width].map(|side| ((side as f64 * scale).round() as usize).max(1))
    };
    let ([height, width], [rows, columns]) = (size(view), size(reference));
    let camera = view.camera.resized(width, height)?;
    let image = shrink(image.view(), (height, width));
    let mask = nearest(view.mask.view(), (height, width));
    let rendered = field.render(&camera, &view.pose, callback)?;

    let z = nearest(known.prior.mean(), (rows, columns));
    let variance = z.mapv(|z| if z > 0.0 { 1.0 } else { f32::INFINITY });
    let moved = forward_warp(
        shrink(reference.image.view(), (rows, columns)).view(),
        &GaussianDepth::new(z, variance)?,
        &reference.camera.resized(columns, rows)?,
        &reference.pose,
        &camera,
        &view.pose,
        &WarpConfig::default(),
    )?;
    let mut both = mask;
    Zip::from(&mut both)
        .and(&rendered.opacity)
        .and(&moved.view.mask)
        .for_each(|both, &opacity, &reached| *both &= reached && opacity >= OPAQUE);
    let compared = both.iter().filter(|both| **both).count() as f64 / both.len().max(1) as f64;
    let psnr = |other| (compared >= LEAST).then(|| psnr(image.view(), other, &both));
    Ok(NovelView {
        photograph: candidate.index,
        withheld: candidate.withheld,
        psnr: psnr(rendered.image.view()),
        psnr_of_prior: psnr(moved.view.image.view()),
        compared,
        rendered: rendered.image,
        image,
    })
}

/// Peak signal-to-noise ratio over the pixels of a mask, at most 99 dB.
fn psnr(image: ArrayView3<'_, f32>, other: ArrayView3<'_, f32>, mask: &Array2<bool>) -> f64 {
    let (mut sum, mut count) = (0.0, 0_usize);
    for (((row, column, _), a), b) in image.indexed_iter().zip(other) {
        if mask[(row, column)] {
            sum += f64::from(a - b).powi(2);
            count += 1;
        }
    }
    (-10.0 * (sum / count.max(1) as f64).max(1e-12).log10()).min(99.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_psnr_counts_masked_pixels_alone() {
        let image = ndarray::Array3::zeros((2, 2, 3));
        let mut other = image.mapv(|v: f32| v + 0.1);
        let mut mask = Array2::from_elem((2, 2), true);
        assert!((psnr(image.view(), other.view(), &mask) - 20.0).abs() < 1e-4);
        other[(1, 1, 0)] = 1.0;
        assert!(psnr(image.view(), other.view(), &mask) < 15.0);
        mask[(1, 1)] = false;
        assert!((psnr(image.view(), other.view(), &mask) - 20.0).abs() < 1e-4);
    }
}
