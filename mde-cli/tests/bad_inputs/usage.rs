//! What the argument parser refuses: exit code 2.

use crate::table::{check, misused};

#[test]
pub(crate) fn wrong_usage() {
    let refine = "refine image.png --prior-depth depth.npy";
    let of = |rest: &str, told: &[&'static str]| misused(format!("{refine} {rest} -o out"), told);
    check(&[
        misused("", &["Usage"]),
        misused("polish image.png", &["polish"]),
        misused("refine", &["IMAGE"]),
        misused("refine image.png -o out", &["--prior-model", "--prior-depth"]),
        misused("refine image.png --prior-depth -o out", &["--prior-depth"]),
        misused("refine a.png b.png -o out", &["--prior-model", "--prior-depth"]),
        misused(
            "refine image.png --prior-model fastdepth.onnx --png-scale 3 -o out",
            &["cannot be used with"],
        ),
        of("--prior-model fastdepth.onnx", &["cannot be used with"]),
        of("--fov 60 --fx 500", &["cannot be used with"]),
        of("--cx 3", &["--fx"]),
        of("--fov 60 --cy 3", &["cannot be used with"]),
        of("--fx 60 --intrinsics-base 1", &["cannot be used with"]),
        of("--intrinsics good.txt --intrinsics-base 2", &["--intrinsics-base", "0..=1"]),
        of("--prior-kind height", &["height", "disparity"]),
        of("--prior-encoding zip", &["zip", "sunrgbd"]),
        of("--preset best", &["best", "paper"]),
        of("--seed -1", &["--seed"]),
        of("--seed many", &["--seed"]),
        of("--seed 99999999999999999999", &["--seed"]),
        of("--threads 0", &["--threads"]),
        of("--threads 99999", &["--threads"]),
        of("--gt-scale 3", &["--gt"]),
        of("--gt-encoding sunrgbd", &["--gt"]),
        of("--fov wide", &["--fov"]),
        of("--quiet --log-json", &["cannot be used with"]),
        of("--unknown", &["--unknown"]),
        of("--predictions 0", &["--predictions", "1 or more"]),
        of("--predictions many", &["\"many\"", "auto"]),
        of("--work-size 0", &["--work-size", "positive"]),
        of("--near none", &["--near", "positive"]),
        of("--far 0", &["--far", "positive"]),
        of("--input-size 48x48", &["cannot be used with"]),
        of("--runtime mxnet", &["mxnet", "onnxruntime"]),
        misused("demo --size 320 -o out", &["WIDTHxHEIGHT"]),
        misused("demo --size 0x0 -o out", &["8 to 16384"]),
        misused("demo --size 99999x99999 -o out", &["8 to 16384"]),
        misused("demo --quiet --log-json -o out", &["cannot be used with"]),
        misused("demo extra -o out", &["extra"]),
        misused("render -o out", &["--field"]),
    ]);
}
