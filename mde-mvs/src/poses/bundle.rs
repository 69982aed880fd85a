//! Adjustment of poses, depths, one focal length and the prior's scales to matches.
//!
//! A track has a depth \\( z \\) along its ray \\( d_a \\) in one photograph, the anchor, and pixels in others. With
//! \\( T_v = (R_v, t_v) \\) world to camera, \\( R = R_v R_a^\top \\) and \\( t = t_v - R t_a \\), the residual in view
//! \\( v \\) is
//!
//! \\[ r = \pi_v(R d_a + t / z) - p_v , \\]
//!
//! with \\( \pi_v \\) the pinhole projection, and the prior adds \\( (\log z - \log D_a(p_a) - m_a) / \sigma_a \\) with a free
//! logarithmic scale \\( m_a \\) of each photograph's prior. Poses move by \\( T \leftarrow \exp(\delta) T \\); with a prior, a
//! depth moves by \\( \log z \leftarrow \log z + \delta \\), without one by \\( 1/z \leftarrow 1/z + \delta \\), which may
//! pass infinity on its way. Depths meet in no residual, so each is eliminated by a division (Schur's complement); what is left
//! is as small as seven times the number of photographs.

mod distortion;
mod starts;
mod triangulation;

use super::covariance::PoseCovariance;
use super::{FOCAL_SIGMA, PRIOR_SIGMA, centre, shared_error_factor};
use crate::statistics::{is_flat, robust_deviation};
use mde_uncertainty::statistics::median;
use mde_warp::Pose;
use nalgebra::{
    DMatrix, DVector, Matrix2x3, Matrix3, Matrix6, Point2, SMatrix, Translation3, UnitQuaternion, Vector2,
    Vector3, Vector6,
};

/// Share of the cost by which a step must lower it to be worth another.
const TOLERANCE: f64 = 1e-9;
/// Damping at the start, and its bounds.
const DAMPING: [f64; 3] = [1e-4, 1e-12, 1e12];
/// A point whose depth in a view is below this share of its depth at the anchor is as good as behind it.
const NEAR: f64 = 1e-3;
/// Residual of a point behind a view, in units of its noise.
const BEHIND: f64 = 1000.0;
/// Bounds of an inverse depth within which no projection overflows.
const INVERSE_DEPTH: [f64; 2] = [1e-25, 1e25];
/// Fewer tracks than this do not measure a prior.
const FEW: usize = 10;
/// No prior counts as closer than this to the depths.
const LEAST_SPREAD: f64 = 0.02;

type Matrix2x6 = SMatrix<f64, 2, 6>;

/// Intrinsic parameters and noise of one photograph.
#[derive(Debug, Clone, Copy)]
pub(super) struct Lens {
    pub(super) focal: Vector2<f64>,
    pub(super) centre: Vector2<f64>,
    /// Whether the common factor of assumed focal lengths applies.
    pub(super) assumed: bool,
    /// Standard deviation of a pixel of a match.
    pub(super) noise: f64,
}

/// A point and the pixels where it was found.
#[derive(Debug, Clone)]
pub(super) struct Observed {
    pub(super) anchor: usize,
    pub(super) pixel: Point2<f64>,
    /// One over the depth at the anchor.
    pub(super) inverse_depth: f64,
    /// Logarithm of the prior's depth at the anchor.
    pub(super) prior: Option<f64>,
    /// Further photographs and the pixels there.
    pub(super) views: Vec<(usize, Point2<f64>)>,
}

/// Poses as they were before, and how well each but the reference's was known.
#[derive(Debug, Clone)]
pub(super) struct Given {
    pub(super) poses: Vec<Pose>,
    /// Radians.
    pub(super) rotation_sigma: f64,
    /// Of a camera's centre, in the unit of the poses.
    pub(super) centre_sigma: f64,
}

