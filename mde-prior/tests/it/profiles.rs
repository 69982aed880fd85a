//! Published networks: graphs with their inputs and outputs, made by tests/reference/make_models.py.

use crate::{assert_close, fixture, grey, place, recognised};
use mde_prior::ndarray::{Array2, Array3};
use mde_prior::spec::PROFILES;
use mde_prior::{CertaintyMeaning, DepthKind, DepthPrior, Error, ModelSpec, OnnxPrior, RecognisedBy};
#[cfg(feature = "onnxruntime")]
use std::path::Path;

const GREY: [f32; 3] = [0.299, 0.587, 0.114];

/// An image of the size that the graphs take, dark on the left.
fn image() -> Array3<f32> {
    Array3::from_shape_fn((28, 42, 3), |(y, x, c)| {
        (x as f32 / 42.0) * (0.6 + 0.1 * c as f32) + 0.005 * y as f32
    })
}

/// A network of one input and one output, whatever its profile: an even image gives the value of its normalised colour.
#[test]
fn every_profile_of_one_output_normalises_as_it_says() {
    let even = Array3::from_elem((60, 80, 3), 0.4);
    for name in PROFILES {
        let spec = ModelSpec::profile(name).unwrap();
        let one_output = ModelSpec { camera_output: None, error_output: None, ..spec.clone() };
        if spec.output_channel.is_some() {
            continue;
        }
        let expected: f32 = 1.0 + (0..3).map(|c| GREY[c] * (0.4 - spec.mean[c]) / spec.std[c]).sum::<f32>();
        let prior = OnnxPrior::open(fixture("predicted_depth.onnx"), &one_output).unwrap();
        let prediction = prior.predict(even.view()).unwrap();
        // Without a camera, metres for a stated one have no unit.
        let kind = if spec.canonical_focal.is_some() { DepthKind::RelativeDepth } else { spec.output };
        assert_eq!((prediction.map.dim(), prediction.kind), ((60, 80), kind), "{name}");
        let expected = expected.max(spec.output_floor.unwrap_or(expected));
        assert!(prediction.map.iter().all(|v| (v / expected - 1.0).abs() < 1e-3), "{name}");
        assert_eq!(prior.resolution(60, 80), Some(spec.input_size(60, 80)), "{name}");
    }
}

#[test]
fn moge_gives_metres_with_its_shift_scale_and_mask() {
    let prior = recognised("moge2.onnx");
    let (image, prediction) = (image(), prior.predict(image().view()).unwrap());
    let grey = grey(&image, GREY);
    assert_eq!((prediction.kind, prior.spec().tokens), (DepthKind::Metric, Some(1800)));
    assert_eq!(prediction.valid, grey.mapv(|g| g > 0.2));
    let expected = grey.mapv(|g| if g > 0.2 { 1.8 * (1.0 + g) } else { 0.0 });
    assert_close(&prediction.map, &expected, 2e-3);
}

#[test]
fn unidepth_and_depth_pro_give_metres() {
    let image = image();
    let [unidepth, older] = ["unidepth.onnx", "unidepth_k.onnx"].map(recognised);
    let spec = unidepth.spec().clone();
    let normalised = |c: usize, v: f32| (v - spec.mean[c]) / spec.std[c];
    let expected = Array2::from_shape_fn((28, 42), |(y, x)| {
        1.0 + (0..3).map(|c| GREY[c] * normalised(c, image[(y, x, c)])).sum::<f32>()
    });
    let found = unidepth.predict(image.view()).unwrap();
    assert_eq!(found.valid, expected.mapv(|z| z > 0.0));
    assert_close(&found.map, &expected.mapv(|z| z.max(0.0)), 2e-3);
    assert_eq!(older.predict(image.view()).unwrap(), found);
    let pro = recognised("depth_pro_like.onnx");
    assert_eq!(pro.spec(), &ModelSpec::profile("depth-pro").unwrap());
    let expected = grey(&image, GREY).mapv(|g| 1.0 + (g - 0.5) / 0.5);
    assert_close(&pro.predict(image.view()).unwrap().map, &expected, 2e-3);
}

