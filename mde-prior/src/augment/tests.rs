use super::*;
use crate::DepthKind;
use crate::resample::{Filter, resize};
use proptest::prelude::*;

/// A model by its prediction.
struct Model<F: Fn(ArrayView3<'_, f32>) -> Result<PriorDepth>>(F);

impl<F: Fn(ArrayView3<'_, f32>) -> Result<PriorDepth> + Sync> DepthPrior for Model<F> {
    fn predict(&self, image: ArrayView3<'_, f32>) -> Result<PriorDepth> {
        (self.0)(image)
    }
}

/// Takes the red channel for depth, seen through a small input: the mean over blocks of a grid.
fn seen(image: ArrayView3<'_, f32>, cells: usize) -> Array2<f32> {
    let red = image.index_axis(Axis(2), 0);
    let small = resize(red, (cells, cells), Filter::BilinearAntialias);
    resize(small.view(), red.dim(), Filter::Bilinear)
}

fn coarse(kind: DepthKind) -> impl DepthPrior {
    Model(move |image| PriorDepth::from_values(seen(image, 14), kind))
}

/// A slanted floor with a box before it.
fn picture() -> Array3<f32> {
    Array3::from_shape_fn((60, 80, 3), |(y, x, _)| {
        let before = (20..44).contains(&x) && (15..40).contains(&y);
        if before { 0.25 } else { 0.6 + 0.003 * (x + y) as f32 }
    })
}

fn error(map: &Array2<f32>, picture: &Array3<f32>) -> f64 {
    let truth = picture.index_axis(Axis(2), 0);
    map.iter().zip(truth).map(|(a, b)| f64::from((a.ln() - b.ln()).powi(2))).sum::<f64>() / map.len() as f64
}

#[test]
fn crops_add_the_detail_that_the_whole_image_lost() {
    let picture = picture();
    let augmented =
        AugmentationConfig::multi_crop().predict(&coarse(DepthKind::Metric), picture.view()).unwrap();
    let (before, after) = (error(&augmented.prior.map, &picture), error(&augmented.merged.map, &picture));
    assert!(after < 0.7 * before, "{before} {after}");
    assert_eq!(augmented.plan, Plan::new(Predictions::Auto, (60, 80), None));
    assert!(augmented.spread.iter().all(|s| s.is_finite() && *s >= 0.0));
    assert!(augmented.spread.iter().any(|s| *s > 0.0));
}

#[test]
fn crops_that_agree_with_the_whole_image_leave_the_map_as_it_is() {
    let image = Array3::from_shape_fn((24, 32, 3), |(y, x, _)| 0.2 + 0.01 * (x + y) as f32);
    let red =
        Model(|image| PriorDepth::from_values(image.index_axis(Axis(2), 0).to_owned(), DepthKind::Metric));
    let augmented = AugmentationConfig::multi_crop().predict(&red, image.view()).unwrap();
    let change = &augmented.merged.map - &augmented.prior.map;
    assert!(change.iter().all(|c| c.abs() < 0.02));
}

#[test]
fn a_disparity_gains_too_whatever_its_gauge() {
    let picture = picture();
    let config = AugmentationConfig::multi_crop();
    let [plain, other] = [(1.0, 0.0), (700.0, -90.0)].map(|(scale, shift)| {
        let affine = Model(|image| {
            PriorDepth::from_values(seen(image, 14).mapv(|d| scale * d + shift), DepthKind::AffineDisparity)
        });
        config.predict(&affine, picture.view()).unwrap()
    });
    for (a, b) in plain.merged.map.iter().zip(&other.merged.map) {
        assert!((a - (b + 90.0) / 700.0).abs() < 1e-3, "{a} {b}");
    }
    let squared = |map: &Array2<f32>| {
        map.iter().zip(picture.index_axis(Axis(2), 0)).map(|(a, b)| (a - b).powi(2)).sum::<f32>()
    };
    assert!(squared(&plain.merged.map) < 0.8 * squared(&plain.prior.map));
    let depth = plain.depth(&DisparityRule::default()).unwrap();
    assert!(plain.relative_spread(depth.view()).unwrap().iter().all(|s| s.is_finite() && *s >= 0.0));
}

#[test]
fn a_few_sharper_disparities_leave_the_depth_of_the_others_alone() {
    let model = coarse(DepthKind::AffineDisparity);
    let mut augmented = AugmentationConfig::default().predict(&model, picture().view()).unwrap();
    let rule = DisparityRule::default();
    let before = augmented.prior.to_depth(&rule).unwrap();
    let mut map = augmented.merged.map.clone();
    let sharper = map.len() / 20;
    map.iter_mut().take(sharper).for_each(|d| *d += 9.0);
    augmented.merged = PriorDepth::from_values(map, DepthKind::AffineDisparity).unwrap();
    let after = augmented.depth(&rule).unwrap();
    let moved = before.iter().zip(&after).filter(|(a, b)| a != b).count();
    assert!((1..=sharper).contains(&moved), "{moved} of {}", before.len());
    assert!(after.iter().all(|z| (rule.near..=rule.far).contains(&f64::from(*z))));
}

#[test]
fn without_augmentation_the_single_prediction_is_the_result() {
    let model = coarse(DepthKind::Metric);
    let augmented = AugmentationConfig::default().predict(&model, picture().view()).unwrap();
    assert_eq!((augmented.merged, augmented.plan.predictions()), (augmented.prior, 1));
}

#[test]
fn a_cancelled_augmentation_has_no_result() {
    let model = coarse(DepthKind::Metric);
    let mut calls = 0;
    let mut stop = |progress| {
        let Progress::Predicted { done, .. } = progress else { panic!("nothing is merged") };
        calls = done;
        if done > 5 { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
    };
    let config = AugmentationConfig::multi_crop();
    assert_eq!(config.predict_with(&model, picture().view(), None, &mut stop).unwrap(), None);
    assert_eq!(calls, 6);
}

#[test]
fn the_variance_of_crops_is_unbiased() {
    let mut changes = window::Changes::new((3, 4));
    [0.0, 2.0].iter().for_each(|v| changes.add((0, 0), Array2::from_elem((3, 4), *v).view()));
    let (mean, variance, _) = changes.mean_and_variance();
    assert!((mean - 1.0).iter().chain(&(variance - 2.0)).all(|off| off.abs() < 1e-4));
}

/// An image and its mirror image alone have a spread too.
#[test]
fn two_predictions_that_differ_have_a_spread() {
    let tilted = Model(|image| {
        let (height, width, _) = image.dim();
        let map = Array2::from_shape_fn((height, width), |(_, x)| 1.0 + 0.01 * x as f32);
        PriorDepth::from_values(map, DepthKind::Metric)
    });
    let config = AugmentationConfig { predictions: Predictions::Most(2), ..AugmentationConfig::default() };
    let augmented = config.predict(&tilted, picture().view()).unwrap();
    let (a, b) = (1.0_f32, 1.79_f32);
    assert!((augmented.merged.map[(7, 0)] - 0.5 * (a + b)).abs() < 1e-5);
    let (side, middle) = (augmented.spread[(7, 0)], augmented.spread[(7, 39)]);
    assert!((side - (0.5 * (a + b) / a).ln()).abs() < 1e-4, "{side}");
    assert_eq!(middle < 0.01, side > 0.1);
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(24))]

    /// Whatever the picture and its size, depths stay positive and finite, and a model in another unit gives the same map in that unit.
    #[test]
    fn any_picture_gives_depths_and_the_unit_does_not_matter(height in 1..30_usize, width in 1..30_usize, seed: u32, unit in 0.01..100.0_f32) {
        let noise = |y: usize, x: usize, c: usize| {
            let mix = (seed as usize).wrapping_add(y * 7919 + x * 104_729 + c * 31).wrapping_mul(2_654_435_761);
            0.05 + (mix >> 7) as u16 as f32 / 65536.0
        };
        let picture = Array3::from_shape_fn((height, width, 3), |(y, x, c)| noise(y, x, c));
        let of = |unit: f32| {
            let scaled = Model(move |image| PriorDepth::from_values(seen(image, 7).mapv(|d| unit * d), DepthKind::Metric));
            AugmentationConfig::multi_crop().predict(&scaled, picture.view()).unwrap().merged.map
        };
        let (plain, scaled) = (of(1.0), of(unit));
        for (a, b) in plain.iter().zip(&scaled) {
            prop_assert!(a.is_finite() && *a > 0.0);
            prop_assert!((a.ln() + unit.ln() - b.ln()).abs() < 0.01, "{} {}", a, b);
        }
    }
}