/// The parameters of the photographs, and what they are held to; the first is the reference.
#[derive(Debug, Clone)]
pub(super) struct Cameras {
    pub(super) lenses: Vec<Lens>,
    pub(super) poses: Vec<Pose>,
    /// Poses that are kept, the reference's at least.
    pub(super) fixed: Vec<bool>,
    /// Logarithm of the common factor of the assumed focal lengths.
    pub(super) log_focal: f64,
    /// Standard deviation of that logarithm.
    pub(super) focal_sigma: f64,
    /// Radial distortion of all photographs, where it is adjusted: see [`Lens::bend`].
    radial: Option<f64>,
    /// Logarithmic scale of each photograph's prior. The reference's is kept, which gives the poses their unit.
    pub(super) log_scales: Vec<f64>,
    /// Standard deviation of the logarithm of each photograph's prior, per track.
    pub(super) prior_sigmas: Vec<f64>,
    pub(super) given: Option<Given>,
}

/// All that is adjusted, and what it is adjusted to.
#[derive(Debug, Clone)]
pub(super) struct Bundle {
    pub(super) cameras: Cameras,
    pub(super) tracks: Vec<Observed>,
}

/// A track in a view.
struct Seen {
    rotation: Matrix3<f64>,
    translation: Vector3<f64>,
    /// The anchor's ray of z = 1.
    ray: Vector3<f64>,
    /// The point in the view's frame over its depth at the anchor.
    point: Vector3<f64>,
}

/// Residual of an observation over its noise, and its derivatives.
struct Linear {
    residual: Vector2<f64>,
    anchor: Matrix2x6,
    view: Matrix2x6,
    depth: Vector2<f64>,
    focal: Vector2<f64>,
    radial: Vector2<f64>,
}

/// Where the parameters of a bundle are in its vector.
struct Layout {
    poses: Vec<Option<usize>>,
    scales: Vec<Option<usize>>,
    focal: Option<usize>,
    radial: Option<usize>,
    size: usize,
}

/// Normal equations with the depths eliminated.
struct Normal {
    matrix: DMatrix<f64>,
    vector: DVector<f64>,
    depths: Vec<DepthRow>,
}

/// A track's row of the normal equations.
struct DepthRow {
    /// What the depth shares with the other parameters.
    shared: Vec<(usize, f64)>,
    curvature: f64,
    slope: f64,
}

/// Huber's loss of a squared residual, and the weight of its square: quadratic to 1, linear beyond.
fn huber(squared: f64) -> (f64, f64) {
    if squared <= 1.0 { (0.5 * squared, 1.0) } else { (squared.sqrt() - 0.5, squared.sqrt().recip()) }
}

impl Lens {
    /// With that logarithm of the common factor of the assumed focal lengths.
    fn focal(&self, log_factor: f64) -> Vector2<f64> {
        if self.assumed { self.focal * log_factor.exp() } else { self.focal }
    }

    /// \\( (p - c)\, \lVert p - c \rVert^2 / \lVert c \rVert^2 \\): with a radial distortion \\( k \\) the pixel without it is \\( p \\) plus \\( k \\) times this, so
    /// that a corner moves by that share of its distance from the centre.
    fn bend(&self, pixel: &Point2<f64>) -> Vector2<f64> {
        let from = pixel.coords - self.centre;
        from * (from.norm_squared() / self.centre.norm_squared())
    }

    /// The ray of z = 1 of a pixel.
    pub(super) fn ray(&self, pixel: &Point2<f64>, log_factor: f64) -> Vector3<f64> {
        (pixel.coords - self.centre).component_div(&self.focal(log_factor)).push(1.0)
    }

    /// The pixel of a point in front of the camera.
    pub(super) fn project(&self, point: &Vector3<f64>, log_factor: f64) -> Vector2<f64> {
        (point.xy() / point.z).component_mul(&self.focal(log_factor)) + self.centre
    }
}