#[test]
fn a_networks_own_camera_and_error_come_with_its_prediction() {
    // Twice the size of the input, so pixels twice as fine.
    let image = Array3::from_shape_fn((56, 84, 3), |(y, x, _)| 0.2 + 0.005 * (x + y) as f32);
    let predict = |name: &str| recognised(name).predict(image.view()).unwrap();
    for name in ["unidepth.onnx", "unidepth_k.onnx"] {
        let found = predict(name);
        assert_eq!(found.intrinsics, Some([60.0, 62.0, 39.5, 29.5]), "{name}");
        // It grows with brightness in these graphs.
        let own = found.certainty.unwrap();
        assert_eq!((own.meaning, own.map.dim()), (CertaintyMeaning::Error, (56, 84)), "{name}");
        assert!(own.map[(50, 80)] > own.map[(5, 5)], "{name}");
    }
    // A network with a confidence in its place.
    let profile = ModelSpec::profile("unidepth-v2").unwrap();
    let surer =
        ModelSpec { error_output: None, confidence_output: Some("confidence".to_owned()), ..profile.clone() };
    let surer = OnnxPrior::open(fixture("unidepth.onnx"), &surer).unwrap().predict(image.view()).unwrap();
    assert_eq!(surer.certainty.unwrap().meaning, CertaintyMeaning::Confidence);
    let both = ModelSpec { confidence_output: Some("confidence".to_owned()), ..profile };
    assert!(both.validate().unwrap_err().to_string().contains("error-output"));
    // Depth Pro's focal length is that of its width; the image's pixels are square.
    let pro = predict("depth_pro_like.onnx");
    assert_eq!(pro.intrinsics, Some([100.0, 100.0, 41.5, 27.5]));
    let [fx, fy, cx, cy] = predict("moge2.onnx").intrinsics.unwrap();
    // 0.8 of half the diagonal.
    let expected = 0.4 * 84.0_f64.hypot(56.0);
    assert!((fx / expected - 1.0).abs() < 0.01 && fx == fy && (cx, cy) == (41.5, 27.5), "{fx} {expected}");
}

/// Of Transformers and of Apple's network, under the profile's name too.
#[test]
fn depth_pros_inverse_depth_becomes_metres_by_its_field_of_view() {
    let image = image();
    // Twice the tangent of half of 60 degrees.
    let width_over_focal = 2.0 * 30.0_f32.to_radians().tan();
    let expected = grey(&image, GREY).mapv(|g| 1.0 / (width_over_focal * (1.0 + (g - 0.5) / 0.5)).max(1e-4));
    let focal = 42.0 / f64::from(width_over_focal);
    for name in ["depth_pro_inverse.onnx", "depth_pro_apple.onnx"] {
        let named = OnnxPrior::open(fixture(name), &ModelSpec::profile("depth-pro").unwrap()).unwrap();
        let prior = recognised(name);
        assert_eq!((named.spec(), named.kind()), (prior.spec(), DepthKind::Metric));
        let found = prior.predict(image.view()).unwrap();
        assert_eq!(found, named.predict(image.view()).unwrap());
        assert_eq!(found.kind, DepthKind::Metric);
        // Where the graph's inverse depth is 0 or less, 10 km as by its authors.
        let near = |(a, b): (&f32, &f32)| (a / b - 1.0).abs() < 2e-3;
        assert!(found.map.iter().zip(&expected).all(near) && expected.iter().any(|z| *z > 9e3), "{name}");
        let [fx, fy, cx, cy] = found.intrinsics.unwrap();
        assert!((fx / focal - 1.0).abs() < 1e-5 && fx == fy && (cx, cy) == (20.5, 13.5), "{fx} {focal}");
    }
    // As a disparity, the network's own values.
    let spec = recognised("depth_pro_inverse.onnx").spec().clone();
    assert_eq!(spec.clone().with_output(DepthKind::AffineDisparity).fov_output, None);
    assert!(ModelSpec { output: DepthKind::AffineDisparity, ..spec }.validate().is_err());
}

#[test]
fn metres_for_a_stated_focal_length_follow_the_cameras() {
    let prior = recognised("metric3d.onnx");
    let even = Array3::from_elem((60, 80, 3), 0.5);
    let without = prior.predict(even.view()).unwrap();
    assert_eq!((prior.kind(), without.kind), (DepthKind::RelativeDepth, DepthKind::RelativeDepth));
    let with = prior.spec().in_metres(without.clone(), 1.25, prior.resolution(60, 80));
    assert_eq!(with.kind, DepthKind::Metric);
    // Padded at its sides: 821 of 1064 pixels. 1.25 of that width, over 1000 pixels.
    assert_eq!(prior.input_size(60, 80), (616, 821));
    let (_, width) = prior.input_size(60, 80);
    let factor = 1.25 * width as f32 / 1000.0;
    assert!((with.map[(30, 40)] / without.map[(30, 40)] / factor - 1.0).abs() < 0.02, "{factor}");
}