/// A crop that is all sky, where the model has no depth, leaves the other crops their detail.
#[test]
fn a_crop_without_a_usable_pixel_is_left_out() {
    let sky = Model(|image| {
        let red = image.index_axis(Axis(2), 0).to_owned();
        let valid = red.mapv(|v| v < 0.95);
        PriorDepth::with_mask(red, valid, DepthKind::Metric)
    });
    let mut picture = picture();
    let half = picture.dim().0 * 3 / 5;
    picture.slice_mut(s![..half, .., ..]).fill(1.0);
    picture.slice_mut(s![half.., .., ..]).mapv_inplace(|v| 0.3 + 0.5 * v.clamp(0.0, 1.0));
    let config = AugmentationConfig { predictions: Predictions::Most(30), ..AugmentationConfig::default() };
    let merged = config.predict(&sky, picture.view()).unwrap().merged;
    assert!(merged.valid.indexed_iter().all(|((y, _), valid)| *valid == (y >= half)));
    picture.fill(1.0);
    assert!(matches!(config.predict(&sky, picture.view()), Err(Error::Empty(_))));
}

#[test]
fn a_prediction_of_another_size_is_refused() {
    let picture = picture();
    let (height, width, _) = picture.dim();
    for size in [(2 * height, 2 * width), (height / 2, width / 2), (height, width + 1)] {
        let sized = Model(|_| PriorDepth::from_values(Array2::from_elem(size, 2.0), DepthKind::Metric));
        let refused = AugmentationConfig::multi_crop().predict(&sized, picture.view()).unwrap_err();
        assert!(refused.to_string().contains(&format!("{}x{}", size.1, size.0)), "{refused}");
    }
}
