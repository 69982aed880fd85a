use crate::error::in_range;
use crate::holes::{self, Hole};
use crate::mesh::Mesh;
use crate::pose::check_cameras;
use crate::transfer::Transfer;
use crate::view::check_image;
use crate::zbuffer::{Hit, front};
use crate::{PinholeCamera, Pose, PosedView, Result};
use mde_uncertainty::GaussianDepth;
use ndarray::{Array2, Array3, ArrayView3, Zip};

/// Furthest that a filled colour may come from, pixels; what lies deeper in a gap stays black.
const FILL_DISTANCE: usize = 128;

/// Settings of [`forward_warp`].
#[derive(Debug, Clone, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "serde", serde(deny_unknown_fields, default, rename_all = "kebab-case"))]
pub struct WarpConfig {
    /// Relative difference of disparity 1/z above which neighbouring pixels belong to two surfaces, as a share of the
    /// larger. 0 tears everything that is not exactly level, 1 nothing.
    pub tear: f64,
}

impl Default for WarpConfig {
    fn default() -> Self {
        Self { tear: 0.05 }
    }
}

impl WarpConfig {
    /// Checks every field.
    ///
    /// # Errors
    /// [`Error::Config`](crate::Error::Config) with the field at fault.
    pub fn validate(&self) -> Result<()> {
        in_range("tear", self.tear, [0.0, 1.0], "give 0 to 1 (a share of the disparity; 0.05 is usual)")
    }
}

/// Result of [`forward_warp`].
#[derive(Debug, Clone, PartialEq)]
pub struct WarpedView {
    /// The image in the target camera. Its mask is true where the source is visible (false where filled);
    /// `hypotheses[0]` is the warped depth with its variance, missing where the mask is false.
    pub view: PosedView,
    /// The warped z-depth, `[height, width]`; 0 where nothing of the source lands.
    pub depth: Array2<f32>,
    /// Share of the target's pixels that stay empty although their background lies within the source frame: it is
    /// occluded there, or its depth is missing. The paper: < 2 %.
    pub hole_fraction: f64,
    /// Share of the target's pixels whose background lies outside the source frame.
    pub outside_fraction: f64,
}

/// Forward warp of an image and its depth into another camera (Section III.A).
///
/// A source pixel \\( (u, v) \\) of depth \\( z \\) goes to \\( X' = z R d + t \\), \\( d \\) its ray with z = 1. The depth map is
/// rasterised as a mesh of triangles, torn between surfaces ([`WarpConfig::tear`]). At each target pixel centre the nearest surface wins;
/// its depth and source position are interpolated perspective-correctly, so planes stay exact planes. Colours are interpolated bilinearly
/// among source pixels of one surface. Neither colour nor depth mixes two surfaces: they meet half-way between their outermost pixels. Back
/// faces are not drawn. Source pixels that are missing, or not in front of their camera, produce nothing.
///
/// * `image`: `[height, width, 3]`; `depth`: `[height, width]`, z in `camera`, in the prior's unit.
/// * The variance of the warped depth is \\( (e_z^\top R d)^2 \sigma^2(u, v) \\), with \\( \sigma^2 \\) interpolated among
///   the pixels of the surface (the variance at that position, not of a mean of pixels).
/// * Empty pixels are masked out and take the colour of the deeper end of their gap, along the row or the column, whichever
///   gap is shorter, if that is at most 128 pixels away.
/// * An empty pixel counts as a hole if its background, at the depth of the deeper end of the gap, lies within the source
///   frame, and as outside otherwise. Where nothing at all landed, the background is at infinity.
///
/// ```
/// use mde_warp::{PinholeCamera, Pose, WarpConfig, forward_warp, ndarray::{Array2, Array3}};
/// use mde_uncertainty::GaussianDepth;
///
/// // A wall at 2 m. The camera moves 4 cm to the right: everything moves left by f B / z = 100 * 0.04 / 2 = 2 pixels.
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
/// [`Error::Config`](crate::Error::Config), [`Error::Camera`](crate::Error::Camera) or
/// [`Error::Pose`](crate::Error::Pose) for a value out of range, [`Error::Shape`](crate::Error::Shape) for an image or depth
/// map that is not of `camera`'s size, [`Error::Colour`](crate::Error::Colour) for a colour that is not finite.
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
    check_cameras((camera, source), (target_camera, target))?;
    let transfer = Transfer::between((camera, source), (target_camera, target));
    check_image(image, camera)?;
    camera.check_map("depth", depth.dim())?;

    let hits = front(&Mesh::new(depth, transfer, config.tear));
    let warped = warped_depth(&hits, depth, &transfer)?;
    let mask = warped.support();
    let warped_mean = warped.mean().to_owned();
    let mut colours = warped_colours(&hits, image, &mask);

    let holes = holes::find(&warped_mean);
    let back = Transfer::between((target_camera, target), (camera, source));
    let inside = holes.iter().filter(|hole| within_source(hole, &warped_mean, &back)).count();
    holes.iter().for_each(|hole| fill(&mut colours, hole));
    let share = |count: usize| count as f64 / mask.len() as f64;
    Ok(WarpedView {
        hole_fraction: share(inside),
        outside_fraction: share(holes.len() - inside),
        depth: warped_mean,
        view: PosedView::new(colours, *target_camera, *target, mask, vec![warped])?,
    })
}