impl Cameras {
    /// Only the reference's pose is kept; the priors are as good as they are before the matches of so many tracks measure them.
    pub(super) fn new(lenses: Vec<Lens>, poses: Vec<Pose>, tracks: usize) -> Self {
        let count = poses.len();
        Self {
            lenses,
            poses,
            fixed: (0..count).map(|v| v == 0).collect(),
            log_focal: 0.0,
            radial: None,
            focal_sigma: FOCAL_SIGMA / shared_error_factor(tracks),
            log_scales: vec![0.0; count],
            prior_sigmas: vec![PRIOR_SIGMA * shared_error_factor(tracks); count],
            given: None,
        }
    }

    /// A pixel of a photograph without the distortion.
    fn straight(&self, view: usize, pixel: &Point2<f64>) -> Point2<f64> {
        self.radial.map_or(*pixel, |radial| pixel + radial * self.lenses[view].bend(pixel))
    }

    fn seen(&self, track: &Observed, view: usize) -> Seen {
        let motion = self.poses[view] * self.poses[track.anchor].inverse();
        let rotation = motion.rotation.to_rotation_matrix().into_inner();
        let pixel = self.straight(track.anchor, &track.pixel);
        let ray = self.lenses[track.anchor].ray(&pixel, self.log_focal);
        let point = rotation * ray + motion.translation.vector * track.inverse_depth;
        Seen { rotation, translation: motion.translation.vector, ray, point }
    }

    /// Depth of a track in a view.
    pub(super) fn depth(&self, track: &Observed, view: usize) -> f64 {
        self.seen(track, view).point.z / track.inverse_depth
    }

    fn project(&self, view: usize, point: &Vector3<f64>) -> Option<Vector2<f64>> {
        (point.z > NEAR).then(|| self.lenses[view].project(point, self.log_focal))
    }

    /// Residual of a track in a view, over the noise; nothing for a point behind it.
    pub(super) fn residual(
        &self,
        track: &Observed,
        view: usize,
        pixel: &Point2<f64>,
    ) -> Option<Vector2<f64>> {
        let seen = self.seen(track, view);
        let found = self.straight(view, pixel).coords;
        Some((self.project(view, &seen.point)? - found) / self.lenses[view].noise)
    }

    /// By how much the baseline moves a track in a view, over the noise: from where its direction alone would land.
    pub(super) fn parallax(&self, track: &Observed, view: usize) -> Option<f64> {
        let seen = self.seen(track, view);
        let moved = self.project(view, &seen.point)? - self.project(view, &(seen.rotation * seen.ray))?;
        Some(moved.norm() / self.lenses[view].noise)
    }

    fn linear(&self, track: &Observed, view: usize, pixel: &Point2<f64>) -> Option<Linear> {
        let Seen { rotation, translation, ray, point } = self.seen(track, view);
        let lens = &self.lenses[view];
        let at = self.project(view, &point)?;
        let f = lens.focal(self.log_focal);
        let (x, y, w) = (point.x / point.z, point.y / point.z, point.z.recip());
        let onto = Matrix2x3::new(f.x * w, 0.0, -f.x * x * w, 0.0, f.y * w, -f.y * y * w) / lens.noise;

        let inverse_depth = track.inverse_depth;
        let part = |moved: Matrix3<f64>, turned: Matrix3<f64>| {
            let mut part = Matrix2x6::zeros();
            part.fixed_columns_mut::<3>(0).copy_from(&(onto * moved));
            part.fixed_columns_mut::<3>(3).copy_from(&(onto * turned));
            part
        };
        let mut focal = Vector2::zeros();
        if lens.assumed {
            focal += (at - lens.centre) / lens.noise;
        }
        let anchor = &self.lenses[track.anchor];
        let moved = anchor.bend(&track.pixel).component_div(&anchor.focal(self.log_focal));
        if anchor.assumed {
            focal -= onto * (rotation * Vector3::new(ray.x, ray.y, 0.0));
        }
        Some(Linear {
            residual: (at - self.straight(view, pixel).coords) / lens.noise,
            anchor: part(-rotation * inverse_depth, rotation * ray.cross_matrix()),
            view: part(Matrix3::identity() * inverse_depth, -point.cross_matrix()),
            depth: onto * translation * if track.prior.is_some() { -inverse_depth } else { 1.0 },
            focal,
            radial: onto * rotation * moved.push(0.0) - lens.bend(pixel) / lens.noise,
        })
    }

