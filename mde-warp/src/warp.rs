use crate::error::in_range;
use crate::holes::{self, Hole};
use crate::mesh::Mesh;
use crate::pose::Transfer;
use crate::view::{check_image, check_map};
use crate::zbuffer::{Hit, front};
use crate::{PinholeCamera, Pose, PosedView, Result};
use mde_uncertainty::GaussianDepth;
use ndarray::{Array2, Array3, ArrayView3, Zip};

/// What the pixels that a warp leaves empty look like. They are masked out either way.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "serde", serde(rename_all = "kebab-case"))]
#[non_exhaustive]
pub enum HoleFilling {
    /// Black.
    None,
    /// The colour of the deeper end of the gap, along the row or the column, whichever gap is shorter.
    #[default]
    Background,
}

/// How [`forward_warp`] treats surfaces and gaps.
#[derive(Debug, Clone, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "serde", serde(deny_unknown_fields, default, rename_all = "kebab-case"))]
pub struct WarpConfig {
    /// Neighbouring pixels are on two surfaces where their disparities 1/z differ by more than this share of the larger.
    /// 0 tears everything that is not exactly level, 1 nothing.
    pub tear: f64,
    /// What empty pixels look like.
    pub holes: HoleFilling,
    /// Furthest that a filled colour may come from, pixels; what lies deeper in a gap stays black.
    pub reach: usize,
}

impl Default for WarpConfig {
    fn default() -> Self {
        Self { tear: 0.05, holes: HoleFilling::Background, reach: 128 }
    }
}

impl WarpConfig {
    /// Checks every field.
    ///
    /// # Errors
    /// [`Error::Config`](crate::Error::Config) with the field at fault.
    pub fn validate(&self) -> Result<()> {
        in_range("tear", self.tear, [0.0, 1.0], "in 0 to 1 (a share of the disparity; 0.05 is usual)")
    }
}

/// A view made by [`forward_warp`].
#[derive(Debug, Clone, PartialEq)]
pub struct WarpedView {
    /// The picture in the target camera. Its mask is true where the source was seen (false where filled);
    /// `hypotheses[0]` is the warped depth with its variance, missing where the mask is false.
    pub view: PosedView,
    /// The warped z-depth, `[height, width]`; 0 where nothing of the source lands.
    pub depth: Array2<f32>,
    /// Share of the target's pixels that stay empty although they look at a place within the source frame: it was hidden
    /// there, or its depth was missing. The paper: < 2 %.
    pub hole_fraction: f64,
    /// Share of the target's pixels that look past the source frame.
    pub outside_fraction: f64,
}