fn warped_depth(hits: &Array2<Hit>, source: &GaussianDepth, transfer: &Transfer) -> Result<GaussianDepth> {
    let moments = hits.map(|hit| {
        let depth = hit.depth() as f32;
        if hit.is_empty() || !(depth > 0.0 && depth.is_finite()) {
            return (0.0, f32::INFINITY);
        }
        let gain = transfer.gain(hit.u, hit.v);
        (depth, (gain * gain * hit.source_variance(source)) as f32)
    });
    Ok(GaussianDepth::new(moments.mapv(|m| m.0), moments.mapv(|m| m.1))?)
}

/// The source's colours where `mask` is true, black elsewhere.
fn warped_colours(hits: &Array2<Hit>, image: ArrayView3<'_, f32>, mask: &Array2<bool>) -> Array3<f32> {
    let (height, width) = hits.dim();
    let mut colours = Array3::zeros((height, width, 3));
    Zip::from(colours.rows_mut()).and(hits).and(mask).for_each(|mut colour, hit, &visible| {
        if !visible {
            return;
        }
        let mut sum = [0.0_f64; 3];
        for ((row, column), weight) in hit.patch.pixels(hit.u, hit.v) {
            for (channel, sum) in sum.iter_mut().enumerate() {
                *sum += weight * image.get((row, column, channel)).map_or(0.0, |&c| f64::from(c));
            }
        }
        colour.iter_mut().zip(sum).for_each(|(colour, sum)| *colour = sum as f32);
    });
    colours
}

/// Whether a hole's background lies within the source frame; `back` goes from the target to the source.
fn within_source(hole: &Hole, depth: &Array2<f32>, back: &Transfer) -> bool {
    let disparity = hole.background.map_or(0.0, |pixel| f64::from(depth[pixel]).recip());
    let seen = back.at(hole.column as f64, hole.row as f64, disparity);
    seen.is_some_and(|seen| back.nearest(&seen).is_some())
}

/// Gives a hole the colour of its background, where that is near.
fn fill(colours: &mut Array3<f32>, hole: &Hole) {
    let near = |(row, column): &(usize, usize)| {
        row.abs_diff(hole.row) + column.abs_diff(hole.column) <= FILL_DISTANCE
    };
    if let Some((row, column)) = hole.background.filter(near) {
        for channel in 0..3 {
            colours[(hole.row, hole.column, channel)] = colours[(row, column, channel)];
        }
    }
}
