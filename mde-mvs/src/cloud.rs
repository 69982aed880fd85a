//! Photographs with poses and depths, and the points on which they agree.

use crate::sweep::views::keyframes;
use crate::{centre, nearest_pixel};
use mde_uncertainty::statistics::{median, quantile};
use mde_warp::{PinholeCamera, Pose};
use nalgebra::{Point2, Point3, Vector3};
use ndarray::{Array2, ArrayView2, ArrayView3};
use rayon::prelude::*;

/// Largest standard deviation, relative to the depth, of a sure pixel.
pub const LEAST_SURE: f32 = 0.06;
/// Share of the pixels of a photograph that its cloud and its mesh have at least.
const SUREST: f64 = 0.8;
/// Pixels by which the surer half is found.
const SAMPLES: usize = 100_000;
/// Nearest photographs into which the points of one are projected.
const NEAREST: usize = 32;

/// A photograph with a pose and a depth.
#[derive(Debug, Clone, Copy)]
pub struct DepthView<'v> {
    /// sRGB in 0 to 1, `[height, width, 3]`.
    pub image: ArrayView3<'v, f32>,
    /// Its camera.
    pub camera: PinholeCamera,
    /// World to camera, in the unit of the depth.
    pub pose: Pose,
    /// z-depth, `[height, width]` of the camera; 0 where missing.
    pub depth: ArrayView2<'v, f32>,
    /// Its standard deviation; infinite where missing.
    pub sigma: ArrayView2<'v, f32>,
}

impl DepthView<'_> {
    /// The point of a pixel in the frame of the camera, where its depth is known.
    pub fn point(&self, row: usize, column: usize) -> Option<Point3<f64>> {
        let [z, _] = self.within((row, column), f32::INFINITY)?;
        Some(self.camera.unproject(Point2::new(column as f64, row as f64), f64::from(z)))
    }

    /// The depth, 0 in the least sure fifth by sigma over depth as far as that is above [`LEAST_SURE`].
    pub fn surest(&self) -> Array2<f32> {
        let known = self.depth.iter().zip(self.sigma).filter(|(z, sigma)| **z > 0.0 && sigma.is_finite());
        let mut relative: Vec<f32> = known.map(|(z, sigma)| sigma / z).collect();
        // Rounding takes no pixel from those that are alike.
        let most = 1.0001 * quantile(&mut relative, SUREST).unwrap_or_default() as f32;
        let kept = |at| self.within(at, most.max(LEAST_SURE)).map_or(0.0, |[z, _]| z);
        Array2::from_shape_fn(self.depth.dim(), kept)
    }

    /// Depth and sigma of a pixel whose sigma is at most [`LEAST_SURE`] of the depth.
    pub fn sure(&self, at: (usize, usize)) -> Option<[f32; 2]> {
        self.within(at, LEAST_SURE)
    }

    /// The same with another largest sigma over depth.
    fn within(&self, at: (usize, usize), most: f32) -> Option<[f32; 2]> {
        let (z, sigma) = (*self.depth.get(at)?, *self.sigma.get(at)?);
        (z > 0.0 && sigma.is_finite() && sigma <= most * z).then_some([z, sigma])
    }

    /// The colour of a pixel.
    pub fn colour(&self, row: usize, column: usize) -> [u8; 3] {
        [0, 1, 2].map(|channel| byte(self.image[(row, column, channel)]))
    }

    /// Unit normal of the surface at the `point` of a pixel, towards the camera; 0 where no neighbour is known.
    pub fn normal(&self, row: usize, column: usize, point: Point3<f64>) -> Vector3<f64> {
        let beside = |down: isize, right: isize| {
            self.point(row.checked_add_signed(down)?, column.checked_add_signed(right)?)
        };
        let along = |before: Option<Point3<f64>>, after: Option<Point3<f64>>| {
            let steps = [before.map(|p| point - p), after.map(|p| p - point)];
            // The neighbour nearer in depth lies on the same surface.
            steps.into_iter().flatten().min_by(|a, b| a.z.abs().total_cmp(&b.z.abs()))
        };
        let (right, down) = (along(beside(0, -1), beside(0, 1)), along(beside(-1, 0), beside(1, 0)));
        let (Some(right), Some(down)) = (right, down) else { return Vector3::zeros() };
        let normal = down.cross(&right).try_normalize(0.0).unwrap_or_default();
        if normal.dot(&point.coords) > 0.0 { -normal } else { normal }
    }
}

/// A colour in 0 to 1 as a byte.
pub(crate) fn byte(value: f32) -> u8 {
    (value.clamp(0.0, 1.0) * 255.0).round() as u8
}

/// A point that at least two photographs show.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ConsistentPoint {
    /// Index of the first photograph that shows it.
    pub view: usize,
    /// Its pixel there, `[row, column]`.
    pub pixel: [usize; 2],
    /// The point in the world, on the ray of that pixel.
    pub position: Point3<f64>,
    /// Standard deviation of its depth in that photograph.
    pub sigma: f32,
    /// Other photographs that confirm it.
    pub confirmed: usize,
}