    fn prior_residual(&self, track: &Observed) -> Option<f64> {
        let deviation = -track.inverse_depth.ln() - track.prior? - self.log_scales[track.anchor];
        Some(deviation / self.prior_sigmas[track.anchor])
    }

    /// Residual of each pose but the reference's against the one that was given, and the derivative by the left perturbation.
    fn pose_residuals(&self) -> impl Iterator<Item = (usize, Vector6<f64>, Matrix6<f64>)> {
        self.given.iter().flat_map(|given| {
            (1..self.poses.len()).map(|v| {
                let (pose, before) = (&self.poses[v], &given.poses[v]);
                let turn = (pose.rotation * before.rotation.inverse()).scaled_axis();
                let moved = (centre(pose) - centre(before)) / given.centre_sigma;
                let residual = twist(&moved, &(turn / given.rotation_sigma));
                let mut slope = Matrix6::zeros();
                let back = pose.rotation.inverse().to_rotation_matrix().into_inner();
                let turning = inverse_left_jacobian(&turn) / given.rotation_sigma;
                slope.fixed_view_mut::<3, 3>(0, 0).copy_from(&(-back / given.centre_sigma));
                slope.fixed_view_mut::<3, 3>(3, 3).copy_from(&turning);
                (v, residual, slope)
            })
        })
    }

    fn track_cost(&self, track: &Observed) -> f64 {
        let seen = track.views.iter().map(|(view, pixel)| {
            let squared = self.residual(track, *view, pixel).map_or(BEHIND * BEHIND, |r| r.norm_squared());
            huber(squared).0
        });
        seen.sum::<f64>() + self.prior_residual(track).map_or(0.0, |r| huber(r * r).0)
    }
}

impl Bundle {
    /// Measures the spread of each photograph's prior about the depths, of the tracks with more parallax than the median, and
    /// widens it by the root of the tracks that share an error. The focal length's deviation is over the noise of the matches, which count
    /// as if it were [`Lens::noise`].
    pub(super) fn measure_priors(&mut self) {
        self.cameras.focal_sigma = FOCAL_SIGMA / self.shared_noise();
        let Cameras { poses, log_scales, prior_sigmas, .. } = &mut self.cameras;
        for (anchor, sigma) in prior_sigmas.iter_mut().enumerate() {
            let deviation = |track: &Observed| {
                let deviation = -track.inverse_depth.ln() - track.prior? - log_scales[anchor];
                let moved = |v: usize| (poses[v] * poses[anchor].inverse()).translation.vector;
                let longest = track.views.iter().map(|(v, _)| moved(*v).norm()).fold(0.0, f64::max);
                Some((longest * track.inverse_depth, deviation))
            };
            let own = || self.tracks.iter().filter(|track| track.anchor == anchor);
            let mut deviations: Vec<(f64, f64)> =
                own().filter(|track| track.inverse_depth > 0.0).filter_map(deviation).collect();
            if deviations.len() < FEW || is_flat(own().filter_map(|track| track.prior)) {
                continue;
            }
            deviations.sort_by(|a, b| b.0.total_cmp(&a.0));
            let half = &deviations[..deviations.len().div_ceil(2)];
            if let Some(spread) = robust_deviation(half.iter().map(|(_, deviation)| *deviation)) {
                *sigma = spread.max(LEAST_SPREAD) * shared_error_factor(deviations.len());
            }
        }
    }

    /// The sum of the losses: Huber's of every observation over its noise and of every prior residual, squares of the rest.
    pub(super) fn cost(&self) -> f64 {
        let cameras = &self.cameras;
        let tracks: f64 = self.tracks.iter().map(|track| cameras.track_cost(track)).sum();
        let poses: f64 = cameras.pose_residuals().map(|(_, r, _)| 0.5 * r.norm_squared()).sum();
        tracks + poses + 0.5 * (cameras.log_focal / cameras.focal_sigma).powi(2)
    }

