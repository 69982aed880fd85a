//! Theorems about disparity, flips, resampling and specifications.

use crate::place;
use approx::assert_relative_eq;
use mde_prior::augment::flip_average;
use mde_prior::ndarray::{Array2, Array3, ArrayView3, array, s};
use mde_prior::resample::{Filter, resize};
use mde_prior::spec::{Aspect, PROFILES};
use mde_prior::{DepthKind, DepthPrior, DisparityRule, Error, ModelSpec, PriorDepth, Result};
use proptest::prelude::*;
use std::sync::atomic::{AtomicI32, Ordering};

const FILTERS: [Filter; 4] =
    [Filter::Bilinear, Filter::BilinearAlignCorners, Filter::BilinearAntialias, Filter::Bicubic];

fn rules() -> impl Strategy<Value = DisparityRule> {
    (0.01_f64..10.0, 1.01_f64..100.0, 0.0_f64..0.4, 0.6_f64..=1.0)
        .prop_map(|(near, ratio, low, high)| DisparityRule { near, far: near * ratio, low, high })
}

fn depth(values: Vec<f32>, rule: &DisparityRule) -> Vec<f32> {
    let row = Array2::from_shape_vec((1, values.len()), values).unwrap();
    let map = PriorDepth::from_values(row, DepthKind::AffineDisparity).unwrap();
    map.to_depth(rule).unwrap().into_raw_vec_and_offset().0
}

proptest! {
    #[test]
    fn depth_is_positive_and_falls_with_disparity(
        values in proptest::collection::vec(-1e4_f32..1e4, 1..60), rule in rules(),
    ) {
        let z = depth(values.clone(), &rule);
        for (&z, &d) in z.iter().zip(&values) {
            prop_assert!(f64::from(z) >= rule.near * (1.0 - 1e-6) && f64::from(z) <= rule.far * (1.0 + 1e-6), "{} of {}", z, d);
        }
        for i in 0..z.len() {
            for j in 0..z.len() {
                prop_assert!(values[i] < values[j] || z[i] <= z[j]);
            }
        }
    }

    #[test]
    fn depth_ignores_positive_affine_maps(
        values in proptest::collection::vec(-2000_i32..2000, 2..60), scale in 1_i32..60, shift in -5000_i32..5000,
        rule in rules(),
    ) {
        // Small integers are exact in f32, so nothing but the map itself changes.
        let z = depth(values.iter().map(|&d| d as f32).collect(), &rule);
        let mapped = depth(values.iter().map(|&d| (scale * d + shift) as f32).collect(), &rule);
        for (a, b) in z.iter().zip(&mapped) {
            prop_assert!((a - b).abs() <= 1e-5 * a, "{} became {}", a, b);
        }
    }

    #[test]
    fn flip_average_of_an_equivariant_prior_is_the_prior(
        values in proptest::collection::vec(0.0_f32..1.0, 3 * 4 * 5), disparity: bool,
    ) {
        let image = Array3::from_shape_vec((4, 5, 3), values)?;
        let kind = if disparity { DepthKind::AffineDisparity } else { DepthKind::Metric };
        // Depth where positive.
        let prior = Model(|red: Array2<f32>| PriorDepth::from_values(red - 0.5, kind));
        match prior.predict(image.view()) {
            Ok(alone) => prop_assert_eq!(averaged(&prior, image.view())?, alone),
            Err(_) => prop_assert!(averaged(&prior, image.view()).is_err()),
        }
    }

    #[test]
    fn a_flip_average_is_equivariant(values in proptest::collection::vec(0.1_f32..1.0, 3 * 4 * 5)) {
        let image = Array3::from_shape_vec((4, 5, 3), values)?;
        let mirrored = image.slice(s![.., ..;-1, ..]);
        // Red plus the column is not equivariant.
        let slanted = Model(|mut map: Array2<f32>| {
            map.indexed_iter_mut().for_each(|((_, x), v)| *v += x as f32);
            PriorDepth::from_values(map, DepthKind::RelativeDepth)
        });
        let average = averaged(&slanted, image.view())?.map;
        // But for the last bit: the gauge is a sum over the pixels, in another order.
        for (a, b) in averaged(&slanted, mirrored)?.map.iter().zip(average.slice(s![.., ..;-1])) {
            prop_assert!((a - b).abs() <= 1e-6 * b.abs(), "{} {}", a, b);
        }
        let alone = slanted.predict(image.view())?.map;
        prop_assert_ne!(slanted.predict(mirrored)?.map, alone.slice(s![.., ..;-1]));
    }

    #[test]
    fn resizing_keeps_constants_and_mirrors(
        (h, w) in (1_usize..9, 1_usize..9), (to_h, to_w) in (1_usize..20, 1_usize..20),
        seed in proptest::collection::vec(-1.0_f32..1.0, 81), constant in -5.0_f32..5.0,
    ) {
        let map = Array2::from_shape_fn((h, w), |(y, x)| seed[9 * y + x]);
        for filter in FILTERS {
            let flat = resize(Array2::from_elem((h, w), constant).view(), (to_h, to_w), filter);
            prop_assert!(flat.iter().all(|v| (v - constant).abs() < 1e-5), "{:?}", filter);
            let resized = resize(map.view(), (to_h, to_w), filter);
            prop_assert!(filter == Filter::Bicubic || resized.iter().all(|v| v.abs() <= 1.0));
            // With one output pixel there is no second corner: PyTorch takes the first.
            if filter != Filter::BilinearAlignCorners || to_w > 1 {
                let mirrored = resize(map.slice(s![.., ..;-1]), (to_h, to_w), filter);
                for (a, b) in mirrored.iter().zip(resized.slice(s![.., ..;-1])) {
                    prop_assert!((a - b).abs() < 1e-5, "{:?}", filter);
                }
            }
        }
    }

    #[test]
    fn input_sizes_keep_their_promises(h in 1_usize..3000, w in 1_usize..3000) {
        for name in PROFILES {
            let spec = ModelSpec::profile(name)?;
            let (height, width) = spec.input_size(h, w);
            prop_assert!(height % spec.multiple_of == 0 && width % spec.multiple_of == 0);
            match spec.aspect {
                Aspect::Squash => prop_assert_eq!((height, width), (spec.height, spec.width)),
                Aspect::KeepLowerBound => prop_assert!(height >= spec.height && width >= spec.width),
                Aspect::KeepUpperBound => prop_assert!(height <= spec.height && width <= spec.width),
                _ => prop_assert!(height == spec.height || width == spec.width),
            }
        }
    }
}

