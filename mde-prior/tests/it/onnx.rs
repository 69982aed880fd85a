//! Networks: FastDepth against its test vector, conventions against ONNX Runtime, models that are no depth models.

use crate::{assert_close, fixture, grey, pattern};
use std::ops::ControlFlow;
use std::path::Path;

use mde_prior::format::{ReadOptions, read_values};
use mde_prior::ndarray::Array3;
use mde_prior::resample::{Filter, resize};
use mde_prior::spec::{Aspect, Channels, Layout};
use mde_prior::{DepthKind, DepthPrior, DisparityRule, ModelSpec, OnnxPrior, PriorDepth, predict_each};

#[test]
#[ignore = "needs the networks and photographs that MDE_SHARED names"]
fn fastdepth_reproduces_its_test_vector() {
    let shared = std::env::var_os("MDE_SHARED").unwrap();
    let folder = Path::new(&shared).join("models/fastdepth");
    let model = folder.join("fastdepth_224.onnx");
    let image: Array3<u8> = ndarray_npy::read_npy(folder.join("testvec_input_rgb_u8.npy")).unwrap();
    let image = image.mapv(|v| f32::from(v) / 255.0);
    let expected = read_values(folder.join("testvec_output_depth_f32.npy"), &ReadOptions::default()).unwrap();
    let prior = OnnxPrior::open(&model, &OnnxPrior::recognise(&model).unwrap().0).unwrap();
    let depth = prior.predict(image.view()).unwrap();
    let expected = resize(expected.view(), (224, 224), Filter::Bilinear);
    assert_close(&depth.map, &expected, 1e-4);
    assert_eq!(depth.kind, DepthKind::Metric);
    assert!(depth.valid.iter().all(|&v| v));
}

#[test]
fn midas_like_models_agree_with_onnx_runtime() {
    let mut spec = ModelSpec::new(32, 32, DepthKind::AffineDisparity);
    let small = OnnxPrior::open(fixture("midas_small.onnx"), &spec).unwrap();
    let expected = read_values(fixture("midas_small.npy"), &ReadOptions::default()).unwrap();
    assert_close(&small.predict(pattern(32, 32).view()).unwrap().map, &expected, 1e-5);
    assert!(expected.iter().any(|&d| d < 0.0), "the fixture is to show that disparity may be negative");

    spec.aspect = Aspect::KeepMinimal;
    spec.multiple_of = 32;
    (spec.width, spec.height) = (96, 64);
    let dynamic = OnnxPrior::open(fixture("midas_dynamic.onnx"), &spec).unwrap();
    let expected = read_values(fixture("midas_dynamic.npy"), &ReadOptions::default()).unwrap();
    // Another size in between, so that the plan is built again, twice.
    for _ in 0..2 {
        assert_close(&dynamic.predict(pattern(64, 96).view()).unwrap().map, &expected, 1e-5);
        dynamic.predict(pattern(100, 60).view()).unwrap();
    }
    let prior = dynamic.predict(pattern(50, 70).view()).unwrap();
    assert_eq!((prior.map.dim(), prior.kind), ((50, 70), DepthKind::AffineDisparity));
    let depth = prior.to_depth(&DisparityRule::default()).unwrap();
    assert!(depth.iter().all(|z| (0.8 - 1e-5..=8.0 + 1e-5).contains(z)));
}

#[test]
fn a_fixed_input_size_wins_over_the_specification() {
    let spec = ModelSpec::profile("depth-anything-v2").unwrap();
    let prior = OnnxPrior::open(fixture("midas_small.onnx"), &spec).unwrap();
    assert_eq!(prior.input_size(480, 640), (32, 32));
    assert_eq!(prior.predict(pattern(40, 60).view()).unwrap().map.dim(), (40, 60));
}

#[test]
fn layout_order_and_normalisation_are_as_stated() {
    let image = pattern(8, 12);
    let mut spec = ModelSpec::new(12, 8, DepthKind::AffineDisparity);
    let nchw = OnnxPrior::open(fixture("grey_nchw.onnx"), &spec).unwrap();
    assert_close(&nchw.predict(image.view()).unwrap().map, &grey(&image, [0.299, 0.587, 0.114]), 1e-6);

    spec.layout = Layout::Nhwc;
    spec.channels = Channels::Bgr;
    let nhwc = OnnxPrior::open(fixture("grey_nhwc.onnx"), &spec).unwrap();
    assert_close(&nhwc.predict(image.view()).unwrap().map, &grey(&image, [0.114, 0.587, 0.299]), 1e-6);

    // The mean and std stay with their colours whatever the order.
    spec.mean = [0.1, 0.2, 0.3];
    spec.std = [0.5, 0.25, 2.0];
    let normalised = OnnxPrior::open(fixture("grey_nhwc.onnx"), &spec).unwrap();
    let mut expected = image.clone();
    expected.indexed_iter_mut().for_each(|((_, _, c), v)| *v = (*v - spec.mean[c]) / spec.std[c]);
    let expected = grey(&expected, [0.114, 0.587, 0.299]);
    assert_close(&normalised.predict(image.view()).unwrap().map, &expected, 1e-5);
}