/// The points of the pixels whose sigma is at most [`LEAST_SURE`] of the depth, or among the surer half, that such a pixel of a second
/// photograph confirms: with the point at depth \\( z' \\) before it, and \\( D \\), \\( \sigma \\) its own
/// at the nearest pixel, \\( |z' - D| \le \sigma + \sigma' \\), where \\( \sigma' \\) is the point's in the proportion of the
/// depths. Each is the mean by precision (Eq. 7) of its depths in the photographs that confirm it, along the ray of the first; those
/// pixels give no further point. Of more than 32 photographs the keyframes are used, and each is compared with the 32 nearest.
///
/// Its variance is the harmonic mean of theirs: the photographs share matches and poses, so that their number proves nothing, as Eq. 8
/// would have it.
///
/// Maps of another size than their camera have no points.
pub fn consistent_points(views: &[DepthView<'_>]) -> Vec<ConsistentPoint> {
    // The pixels of which a point is, and those that confirmed it.
    let none = || views.iter().map(|view| Array2::from_elem(view.camera.dim(), false)).collect::<Vec<_>>();
    let (mut given, mut taken) = (none(), none());
    let mut points = Vec::new();
    let most = surer_half(views).max(LEAST_SURE);
    let used = used(views);
    for &index in &used {
        let (view, others) = (&views[index], nearest(views, &used, index));
        let world = view.pose.inverse();
        let of_pixel = |(row, column): (usize, usize)| {
            let ([z, sigma], point) = (view.within((row, column), most)?, view.point(row, column)?);
            let (position, relative) = (world * point, sigma / z);
            let confirm = |&other: &usize| Some((other, seen(&views[other], &position, relative, most)?));
            let confirmed: Vec<_> = others.iter().filter_map(confirm).collect();
            if confirmed.is_empty() || confirmed.iter().any(|&(other, pixel)| given[other][pixel]) {
                return None;
            }
            let own = f64::from(sigma).powi(-2);
            let (mut weighted, mut precision) = (own * point.z, own);
            for &(other, (y, x)) in &confirmed {
                let there = &views[other];
                let found = view.pose * (there.pose.inverse() * there.point(y, x)?);
                let deviation = f64::from(there.sigma[(y, x)]) * found.z / f64::from(there.depth[(y, x)]);
                let weight = deviation.powi(-2);
                weighted += weight * found.z;
                precision += weight;
            }
            let (z, sigma) = (weighted / precision, ((confirmed.len() + 1) as f64 / precision).sqrt());
            let position = world * (point * (z / point.z));
            let (pixel, sigma, confirmed_by) = ([row, column], sigma as f32, confirmed.len());
            let fused = ConsistentPoint { view: index, pixel, position, sigma, confirmed: confirmed_by };
            Some((fused, confirmed))
        };
        let pixels: Vec<(usize, usize)> =
            taken[index].indexed_iter().filter(|(_, taken)| !**taken).map(|(pixel, _)| pixel).collect();
        let found: Vec<_> = pixels.into_par_iter().filter_map(of_pixel).collect();
        for (point, confirmed) in found {
            given[index][point.pixel] = true;
            points.push(point);
            for (other, pixel) in confirmed {
                taken[other][pixel] = true;
            }
        }
    }
    points
}

/// The median of sigma over depth of some pixels of all views.
fn surer_half(views: &[DepthView<'_>]) -> f32 {
    let pixels: usize = views.iter().map(|view| view.depth.len()).sum();
    let all = views.iter().flat_map(|view| view.depth.iter().zip(view.sigma));
    let some = all.step_by(pixels / SAMPLES + 1).filter(|(z, sigma)| **z > 0.0 && sigma.is_finite());
    median(some.map(|(z, sigma)| f64::from(sigma / z))).unwrap_or_default() as f32
}

/// The views whose maps have the size of their camera; of many the keyframes, since photographs of one viewpoint make the same mistakes.
fn used(views: &[DepthView<'_>]) -> Vec<usize> {
    let sized = |view: &DepthView<'_>| [view.depth.dim(), view.sigma.dim()] == [view.camera.dim(); 2];
    let middle =
        |view: &DepthView<'_>| median(view.depth.iter().filter(|z| **z > 0.0).map(|z| f64::from(*z)));
    let depths: Vec<f64> = views.par_iter().map(|view| middle(view).unwrap_or_default()).collect();
    let poses: Vec<Pose> = views.iter().map(|view| view.pose).collect();
    let is_keyframe = keyframes(&poses, &depths, &[]);
    let is_used = |&index: &usize| sized(&views[index]) && (views.len() <= NEAREST || is_keyframe[index]);
    (0..views.len()).filter(is_used).collect()
}

/// The [`NEAREST`] of the other `used` views.
fn nearest(views: &[DepthView<'_>], used: &[usize], index: usize) -> Vec<usize> {
    let here = centre(&views[index].pose);
    let distance = |other: &usize| (centre(&views[*other].pose) - here).norm();
    let mut others: Vec<usize> = used.iter().copied().filter(|&other| other != index).collect();
    others.sort_by(|a, b| distance(a).total_cmp(&distance(b)));
    others.truncate(NEAREST);
    others
}

/// The pixel, row and column, where a view confirms a point of that relative deviation; that of the pixel is at most `most`.
pub fn seen(
    view: &DepthView<'_>,
    position: &Point3<f64>,
    relative: f32,
    most: f32,
) -> Option<(usize, usize)> {
    let there = view.pose * position;
    let pixel = nearest_pixel(&view.camera, &there)?;
    let [depth, sigma] = view.within(pixel, most)?.map(f64::from);
    ((there.z - depth).abs() <= sigma + f64::from(relative) * there.z).then_some(pixel)
}

#[cfg(test)]
mod tests {
    use super::*;
    use ndarray::s;

    const SIZE: (usize, usize) = (12, 16);

    fn view<'v>(shift: f64, depth: &'v Array2<f32>, sigma: &'v Array2<f32>) -> DepthView<'v> {
        DepthView {
            image: ArrayView3::from_shape((0, 0, 3), &[]).unwrap(),
            camera: PinholeCamera::from_fov(60.0, SIZE.1, SIZE.0).unwrap(),
            pose: Pose::translation(-shift, 0.0, 0.0),
            depth: depth.view(),
            sigma: sigma.view(),
        }
    }

    /// As far as they are above the bound; what is alike stays together.
    #[test]
    fn the_least_sure_fifth_is_left_out() {
        let depth = Array2::from_shape_fn(SIZE, |(y, x)| 1.0 + 0.1 * (x + y) as f32);
        let kept = |sigma: &dyn Fn(usize) -> f32| {
            let sigma = Array2::from_shape_fn(SIZE, |(y, x)| sigma(x) * depth[(y, x)]);
            view(0.0, &depth, &sigma).surest().outer_iter().next().unwrap().map(|z| *z > 0.0)
        };
        assert!(kept(&|_| 0.15).into_iter().all(|kept| kept));
        assert!(kept(&|x| if x < 2 { 0.05 } else { 0.01 }).into_iter().all(|kept| kept));
        assert!(kept(&|x| if x < 2 { 0.5 } else { 0.15 }).into_iter().eq((0..SIZE.1).map(|x| x >= 2)));
    }

    #[test]
    fn only_what_two_photographs_show_is_kept_and_each_surface_once() {
        let (mut depth, sigma) = (Array2::from_elem(SIZE, 2.0_f32), Array2::from_elem(SIZE, 0.05_f32));
        let wall = depth.clone();
        depth[(5, 8)] = 1.85;
        let camera = PinholeCamera::from_fov(60.0, SIZE.1, SIZE.0).unwrap();
        // Three pixels to the right.
        let shift = 3.0 * 2.0 / camera.fx;
        let points = consistent_points(&[view(0.0, &depth, &sigma), view(shift, &wall, &sigma)]);
        // What the second does not see, and the pixel that it contradicts.
        assert_eq!(points.len(), SIZE.0 * (SIZE.1 - 3) - 1);
        assert!(points.iter().all(|p| p.view == 0 && p.pixel != [5, 8] && p.pixel[1] >= 3));
        assert!(points.iter().all(|p| (p.position.z - 2.0).abs() < 1e-6));
        // A third photograph at the same place, as sure as both: the mean, and no further point.
        let near = wall.mapv(|z| z - 0.04);
        let three = [view(0.0, &wall, &sigma), view(shift, &wall, &sigma), view(0.0, &near, &sigma)];
        let fused = consistent_points(&three);
        let middle = fused.iter().find(|p| p.pixel == [5, 8]).unwrap();
        assert!((middle.position.z - (2.0 - 0.04 / 3.0)).abs() < 2e-3, "{middle:?}");
        assert!((middle.sigma / 0.05 - 1.0).abs() < 0.02, "{middle:?}");
        assert!(fused.iter().filter(|p| p.view == 2).all(|p| p.pixel[1] < 3));
        assert_eq!((points[0].confirmed, middle.confirmed), (1, 2));
        // With a sigma that allows for the difference it is confirmed.
        let with =
            |sigma: &Array2<f32>| consistent_points(&[view(0.0, &depth, sigma), view(shift, &wall, sigma)]);
        let mut vague = Array2::from_elem(SIZE, 0.3);
        vague[(5, 8)] = 0.2;
        let of_all = with(&vague);
        assert!(of_all.iter().any(|p| p.pixel == [5, 8]));
        // Of less sure pixels than half of all there are no points.
        vague.slice_mut(s![.., 6..]).fill(0.1);
        let of_half = with(&vague);
        assert!(!of_half.is_empty() && of_half.iter().all(|p| p.pixel[1] >= 6));
        assert!(consistent_points(&[view(0.0, &wall, &sigma)]).is_empty());
        // Of many those of nearly one viewpoint confirm nothing.
        let many = |step: f64| (0..40).map(|i| view(step * f64::from(i), &wall, &sigma)).collect::<Vec<_>>();
        assert!(consistent_points(&many(1e-4)).is_empty() && !consistent_points(&many(0.1)).is_empty());
    }
}