/// The flip average of a prior's predictions.
fn averaged(prior: &dyn DepthPrior, image: ArrayView3<'_, f32>) -> Result<PriorDepth> {
    let straight = prior.predict(image)?;
    flip_average(straight, &prior.predict(image.slice(s![.., ..;-1, ..]))?)
}

/// A model by its prediction of the red channel.
struct Model<F>(F);

impl<F: Fn(Array2<f32>) -> Result<PriorDepth> + Sync> DepthPrior for Model<F> {
    fn predict(&self, image: ArrayView3<'_, f32>) -> Result<PriorDepth> {
        (self.0)(image.slice(s![.., .., 0]).to_owned())
    }
}

#[test]
fn constant_disparity_is_the_middle_of_the_range() {
    let rule = DisparityRule::default();
    let middle = 2.0 / (1.0 / rule.near + 1.0 / rule.far);
    for value in [0.0_f32, -3.0, 1e6] {
        assert!(depth(vec![value; 9], &rule).iter().all(|&z| (f64::from(z) - middle).abs() < 1e-6));
    }
    for (low, high) in [(-0.1, 1.0), (0.5, 0.001)] {
        assert!(DisparityRule { low, high, ..rule.clone() }.validate().is_err());
    }
    // All but one pixel alike: the extremes take over, so the odd one still stands out.
    let mut values = vec![1.0; 2000];
    values[7] = 2.0;
    let z = depth(values, &rule);
    assert_relative_eq!(z[7], 0.8, epsilon = 1e-6);
    assert_relative_eq!(z[8], 8.0, epsilon = 1e-6);
}

#[test]
fn missing_stays_missing_and_garbage_is_missing() {
    let map = array![[f32::NAN, f32::INFINITY, 1.0, 2.0]];
    let prior = PriorDepth::from_values(map, DepthKind::AffineDisparity).unwrap();
    assert_eq!(prior.valid, array![[false, false, true, true]]);
    let rule = DisparityRule { low: 0.0, high: 1.0, ..DisparityRule::default() };
    assert_eq!(prior.to_depth(&rule).unwrap().mapv(|z| z > 0.0), prior.valid);
    // The fields are public, so a map may be tampered with.
    let tampered = PriorDepth {
        map: array![[f32::NAN, -1.0, 3.0]],
        valid: array![[true; 3]],
        ..PriorDepth::from_values(array![[1.0; 3]], DepthKind::Metric).unwrap()
    };
    assert_eq!(tampered.to_depth(&rule).unwrap(), array![[0.0, 0.0, 3.0]]);
    assert!(PriorDepth::from_values(array![[f32::NAN]], DepthKind::Metric).is_err());
    assert!(PriorDepth::with_mask(array![[1.0]], array![[true, true]], DepthKind::Metric).is_err());
}