/// A network of single pixels predicts the same with and without padding, wherever that lies.
#[test]
fn padding_keeps_the_aspect_and_is_cut_off() {
    for (height, width, sides) in [(16, 16, (8, 8)), (4, 16, (3, 12)), (10, 14, (8, 11))] {
        let image = pattern(height, width);
        let mut spec = ModelSpec::new(12, 8, DepthKind::Metric);
        spec.aspect = Aspect::Pad;
        let padded = OnnxPrior::open(fixture("grey_nchw.onnx"), &spec).unwrap();
        assert_eq!(padded.input_size(height, width), sides);
        let spec = ModelSpec::new(sides.1, sides.0, DepthKind::Metric);
        let squashed = OnnxPrior::open(fixture("grey_nchw.onnx"), &spec).unwrap();
        let [with, without] = [&padded, &squashed].map(|prior| prior.predict(image.view()).unwrap().map);
        assert_close(&with, &without, 1e-6);
    }
}

#[test]
fn the_floor_holds_after_bicubic_overshoot() {
    let mut spec = ModelSpec::new(12, 8, DepthKind::Metric);
    spec.output_floor = Some(0.4);
    spec.output_filter = Filter::Bicubic;
    let prior = OnnxPrior::open(fixture("grey_nchw.onnx"), &spec).unwrap();
    let depth = prior.predict(pattern(37, 51).view()).unwrap();
    assert!(depth.map.iter().all(|&z| z >= 0.4));
}

#[test]
fn an_image_of_one_channel_or_with_nan_is_refused() {
    let spec = ModelSpec::new(8, 8, DepthKind::Metric);
    let grey = OnnxPrior::open(fixture("grey_nchw.onnx"), &spec).unwrap();
    assert!(grey.predict(Array3::zeros((8, 8, 1)).view()).is_err());
    assert!(grey.predict(Array3::from_elem((8, 8, 3), f32::NAN).view()).is_err());
}

#[test]
fn weights_in_another_file_are_named() {
    let spec = ModelSpec::new(8, 8, DepthKind::Metric);
    let prior = OnnxPrior::open(fixture("external.onnx"), &spec).unwrap();
    let files: Vec<_> = prior.files().collect();
    assert_eq!(files, [fixture("external.onnx"), fixture("external.bin")]);
    let inside = OnnxPrior::open(fixture("grey_nchw.onnx"), &spec).unwrap();
    assert_eq!(inside.files().count(), 1);
}

/// A larger input has larger tensors, and the weights count twice.
#[test]
fn the_memory_follows_the_input_and_the_file() {
    let path = fixture("midas_dynamic.onnx");
    let spec = ModelSpec::new(32, 32, DepthKind::AffineDisparity);
    let memory = |side| {
        let spec = ModelSpec { width: side, height: side, ..spec.clone() };
        OnnxPrior::open(&path, &spec).unwrap().memory(480, 640).unwrap()
    };
    let (small, large) = (memory(32), memory(64));
    assert_eq!(small.model, 2 * std::fs::metadata(&path).unwrap().len());
    assert_eq!(large.model, small.model);
    let input = 4 * 3 * 32 * 32;
    assert!((input..20 * input).contains(&small.prediction), "{small:?}");
    assert!((3 * small.prediction..=5 * small.prediction).contains(&large.prediction), "{small:?} {large:?}");
}

/// Idle threads help a prediction, alone or beside others.
#[test]
fn no_byte_depends_on_the_number_of_threads() {
    let mut spec = ModelSpec::new(384, 256, DepthKind::AffineDisparity);
    (spec.aspect, spec.multiple_of) = (Aspect::KeepMinimal, 32);
    let prior = OnnxPrior::open(fixture("midas_dynamic.onnx"), &spec).unwrap();
    let images = [pattern(256, 384), 1.0 - pattern(256, 384), 0.5 * pattern(256, 384)];
    let views = images.each_ref().map(|image| image.view());
    let predicted = |threads: usize, at_once: Option<usize>| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        let mut maps = Vec::new();
        let take = |prediction: mde_prior::Result<PriorDepth>| {
            maps.push(prediction.unwrap().map);
            ControlFlow::Continue(())
        };
        _ = pool.install(|| predict_each(&prior, &views, at_once, take)).unwrap();
        maps
    };
    let expected = predicted(1, None);
    for (threads, at_once) in [(2, None), (4, None), (4, Some(1)), (4, Some(2))] {
        assert!(predicted(threads, at_once) == expected, "{threads} threads, {at_once:?} at once");
    }
}

/// A thread that waits for its part of a matrix product takes up whatever the pool has to do, another prediction too.
#[test]
fn predictions_meet_on_the_threads_of_one_pool() {
    let spec = ModelSpec::new(96, 96, DepthKind::AffineDisparity);
    let model = OnnxPrior::open(fixture("convolutions.onnx"), &spec).unwrap();
    let image = pattern(32, 32);
    let alone = model.predict(image.view()).unwrap();
    let pool = rayon::ThreadPoolBuilder::new().num_threads(2).build().unwrap();
    std::thread::scope(|scope| {
        for _ in 0..6 {
            scope.spawn(|| {
                for _ in 0..25 {
                    assert_eq!(pool.install(|| model.predict(image.view())).unwrap(), alone);
                }
            });
        }
    });
}
