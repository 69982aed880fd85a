//! The training rays of a step.

use crate::config::TrainConfig;
use crate::frustum::{Frustum, Ray};
use crate::loss::Target;
use crate::march::March;
use crate::{Error, Result};
use mde_uncertainty::random::CounterRng;
use mde_warp::PosedView;
use rand::RngExt;
use rayon::prelude::*;

/// The valid pixels of all views.
pub(crate) struct Pixels<'v> {
    pub(crate) views: &'v [PosedView],
    frustum: &'v Frustum,
    /// Per view the least depth at which its rays begin, where rays are clipped; the volume alone limits view 0.
    nearest: Vec<f64>,
    /// Per view the flat indices of the valid pixels whose rays meet the volume.
    trainable: Vec<Vec<u32>>,
    /// Views other than the first with at least one valid pixel.
    others: Vec<usize>,
    original_share: f64,
}

impl<'v> Pixels<'v> {
    /// # Errors
    /// [`Error::NoPixels`] where no view has a valid pixel whose ray meets the volume.
    pub(crate) fn new(views: &'v [PosedView], frustum: &'v Frustum, config: &TrainConfig) -> Result<Self> {
        let begin =
            |(index, view): (usize, &PosedView)| if index == 0 { 0.0 } else { Frustum::nearest_of(view) };
        let nearest: Vec<f64> = views.iter().enumerate().map(begin).collect();
        let of_view = |(index, view): (usize, &PosedView)| {
            let valid = view.mask.iter().enumerate().filter(|(_, valid)| **valid).map(|(pixel, _)| pixel);
            let seen = valid.filter(|&pixel| inside(frustum, view, pixel, nearest[index], index == 0));
            seen.map(|pixel| pixel as u32).collect()
        };
        let trainable: Vec<Vec<u32>> = views.par_iter().enumerate().map(of_view).collect();
        let others: Vec<usize> = (1..views.len()).filter(|&v| !trainable[v].is_empty()).collect();
        let original_share = match (trainable.first().is_none_or(Vec::is_empty), others.is_empty()) {
            (true, true) => return Err(Error::NoPixels),
            (true, false) => 0.0,
            (false, true) => 1.0,
            (false, false) => config.original_share,
        };
        Ok(Self { views, frustum, nearest, trainable, others, original_share })
    }

    /// Ray `index` of step `step`: a random valid pixel of a random view, before a random background.
    pub(crate) fn draw(&self, seed: u64, step: usize, index: usize) -> (March, Target) {
        let mut rng = CounterRng::new(seed, "ray", step as u64, index as u64);
        let view = if rng.random::<f64>() < self.original_share {
            0
        } else {
            self.others[rng.random_range(0..self.others.len())]
        };
        let pixel = self.trainable[view][rng.random_range(0..self.trainable[view].len())];
        let background = std::array::from_fn(|_| rng.random::<f64>());
        let posed = &self.views[view];
        let (row, column) = (pixel as usize / posed.camera.width, pixel as usize % posed.camera.width);
        let known =
            posed.hypotheses.iter().filter_map(|h| h.get(row, column)).filter(|&(mean, _)| mean > 0.0);
        let depths: Vec<(f64, f64)> = known.map(|(mean, variance)| (mean.into(), variance.into())).collect();
        let ray = Ray::new(&posed.camera, &posed.pose, column as f64, row as f64);
        let interval = self.frustum.interval(&ray, self.nearest[view]);
        let guess = depths.first().map(|d| d.0);
        let colour = std::array::from_fn(|axis| f64::from(posed.image[(row, column, axis)]));
        (March { ray, interval, guess, background, rng: Some(rng) }, Target { colour, depths })
    }
}