#[test]
fn bicubic_is_opencv_and_antialias_is_pillow() {
    // Values from tests/reference/resample.py. cv2.resize(np.float32([[0, 0, 1, 0]]), (8, 1), interpolation=cv2.INTER_CUBIC)
    let wide = resize(array![[0.0_f32, 0.0, 1.0, 0.0]].view(), (1, 8), Filter::Bicubic);
    let expected = [0.0, -9.0, -27.0, 67.0, 225.0, 225.0, 67.0, -27.0].map(|v| v / 256.0);
    for (a, b) in wide.iter().zip(expected) {
        assert_relative_eq!(*a, b, epsilon = 1e-6);
    }
    // Image.fromarray(np.float32([[0, 0, 4, 0]])).resize((2, 1), Image.BILINEAR): weights 3, 3, 1 over 7
    let narrow = resize(array![[0.0_f32, 0.0, 4.0, 0.0]].view(), (1, 2), Filter::BilinearAntialias);
    assert_relative_eq!(narrow[[0, 0]], 4.0 / 7.0, epsilon = 1e-6);
    assert_relative_eq!(narrow[[0, 1]], 12.0 / 7.0, epsilon = 1e-6);
}

#[test]
fn input_sizes_are_those_of_the_reference_code() {
    let size = |name: &str, h, w| ModelSpec::profile(name).unwrap().input_size(h, w);
    assert_eq!(size("fastdepth", 480, 640), (224, 224));
    assert_eq!(size("midas-v2.1-small", 480, 640), (192, 256));
    assert_eq!(size("dpt-large", 480, 640), (384, 512));
    assert_eq!(size("depth-anything-v2", 640, 480), (686, 518));
}

#[test]
fn the_readmes_specification_is_one() {
    let readme = include_str!("../../README.md");
    let start = readme.find("```toml\n").unwrap() + "```toml\n".len();
    let block = &readme[start..start + readme[start..].find("```").unwrap()];
    let spec = ModelSpec::from_toml(block).unwrap();
    assert_eq!((spec.width, spec.multiple_of, spec.output), (518, 14, DepthKind::AffineDisparity));
}

#[test]
fn specifications_come_from_toml_or_the_name() {
    let (_folder, model) = place("midas_v21_small_256.onnx");
    assert_eq!(ModelSpec::guess(&model).unwrap(), ModelSpec::profile("midas-v2.1-small").unwrap());
    std::fs::write(model.with_extension("toml"), "output = 'depth'\nlayout = 'nhwc'\n").unwrap();
    let spec = ModelSpec::beside(&model).unwrap().unwrap();
    assert_eq!((spec.output, spec.width), (DepthKind::RelativeDepth, 224));
    for wrong in
        ["", "output = 'depht'", "output = 'metric'\nwidht = 3", "output = 'disparity'\noutput-floor = 1.0"]
    {
        std::fs::write(model.with_extension("toml"), wrong).unwrap();
        let message = ModelSpec::beside(&model).unwrap_err().to_string();
        assert!(message.contains("small_256.toml") && !message.contains('\n'), "{message}");
    }
    for (file, name) in [
        ("fastdepth_224.onnx", "fastdepth"),
        ("dpt_large_384.onnx", "dpt-large"),
        ("DPT-Hybrid.onnx", "dpt-hybrid"),
        ("depth_anything_v2_vits.onnx", "depth-anything-v2"),
        ("depth_anything_v2_metric_vkitti_vitl.onnx", "depth-anything-v2-metric-outdoor"),
    ] {
        assert_eq!(ModelSpec::guess(file).unwrap(), ModelSpec::profile(name).unwrap());
    }
    let error = ModelSpec::guess("model.onnx").unwrap_err();
    assert!(matches!(&error, Error::UnknownProfile { .. }));
    assert!(PROFILES.iter().all(|name| error.to_string().contains(name)));
    for name in PROFILES {
        let spec = ModelSpec::profile(name).unwrap();
        assert_eq!(ModelSpec::from_toml(&toml::to_string(&spec).unwrap()).unwrap(), spec);
    }
}

#[test]
fn a_flip_average_of_disparity_does_not_depend_on_scale_and_shift() {
    let image = Array3::from_shape_fn((3, 4, 3), |(y, x, _)| ((y * 7 + x * 5) % 11) as f32 / 11.0);
    // Another scale and shift at every call, as an affine-invariant network's may be.
    let calls = AtomicI32::new(0);
    let drifting = Model(|red: Array2<f32>| {
        let scale = 3.0_f32.powi(calls.fetch_add(1, Ordering::Relaxed) + 1);
        PriorDepth::from_values(red.mapv(|v| scale * v - scale), DepthKind::AffineDisparity)
    });
    let averaged = averaged(&drifting, image.view()).unwrap();
    calls.store(0, Ordering::Relaxed);
    let alone = drifting.predict(image.view()).unwrap();
    for (a, b) in averaged.map.iter().zip(&alone.map) {
        assert!((a - b).abs() < 1e-5, "{a} {b}");
    }
}
