//! Networks.

use crate::table::{check, refused};

#[cfg(not(feature = "onnx"))]
#[test]
pub(crate) fn a_program_without_networks_says_so() {
    check(&[refused(
        "refine image.png --prior-model fastdepth.onnx",
        &["fastdepth.onnx", "--features onnx", "--prior-depth"],
    )]);
}

#[cfg(feature = "onnx")]
#[test]
pub(crate) fn unusable_models() {
    let fixture = |name: &str| {
        let folder = concat!(env!("CARGO_MANIFEST_DIR"), "/../mde-prior/tests/fixtures");
        format!("refine image.png --prior-model {folder}/{name} --model-profile fastdepth")
    };
    let refine = |rest: &str| format!("refine image.png --prior-model {rest}");
    check(&[
        refused(refine("none.onnx"), &["none.onnx", "check the path"]),
        refused(refine("empty.onnx --model-profile fastdepth"), &["empty.onnx", "is empty"]),
        refused(refine("fastdepth.onnx"), &["fastdepth.onnx", "ONNX model cannot be run"]),
        refused(refine("mystery.onnx"), &["mystery.onnx", "fastdepth", "dpt-large"]),
        refused(refine("fastdepth.onnx --model-profile nonsense"), &["nonsense", "dpt-large"]),
        refused(refine("depth.npy --model-profile fastdepth"), &["depth.npy", "ONNX model cannot be run"]),
        refused(fixture("one_channel.onnx"), &["one_channel.onnx", "1 channels", "layout"]),
        refused(fixture("three_channels.onnx"), &["three_channels.onnx", "[1, 3, 8, 8]", "output-name"]),
        refused(fixture("scores.onnx"), &["scores.onnx", "[1, 3]", "output-name"]),
        refused(fixture("vector.onnx"), &["vector.onnx", "1 axes", "4"]),
        refused(fixture("not_finite.onnx"), &["not_finite.onnx", "NaN", "check mean"]),
        refused(fixture("stride_0.onnx"), &["stride_0.onnx"]),
        refused(fixture("axis_99.onnx"), &["axis_99.onnx"]),
        refused(fixture("step_0.onnx"), &["step_0.onnx"]),
        refused(fixture("divided_by_0.onnx"), &["divided_by_0.onnx"]),
        refused(fixture("huge.onnx"), &["huge.onnx"]),
        refused(fixture("enlarged.onnx"), &["enlarged.onnx"]),
        refused(fixture("groups.onnx"), &["groups.onnx"]),
        refused(fixture("split.onnx"), &["split.onnx"]),
        #[cfg(feature = "onnxruntime")]
        refused(
            refine("fastdepth.onnx --runtime tract --onnxruntime lib.so"),
            &["--runtime tract", "--onnxruntime", "leave one of them out"],
        ),
    ]);
}

#[cfg(feature = "onnx")]
#[test]
pub(crate) fn a_model_with_dynamic_axes() {
    let model = concat!(env!("CARGO_MANIFEST_DIR"), "/../mde-prior/tests/fixtures/midas_dynamic.onnx");
    let quick = crate::table::QUICK;
    check(&[crate::table::works(format!(
        "refine image.png --prior-model {model} --model-profile midas-v2.1-small {quick}"
    ))]);
}