    fn layout(&self) -> Layout {
        let Cameras { lenses, fixed, .. } = &self.cameras;
        let count = fixed.len();
        let mut size = 0;
        let mut take = |needed: bool, width: usize| {
            let at = size;
            size += if needed { width } else { 0 };
            needed.then_some(at)
        };
        let mut used = vec![false; count];
        let mut has_prior = vec![false; count];
        for track in &self.tracks {
            used[track.anchor] = true;
            has_prior[track.anchor] |= track.prior.is_some();
            track.views.iter().for_each(|(view, _)| used[*view] = true);
        }
        let poses = (0..count).map(|v| take(!fixed[v] && used[v], 6)).collect();
        let scales = (0..count).map(|v| take(has_prior[v] && v != 0, 1)).collect();
        let focal = take(lenses.iter().any(|lens| lens.assumed), 1);
        let radial = take(self.cameras.radial.is_some(), 1);
        Layout { poses, scales, focal, radial, size }
    }

    /// Normal equations before any elimination; observations count as if their noise were `noise` times as large.
    fn normal(&self, layout: &Layout, noise: f64) -> Normal {
        let mut matrix = DMatrix::zeros(layout.size, layout.size);
        let mut vector = DVector::zeros(layout.size);
        let mut depths = Vec::with_capacity(self.tracks.len());
        // Columns of the derivative by the parameters that an observation has.
        let mut columns: Vec<(usize, Vector2<f64>)> = Vec::new();
        let cameras = &self.cameras;
        for track in &self.tracks {
            let mut shared = vec![];
            let (mut curvature, mut slope) = (0.0, 0.0);
            let mut share = |index: usize, value: f64| match shared.iter_mut().find(|(i, _)| *i == index) {
                Some((_, sum)) => *sum += value,
                None => shared.push((index, value)),
            };
            for (view, pixel) in &track.views {
                let Some(linear) = cameras.linear(track, *view, pixel) else { continue };
                let weight = huber(linear.residual.norm_squared()).1 / (noise * noise);
                columns.clear();
                let parts = [(track.anchor, &linear.anchor), (*view, &linear.view)];
                for (start, part) in parts.map(|(v, part)| (layout.poses[v], part)) {
                    let six = start.into_iter().flat_map(|start| start..start + 6);
                    columns.extend(six.zip(part.column_iter().map(|column| column.into_owned())));
                }
                columns.extend(layout.focal.map(|index| (index, linear.focal)));
                columns.extend(layout.radial.map(|index| (index, linear.radial)));
                for &(i, a) in &columns {
                    vector[i] += weight * a.dot(&linear.residual);
                    share(i, weight * a.dot(&linear.depth));
                    for &(j, b) in columns.iter().filter(|(j, _)| *j <= i) {
                        matrix[(i, j)] += weight * a.dot(&b);
                    }
                }
                curvature += weight * linear.depth.norm_squared();
                slope += weight * linear.depth.dot(&linear.residual);
            }
            if let Some(residual) = cameras.prior_residual(track) {
                let weight = huber(residual * residual).1;
                let unit = cameras.prior_sigmas[track.anchor].recip();
                curvature += weight * unit * unit;
                slope += weight * unit * residual;
                if let Some(index) = layout.scales[track.anchor] {
                    share(index, -weight * unit * unit);
                    matrix[(index, index)] += weight * unit * unit;
                    vector[index] -= weight * unit * residual;
                }
            }
            depths.push(DepthRow { shared, curvature, slope });
        }
        for (v, residual, slope) in cameras.pose_residuals() {
            let Some(start) = layout.poses[v] else { continue };
            let (square, gradient) = (slope.transpose() * slope, slope.transpose() * residual);
            for i in 0..6 {
                vector[start + i] += gradient[i];
                (0..=i).for_each(|j| matrix[(start + i, start + j)] += square[(i, j)]);
            }
        }
        if let Some(index) = layout.focal {
            matrix[(index, index)] += cameras.focal_sigma.powi(-2);
            vector[index] += cameras.log_focal * cameras.focal_sigma.powi(-2);
        }
        Normal { matrix, vector, depths }
    }