#[test]
fn a_file_of_any_name_is_recognised_by_its_graph_or_its_folder() {
    let (folder, model) = place("model.onnx");
    let known = [
        ("moge2", "moge-2"),
        ("unidepth", "unidepth-v2"),
        ("depth_pro_like", "depth-pro"),
        ("fastdepth_like", "fastdepth"),
        ("metric3d", "metric3d-v2"),
    ];
    for (graph, profile) in known {
        std::fs::copy(fixture(&format!("{graph}.onnx")), &model).unwrap();
        let mut expected = ModelSpec::profile(profile).unwrap();
        if graph == "metric3d" {
            // Normals are beside its depth.
            expected.output_name = Some("predicted_depth".to_owned());
        }
        assert_eq!(OnnxPrior::recognise(&model).unwrap(), (expected, RecognisedBy::Graph));
    }
    // A small network of fixed size, but of other layers.
    std::fs::copy(fixture("midas_small.onnx"), &model).unwrap();
    assert!(matches!(OnnxPrior::recognise(&model), Err(Error::UnknownProfile { .. })));
    std::fs::copy(fixture("predicted_depth.onnx"), &model).unwrap();
    assert!(matches!(OnnxPrior::recognise(&model), Err(Error::UnknownProfile { .. })));
    std::fs::write(folder.path().join("config.json"), r#"{"model_type": "depth_anything"}"#).unwrap();
    let expected = (ModelSpec::profile("depth-anything-v2").unwrap(), RecognisedBy::Hub);
    assert_eq!(OnnxPrior::recognise(&model).unwrap(), expected);
    let named = folder.path().join("da3_mono_large.onnx");
    std::fs::copy(fixture("predicted_depth.onnx"), &named).unwrap();
    std::fs::remove_file(folder.path().join("config.json")).unwrap();
    let expected = (ModelSpec::profile("depth-anything-3-mono").unwrap(), RecognisedBy::Name);
    assert_eq!(OnnxPrior::recognise(&named).unwrap(), expected);
}

#[test]
fn an_output_that_is_not_there_is_named() {
    let error = |spec: ModelSpec| OnnxPrior::open(fixture("moge2.onnx"), &spec).unwrap_err().to_string();
    let moge = || ModelSpec::profile("moge-2").unwrap();
    let text = error(ModelSpec { mask_output: Some("sky".to_owned()), ..moge() });
    assert!(["\"sky\"", "metric_scale", "mask-output"].iter().all(|part| text.contains(part)), "{text}");
    let text = error(ModelSpec { tokens: None, ..moge() });
    assert!(text.contains("num_tokens") && text.contains("tokens"), "{text}");
}

/// ONNX Runtime against tract. It needs the library: the package onnxruntime of the active Python, or ORT_DYLIB_PATH.
#[cfg(feature = "onnxruntime")]
pub(super) mod onnxruntime {
    use super::*;
    use mde_prior::{Runtime, find_onnxruntime};

    pub(crate) fn agree(path: &Path, spec: &ModelSpec, image: &Array3<f32>) {
        let library = find_onnxruntime(None).unwrap();
        let tract = OnnxPrior::open(path, spec).unwrap();
        let other = OnnxPrior::open_with(path, spec, &Runtime::OnnxRuntime(library)).unwrap();
        assert_eq!(other.concurrency(), 1);
        let [a, b] = [&tract, &other].map(|prior| prior.predict(image.view()).unwrap());
        assert_eq!(a.valid, b.valid);
        let largest = a.map.iter().copied().fold(0.0, f32::max);
        let worst = a.map.iter().zip(&b.map).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
        assert!(worst <= 1e-4 * largest, "{}: {worst} of {largest}", path.display());
    }

    #[test]
    #[ignore = "needs ONNX Runtime's library"]
    fn onnxruntime_agrees_with_tract_on_the_graphs_of_published_networks() {
        let graphs = [
            ("moge2", "moge-2"),
            ("unidepth", "unidepth-v2"),
            ("depth_pro_like", "depth-pro"),
            ("predicted_depth", "depth-anything-v2"),
        ];
        for (graph, profile) in graphs {
            agree(&fixture(&format!("{graph}.onnx")), &ModelSpec::profile(profile).unwrap(), &image());
        }
    }

    #[test]
    #[ignore = "needs ONNX Runtime's library, and the networks and photographs that MDE_SHARED names"]
    fn onnxruntime_agrees_with_tract_on_real_networks() {
        let shared = std::env::var_os("MDE_SHARED").unwrap();
        let shared = Path::new(&shared);
        let photograph =
            mde_prior::photo::read_image(shared.join("data/plain/nyu_living/color.png")).unwrap();
        let fastdepth = ModelSpec::profile("fastdepth").unwrap();
        agree(&shared.join("models/fastdepth/fastdepth_224.onnx"), &fastdepth, &photograph.pixels);
        let small = ModelSpec::new(48, 48, DepthKind::AffineDisparity);
        agree(&shared.join("models/upydnet_nyu48/model.onnx"), &small, &photograph.pixels);
    }
}