/// Whether the ray of a pixel meets the volume and, except for the original view, its first hypothesis lies inside.
fn inside(frustum: &Frustum, view: &PosedView, pixel: usize, nearest: f64, original: bool) -> bool {
    if !frustum.clipped {
        return true;
    }
    let (row, column) = (pixel / view.camera.width, pixel % view.camera.width);
    let ray = Ray::new(&view.camera, &view.pose, column as f64, row as f64);
    let Some(interval) = frustum.interval(&ray, nearest) else { return false };
    let depth = view.hypotheses.iter().find_map(|h| h.get(row, column)).filter(|&(mean, _)| mean > 0.0);
    original || depth.is_none_or(|(mean, _)| interval.contains(mean.into()))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::{SamplingConfig, VolumeConfig};
    use mde_uncertainty::GaussianDepth;
    use mde_warp::{PinholeCamera, Pose};
    use nalgebra::Vector3;
    use ndarray::{Array2, Array3};

    const SIZE: (usize, usize) = (6, 8);

    /// A view whose red channel is `red`; one pixel in five is not valid.
    fn view(red: f32) -> PosedView {
        let (height, width) = SIZE;
        let image = Array3::from_shape_fn((height, width, 3), |(_, _, c)| if c == 0 { red } else { 0.0 });
        let camera = PinholeCamera::from_fov(60.0, width, height).unwrap();
        let mask = Array2::from_shape_fn(SIZE, |(y, x)| !(y * width + x).is_multiple_of(5));
        PosedView::new(image, camera, Pose::identity(), mask, Vec::new()).unwrap()
    }

    fn depths_1_to_4(volume: VolumeConfig) -> SamplingConfig {
        SamplingConfig { near: Some(1.0), far: Some(4.0), volume, ..SamplingConfig::default() }
    }

    #[test]
    fn rays_are_drawn_from_valid_pixels_and_view_0_gets_its_share() {
        let views = [view(0.0), view(0.5), view(1.0)];
        let config = TrainConfig { original_share: 0.4, ..TrainConfig::default() };
        let frustum = Frustum::of_views(&views, &depths_1_to_4(VolumeConfig::Hull)).unwrap();
        let pixels = Pixels::new(&views, &frustum, &config).unwrap();
        let mut counts = [0; 3];
        let draws = 5000;
        for index in 0..draws {
            let (march, target) = pixels.draw(3, 7, index);
            let (camera, d) = (&views[0].camera, march.ray.direction);
            let [x, y] = [d.x / d.z * camera.fx + camera.cx, d.y / d.z * camera.fy + camera.cy];
            assert!(views[0].mask[(y.round() as usize, x.round() as usize)]);
            counts[(2.0 * target.colour[0]) as usize] += 1;
        }
        // Four standard deviations of a binomial share.
        for (count, share) in counts.into_iter().zip([0.4, 0.3, 0.3]) {
            let deviation = (share * (1.0 - share) / draws as f64).sqrt();
            assert!((f64::from(count) / draws as f64 - share).abs() < 4.0 * deviation, "{counts:?}");
        }
    }

    /// A view turned away has no pixel; in a view from aside, only those remain whose ray meets the volume and whose
    /// hypothesis lies in it. Every ray drawn has an interval.
    #[test]
    fn rays_outside_the_volume_are_not_drawn() {
        let at = |pose: Pose, depth: f32| {
            let known = GaussianDepth::new(Array2::from_elem(SIZE, depth), Array2::zeros(SIZE)).unwrap();
            PosedView { pose, hypotheses: vec![known], ..view(0.5) }
        };
        let turned = Pose::rotation(Vector3::new(0.0, std::f64::consts::PI, 0.0));
        let aside = Pose::translation(-1.0, 0.0, 0.0);
        let views = [
            at(Pose::identity(), 2.0),
            at(turned, 2.0),
            at(aside, 2.0),
            at(aside, 9.0),
            at(Pose::identity(), 9.0),
        ];
        let frustum = Frustum::of_views(&views, &depths_1_to_4(VolumeConfig::Reference)).unwrap();
        let pixels = Pixels::new(&views, &frustum, &TrainConfig::default()).unwrap();
        let valid = views[0].mask.iter().filter(|valid| **valid).count();
        let counts: Vec<usize> = pixels.trainable.iter().map(Vec::len).collect();
        assert_eq!((counts[0], counts[1], counts[3], counts[4]), (valid, 0, 0, 0));
        // At depth 2 and 60 degrees the image is 2.3 wide: a step of 1 aside loses 43 % of the columns, less the margin.
        let lost = valid - counts[2];
        assert!((valid / 4..valid * 6 / 10).contains(&lost), "{lost} of {valid}");
        assert_eq!(pixels.others, [2]);
        assert!((0..200).all(|index| pixels.draw(0, 0, index).0.interval.is_some()));
        // The original view keeps a pixel whose hypothesis is beyond far.
        let beyond = [at(Pose::identity(), 9.0)];
        let beyond = Pixels::new(&beyond, &frustum, &TrainConfig::default()).unwrap();
        assert_eq!(beyond.trainable[0].len(), valid);
    }
}