/// Carries a picture and its depth into another camera (Section III.A).
///
/// A source pixel \\( (u, v) \\) of depth \\( z \\) goes to \\( X' = z R d + t \\), \\( d \\) its ray with z = 1. The depth
/// map is rasterised as a mesh of triangles, torn between surfaces ([`WarpConfig::tear`]); at each target pixel centre the
/// nearest surface wins, and its depth and source position are interpolated perspective-correctly, so planes stay planes
/// exactly. Colours are bilinear among source pixels of one surface. No colour or depth is ever a mix of two surfaces: they
/// meet half-way between their outermost pixels. Surfaces seen from behind are not drawn. Source pixels that are missing,
/// or not in front of their camera, produce nothing.
///
/// * `image`: `[height, width, 3]`; `depth`: `[height, width]`, z in `camera`, in the prior's unit.
/// * The variance of the warped depth is \\( (e_z^\top R d)^2 \sigma^2(u, v) \\), with \\( \sigma^2 \\) interpolated among
///   the pixels of the surface (the variance of a place, not of a mean of pixels).
/// * An empty pixel counts as a hole if the background behind it, at the depth of the deeper end of the gap, lies within
///   the source frame, and as outside if not. Where nothing at all landed, infinity takes the background's place.
///
/// ```
/// use mde_warp::{PinholeCamera, Pose, WarpConfig, forward_warp, ndarray::{Array2, Array3}};
/// use mde_uncertainty::GaussianDepth;
///
/// // A wall two metres away. The camera steps 4 cm to the right: all moves left by f B / z = 100 * 0.04 / 2 = 2 pixels.
/// let camera = PinholeCamera::new(100.0, 100.0, 15.5, 11.5, 32, 24)?;
/// let image = Array3::from_shape_fn((24, 32, 3), |(_, column, _)| column as f32 / 32.0);
/// let depth = GaussianDepth::new(Array2::from_elem((24, 32), 2.0), Array2::from_elem((24, 32), 0.01))?;
/// let step = Pose::translation(-0.04, 0.0, 0.0);
/// let warped = forward_warp(image.view(), &depth, &camera, &Pose::identity(), &camera, &step, &WarpConfig::default())?;
/// assert!((warped.view.image[(5, 10, 0)] - image[(5, 12, 0)]).abs() < 1e-6);
/// assert_eq!(warped.hole_fraction, 0.0);
/// assert_eq!(warped.outside_fraction, 2.0 / 32.0);
/// # Ok::<(), mde_warp::Error>(())
/// ```
///
/// # Errors
/// A setting, camera or pose out of range, an image or depth map that has not the size of `camera`, or a colour that is
/// not finite.
pub fn forward_warp(
    image: ArrayView3<'_, f32>,
    depth: &GaussianDepth,
    camera: &PinholeCamera,
    source: &Pose,
    target_camera: &PinholeCamera,
    target: &Pose,
    config: &WarpConfig,
) -> Result<WarpedView> {
    config.validate()?;
    let transfer = Transfer::new((camera, source), (target_camera, target))?;
    check_image(image, camera)?;
    check_map("depth", depth.dim(), camera)?;

    let hits = front(&Mesh::new(depth, transfer, config.tear, |_, _| true));
    let warped = warped_depth(&hits, depth, &transfer)?;
    let mask = warped.support();
    let warped_mean = warped.mean().to_owned();
    let mut picture = colours(&hits, image, &mask);

    let holes = holes::find(&warped_mean);
    let back = transfer.inverse();
    let inside = holes.iter().filter(|hole| within_source(hole, &warped_mean, &back)).count();
    if config.holes == HoleFilling::Background {
        fill(&mut picture, &holes, config.reach);
    }
    let share = |count: usize| count as f64 / mask.len() as f64;
    Ok(WarpedView {
        hole_fraction: share(inside),
        outside_fraction: share(holes.len() - inside),
        depth: warped_mean,
        view: PosedView::new(picture, *target_camera, *target, mask, vec![warped])?,
    })
}

fn warped_depth(hits: &Array2<Hit>, source: &GaussianDepth, transfer: &Transfer) -> Result<GaussianDepth> {
    let (height, width) = hits.dim();
    let (mut mean, mut variance) = GaussianDepth::missing(height, width).into_parts();
    Zip::from(hits).and(&mut mean).and(&mut variance).for_each(|hit, mean, variance| {
        let depth = hit.depth() as f32;
        if !hit.is_empty() && depth > 0.0 && depth.is_finite() {
            let gain = transfer.gain(hit.u, hit.v);
            *mean = depth;
            *variance = (gain * gain * hit.source_variance(source)) as f32;
        }
    });
    Ok(GaussianDepth::new(mean, variance)?)
}

/// The source's colours where `mask` says that it was hit, black elsewhere.
fn colours(hits: &Array2<Hit>, image: ArrayView3<'_, f32>, mask: &Array2<bool>) -> Array3<f32> {
    let (height, width) = hits.dim();
    let mut picture = Array3::zeros((height, width, 3));
    Zip::from(picture.rows_mut()).and(hits).and(mask).for_each(|mut colour, hit, &seen| {
        if !seen {
            return;
        }
        let mut sum = [0.0_f64; 3];
        for ((row, column), weight) in hit.place.pixels(hit.u, hit.v) {
            for (channel, sum) in sum.iter_mut().enumerate() {
                *sum += weight * image.get((row, column, channel)).map_or(0.0, |&c| f64::from(c));
            }
        }
        colour.iter_mut().zip(sum).for_each(|(colour, sum)| *colour = sum as f32);
    });
    picture
}

/// Whether what a hole looks at lies within the frame of the source; `back` goes from the target to the source.
fn within_source(hole: &Hole, depth: &Array2<f32>, back: &Transfer) -> bool {
    let disparity = hole.background.map_or(0.0, |pixel| f64::from(depth[pixel]).recip());
    let seen = back.see(hole.column as f64, hole.row as f64, disparity);
    seen.ratio > 0.0 && back.target.contains([seen.x, seen.y].into())
}

fn fill(picture: &mut Array3<f32>, holes: &[Hole], reach: usize) {
    for hole in holes {
        let Some((row, column)) = hole.background.filter(|_| hole.reach().is_some_and(|r| r <= reach)) else {
            continue;
        };
        for channel in 0..3 {
            picture[(hole.row, hole.column, channel)] = picture[(row, column, channel)];
        }
    }
}