    /// Levenberg and Marquardt's steps until one gains less than 1e-9 of the cost. No step that raises the cost is kept.
    pub(super) fn adjust(&mut self, steps: usize) {
        let layout = self.layout();
        let mut cost = self.cost();
        let [mut damping, least, most] = DAMPING;
        let mut normal = self.normal(&layout, 1.0);
        for _ in 0..steps {
            let cameras = self.cameras.clone();
            let depths: Vec<f64> = self.tracks.iter().map(|track| track.inverse_depth).collect();
            let moved = normal.step(damping).map(|(common, depths)| self.step(&layout, &common, &depths));
            let next_cost = moved.map_or(f64::INFINITY, |()| self.cost());
            if next_cost < cost {
                let gain = cost - next_cost;
                cost = next_cost;
                damping = (damping * 0.1).max(least);
                if gain <= TOLERANCE * cost {
                    break;
                }
                normal = self.normal(&layout, 1.0);
            } else {
                self.cameras = cameras;
                self.tracks.iter_mut().zip(depths).for_each(|(track, depth)| track.inverse_depth = depth);
                damping *= 10.0;
                if damping > most {
                    break;
                }
            }
        }
    }

    fn step(&mut self, layout: &Layout, common: &DVector<f64>, depths: &[f64]) {
        let cameras = &mut self.cameras;
        for (pose, start) in cameras.poses.iter_mut().zip(&layout.poses) {
            if let Some(start) = start {
                *pose = exp(&common.fixed_rows::<6>(*start).into_owned()) * *pose;
                pose.rotation.renormalize();
            }
        }
        for (scale, index) in cameras.log_scales.iter_mut().zip(&layout.scales) {
            *scale += index.map_or(0.0, |i| common[i]);
        }
        cameras.log_focal += layout.focal.map_or(0.0, |i| common[i]);
        cameras.radial = cameras.radial.zip(layout.radial).map(|(radial, i)| radial + common[i]);
        for (track, step) in self.tracks.iter_mut().zip(depths) {
            let [least, most] = INVERSE_DEPTH;
            track.inverse_depth = if track.prior.is_some() {
                (track.inverse_depth * (-step).exp()).clamp(least, most)
            } else {
                (track.inverse_depth + step).clamp(-most, most)
            };
        }
    }

    /// Brings all to the unit in which the reference's prior is right on the whole.
    pub(super) fn rescale_to_prior(&mut self) {
        let anchored = self.tracks.iter().filter(|track| track.anchor == 0);
        let logs = anchored.filter_map(|track| Some(-track.inverse_depth.ln() - track.prior?));
        let Some(log) = median(logs) else { return };
        self.cameras.poses.iter_mut().for_each(|pose| pose.translation.vector *= (-log).exp());
        self.tracks.iter_mut().for_each(|track| track.inverse_depth *= log.exp());
        self.cameras.log_scales.iter_mut().skip(1).for_each(|scale| *scale -= log);
    }

