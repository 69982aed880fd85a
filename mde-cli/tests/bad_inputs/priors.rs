//! The monocular depth and the truth.

use crate::table::{Case, QUICK, check, refused, works};

fn refine(rest: &str) -> String {
    format!("refine image.png --prior-depth {rest} {QUICK}")
}

#[test]
pub(crate) fn unusable_depth_maps() {
    let cases: [(&str, &[&'static str]); 56] = [
        ("none.npy", &["none.npy", "check the path"]),
        ("empty.npy", &["empty.npy", "is empty"]),
        ("empty.npz", &["empty.npz", "is empty"]),
        ("empty.pfm", &["empty.pfm", "is empty"]),
        ("empty.exr", &["empty.exr", "is empty"]),
        ("empty-depth.png", &["empty-depth.png", "is empty"]),
        ("text.npy", &["text.npy", "numpy.save"]),
        ("text.npz", &["text.npz", "numpy.savez"]),
        ("text.pfm", &["text.pfm", "'Pf'"]),
        ("text.exr", &["text.exr", "write"]),
        ("text.png", &["text.png", "write the file again"]),
        ("short.npy", &["short.npy", "truncated", "12288", "12189"]),
        ("short.npz", &["short.npz", "numpy.savez"]),
        ("short.pfm", &["short.pfm", "truncated", "write the file again"]),
        ("short.exr", &["short.exr", "write"]),
        ("short-depth.png", &["short-depth.png", "write the file again"]),
        ("line-depth.png", &["line-depth.png", "134217728x1", "resize"]),
        ("header.npy", &["header.npy", "truncated"]),
        ("future.npy", &["future.npy", "header"]),
        ("folder.npy", &["folder.npy", "give a file, not a folder"]),
        ("depth.txt", &["depth.txt", ".npy"]),
        ("depth", &["depth", ".npy"]),
        ("turned.npy", &["turned.npy", "48x64", "64x48"]),
        ("dot.npy", &["dot.npy", "1x1", "64x48"]),
        ("nan.npy", &["nan.npy", "no usable pixel", "check"]),
        ("zero.npy", &["zero.npy", "no usable pixel", "check"]),
        ("negative.npy", &["negative.npy", "no usable pixel", "check"]),
        ("infinite.npy", &["infinite.npy", "no usable pixel", "check"]),
        ("infinite.npy --prior-kind disparity", &["infinite.npy", "no usable pixel"]),
        ("nan.npy --prior-kind disparity", &["nan.npy", "no usable pixel"]),
        ("flat.npy", &["flat.npy", "[3072]", "[height, width]"]),
        ("scalar.npy", &["scalar.npy", "[]", "[height, width]"]),
        ("stack.npy", &["stack.npy", "[2, 24, 64]", "[height, width]"]),
        ("complex.npy", &["complex.npy", "<c8", "float32"]),
        ("object.npy", &["object.npy", "|O", "float32"]),
        ("words.npy", &["words.npy", "<U4", "float32"]),
        ("bool.npy", &["bool.npy", "|b1", "float32"]),
        ("huge.npy", &["huge.npy", "99999999x99999999", "write the file again"]),
        ("minus.npy", &["minus.npy", "shape", "numpy.save"]),
        ("none.shape.npy", &["none.shape.npy", "64x0", "write the file again"]),
        ("no-descr.npy", &["no-descr.npy", "'descr'", "numpy.save"]),
        ("no-order.npy", &["no-order.npy", "'fortran_order'", "numpy.save"]),
        ("no-shape.npy", &["no-shape.npy", "'shape'", "numpy.save"]),
        ("two.npz", &["two.npz", "near", "far", "save the one with the depth under the name \"depth\""]),
        ("colour.pfm", &["colour.pfm", "three channels", "'Pf'"]),
        ("header.pfm", &["header.pfm", "header", "scale"]),
        ("huge.pfm", &["huge.pfm", "99999999x99999999", "write the file again"]),
        ("negative.pfm", &["negative.pfm", "header"]),
        ("unscaled.pfm", &["unscaled.pfm", "header", "scale"]),
        ("grey.png", &["grey.png", "16-bit greyscale", "--prior-kind disparity"]),
        ("rgb16.png", &["rgb16.png", "16-bit greyscale"]),
        ("depth.npy --prior-encoding sunrgbd", &["depth.npy", "PNG"]),
        ("depth.npy --png-scale 0", &["png-scale", "0 is no scale", "positive"]),
        ("depth.npy --png-scale nan", &["png-scale", "NaN is no scale", "positive"]),
        ("depth.npy --png-scale inf", &["png-scale", "inf is no scale", "positive"]),
        ("depth.npy --png-scale=-5", &["png-scale", "-5 is no scale", "positive"]),
    ];
    check(&cases.map(|(prior, told)| refused(refine(prior), told)));
}

#[test]
pub(crate) fn known_depths_that_give_no_scale() {
    let with = |rest: &str| refine(&format!("depth.npy --no-nerf --scale-from {rest}"));
    check(&[
        refused(with("none.csv"), &["none.csv", "can't be read", "COLMAP"]),
        refused(with("known-none.csv"), &["known-none.csv", "no depth"]),
        refused(with("known-head.csv"), &["known-head.csv", "no depth"]),
        refused(with("known-two.csv"), &["known-two.csv", "row 1", "3,4"]),
        refused(with("known-five.csv"), &["known-five.csv", "row 1"]),
        refused(with("known-word.csv"), &["known-word.csv", "row 2", "four"]),
        refused(with("known-bytes.csv"), &["known-bytes.csv"]),
        refused(with("known-zero.csv"), &["known-zero.csv", "0 +- 0 at (3, 4)", "check its columns"]),
        refused(with("known-minus.csv"), &["known-minus.csv", "-2.5", "check its columns"]),
        refused(with("known-nan.csv"), &["known-nan.csv", "NaN", "check its columns"]),
        refused(with("known-sigma.csv"), &["known-sigma.csv", "+- -1", "check its columns"]),
        refused(with("known-outside.csv"), &["known-outside.csv", "0 of 2", "give 1 or more"]),
        refused(with("known-one.csv --prior-kind disparity"), &["known-one.csv", "give 2 or more"]),
        refused(with("folder.npy"), &["folder.npy", "cameras.txt"]),
        works(with("known.csv")),
        works(with("known-one.csv")),
    ]);
}

#[test]
pub(crate) fn depths_that_no_field_can_hold() {
    check(&[
        refused(refine("denormal.npy"), &["1e-42", "1e-12 to 1e12", "scale"]),
        refused(refine("largest.npy"), &["3.4028235e38", "1e-12 to 1e12", "scale"]),
        refused(refine("depth.npy --png-scale 1e300"), &["depth.npy", "no usable pixel", "check"]),
        refused(refine("depth.npy --png-scale 1e-300"), &["depth.npy", "no usable pixel", "check"]),
    ]);
}

#[test]
pub(crate) fn odd_depth_maps() {
    let priors = [
        "constant.npy",
        "constant.npy --prior-kind disparity",
        "one-pixel.npy",
        "holes.npy",
        "half-missing.npy",
        "mixed.npy",
        "some-nan.npy",
        "extremes.npy",
        "large.npy",
        "tiny.npy",
        "disparity.npy --prior-kind disparity",
        "negative.npy --prior-kind disparity",
        "one-pixel.npy --prior-kind disparity",
        "depth.npy --prior-kind depth",
        "f8.npy",
        "f4be.npy",
        "fortran.npy",
        "u2.npy",
        "small.npy",
        "big.npy",
        "grey.png --prior-kind disparity",
        "u1.npy --png-scale 10",
        "batch.npy",
        "channel.npy",
        "depth.npz",
        "three.npz",
        "depth.pfm",
        "big-endian.pfm",
        "depth.exr",
        "depth.png --png-scale 5000",
        "depth.png --prior-encoding sunrgbd",
    ];
    check(&priors.map(|prior| works(refine(prior))));
}

#[test]
pub(crate) fn truths() {
    let truth = |rest: &str| format!("{} --gt {rest}", refine("depth.npy"));
    let cases: [Case; 13] = [
        refused(truth("none.npy"), &["none.npy", "check the path"]),
        refused(truth("empty.npy"), &["empty.npy", "is empty"]),
        refused(truth("short.npy"), &["short.npy", "truncated"]),
        refused(truth("line-depth.png"), &["line-depth.png", "134217728x1", "resize"]),
        refused(truth("small.npy"), &["small.npy", "32x24", "64x48", "same size"]),
        refused(truth("zero.npy"), &["zero.npy", "no pixel"]),
        refused(truth("nan.npy"), &["nan.npy", "no pixel"]),
        refused(truth("depth.txt"), &["depth.txt", ".npy"]),
        refused(truth("grey.png"), &["grey.png", "16-bit greyscale"]),
        refused(truth("depth.npy --gt-scale 0"), &["gt-scale", "0 is no scale"]),
        refused(truth("depth.npy --gt-encoding sunrgbd"), &["depth.npy", "PNG"]),
        works(truth("depth.png --gt-scale 5000")),
        works(truth("half-missing.npy")),
    ];
    check(&cases);
}