    /// Covariance of the poses if a pixel's standard deviation is `noise` times that of [`Lens::noise`]. Where no pose is given the length
    /// of all translations together, the unit, counts as known. Poses are exact where they are kept, and where the normal equations are
    /// singular. Beside it the variance of the logarithm of the assumed focal lengths' common factor.
    pub(super) fn covariance(&self, noise: f64) -> (PoseCovariance, Option<f64>) {
        let layout = self.layout();
        let matrix = self.normal(&layout, noise).reduced(0.0).0;
        let mut along = DVector::zeros(matrix.nrows());
        if self.cameras.given.is_none() {
            for (start, pose) in layout.poses.iter().zip(&self.cameras.poses) {
                let Some(start) = *start else { continue };
                along.fixed_rows_mut::<3>(start).copy_from(&pose.translation.vector);
            }
        }
        let inverse = matrix.cholesky().map(|factor| {
            let inverse = factor.inverse();
            let spread = &inverse * &along;
            let variance = along.dot(&spread);
            // Given that the translations' sum along themselves does not change.
            if variance > 0.0 { inverse - &spread * spread.transpose() / variance } else { inverse }
        });
        let of_focal = layout.focal.and_then(|at| Some(inverse.as_ref()?[(at, at)]));
        let rows = 6 * layout.poses.iter().flatten().count();
        let of_poses = inverse.map(|inverse| inverse.view_range(..rows, ..rows).into_owned());
        (PoseCovariance::new(&layout.poses, of_poses), of_focal)
    }
}

impl Normal {
    /// The equations of all but the depths, with a full symmetric matrix, damped.
    fn reduced(&self, damping: f64) -> (DMatrix<f64>, DVector<f64>) {
        let (mut matrix, mut vector) = (self.matrix.clone(), self.vector.clone());
        for i in 0..matrix.nrows() {
            matrix[(i, i)] += damping * matrix[(i, i)].max(1e-12);
        }
        for DepthRow { shared, curvature, slope } in &self.depths {
            let inverse = self::inverse(*curvature, damping);
            for &(i, a) in shared {
                vector[i] -= a * slope * inverse;
                for &(j, b) in shared.iter().filter(|(j, _)| *j <= i) {
                    matrix[(i, j)] -= a * b * inverse;
                }
            }
        }
        matrix.fill_upper_triangle_with_lower_triangle();
        (matrix, vector)
    }

    fn step(&self, damping: f64) -> Option<(DVector<f64>, Vec<f64>)> {
        let (matrix, vector) = self.reduced(damping);
        let common = -matrix.cholesky()?.solve(&vector);
        let depth = |DepthRow { shared, curvature, slope }: &DepthRow| {
            let rest: f64 = shared.iter().map(|&(i, a)| a * common[i]).sum();
            -(slope + rest) * inverse(*curvature, damping)
        };
        let depths: Vec<f64> = self.depths.iter().map(depth).collect();
        let finite = common.iter().chain(&depths).all(|x| x.is_finite());
        finite.then_some((common, depths))
    }
}

/// One over a damped curvature; 0 where there is none, so that the depth stays.
fn inverse(curvature: f64, damping: f64) -> f64 {
    if curvature > 0.0 { (curvature * (1.0 + damping)).recip() } else { 0.0 }
}

/// A twist of its two parts.
pub(super) fn twist(translation: &Vector3<f64>, rotation: &Vector3<f64>) -> Vector6<f64> {
    let (t, r) = (translation, rotation);
    Vector6::new(t.x, t.y, t.z, r.x, r.y, r.z)
}

/// The rigid motion of a twist: translation first, rotation vector second, each applied on its own.
///
/// To first order this is the exponential of se(3). The optimisation only needs a smooth parametrisation of a neighbourhood.
pub(super) fn exp(delta: &Vector6<f64>) -> Pose {
    let turn = UnitQuaternion::from_scaled_axis(delta.fixed_rows::<3>(3).into_owned());
    Pose::from_parts(Translation3::from(delta.fixed_rows::<3>(0).into_owned()), turn)
}

/// \\( J_l^{-1}(\phi) = I - \frac12 [\phi]_\times + c [\phi]_\times^2 \\): how a rotation vector changes as its rotation is
/// turned from the left.
fn inverse_left_jacobian(turn: &Vector3<f64>) -> Matrix3<f64> {
    let (half, cross) = (0.5 * turn.norm(), turn.cross_matrix());
    let factor = if half < 5e-5 { 1.0 / 12.0 } else { (1.0 - half / half.tan()) / (4.0 * half * half) };
    Matrix3::identity() - cross * 0.5 + cross * cross * factor
}

#[cfg(test)]
mod tests;
