//! The camera.

use crate::table::{check, refused, works};

fn refine(rest: &str) -> String {
    format!("refine image.png --prior-depth depth.npy --preset fast --config quick.toml {rest}")
}

#[test]
pub(crate) fn unusable_cameras() {
    let cases: [(&str, &[&'static str]); 34] = [
        ("--fov 0", &["--fov", "field of view is 0", "180"]),
        ("--fov 180", &["--fov", "field of view is 180", "180"]),
        ("--fov -20", &["--fov", "field of view is -20", "180"]),
        ("--fov nan", &["--fov", "field of view is NaN"]),
        ("--fov inf", &["--fov", "field of view is inf"]),
        ("--fx 0", &["fx is 0", "> 0"]),
        ("--fx nan", &["fx is NaN", "finite"]),
        ("--fx inf", &["fx is inf", "finite"]),
        ("--fx -50", &["fx is -50", "> 0"]),
        ("--fx 1e-308", &["fx is 1e-308", "--fov"]),
        ("--fx 50 --fy 1e300", &["fy is 1e300", "--fov"]),
        ("--fx 50 --fy -50", &["fy is -50", "> 0"]),
        ("--fx 50 --fy 0", &["fy is 0", "> 0"]),
        ("--fx 50 --cx nan", &["cx is NaN", "finite"]),
        ("--fx 50 --cy inf", &["cy is inf", "finite"]),
        ("--intrinsics none.txt", &["none.txt", "check the path"]),
        ("--intrinsics folder.png", &["folder.png", "check the path"]),
        ("--intrinsics empty.txt", &["empty.txt", "0 numbers", "3x3"]),
        ("--intrinsics binary.txt", &["binary.txt", "check"]),
        ("--intrinsics broken.txt", &["broken.txt", "5 numbers", "3x3"]),
        ("--intrinsics ten.txt", &["ten.txt", "10 numbers", "3x3"]),
        ("--intrinsics letters.txt", &["letters.txt", "3x3"]),
        ("--intrinsics zeros.txt", &["zeros.txt", "[fx 0 cx; 0 fy cy; 0 0 1]"]),
        ("--intrinsics focal-zero.txt", &["focal-zero.txt", "fx is 0"]),
        ("--intrinsics focal-minus.txt", &["focal-minus.txt", "fx is -520"]),
        ("--intrinsics focal-nan.txt", &["focal-nan.txt", "fx is NaN"]),
        ("--intrinsics focal-inf.txt", &["focal-inf.txt", "fx is inf"]),
        ("--intrinsics centre-nan.txt", &["centre-nan.txt", "cx is NaN"]),
        ("--intrinsics skewed.txt", &["skewed.txt", "[fx 0 cx; 0 fy cy; 0 0 1]"]),
        ("--intrinsics skew-nan.txt", &["skew-nan.txt", "[fx 0 cx; 0 fy cy; 0 0 1]"]),
        ("--intrinsics other.json", &["other.json", "640x480", "64x48", "scale"]),
        ("--intrinsics partial.json", &["partial.json", "cx"]),
        ("--intrinsics typed.json", &["typed.json", "fx, fy, cx, cy"]),
        ("--intrinsics broken.json", &["broken.json", "fx, fy, cx, cy"]),
    ];
    let mut cases = cases.map(|(camera, told)| refused(refine(camera), told)).to_vec();
    cases.push(refused(refine("--intrinsics minus.json"), &["minus.json", "fx is -60"]));
    cases.push(refused(refine("--intrinsics list.json"), &["list.json", "3 numbers", "3x3"]));
    check(&cases);
}

#[test]
pub(crate) fn odd_cameras() {
    let cameras = [
        "",
        "--fov 179",
        "--fov 1",
        "--fov 1e-300",
        "--fx 60 --fy 30",
        "--fx 60 --cx 1000 --cy -500",
        "--intrinsics good.txt --intrinsics-base 1",
        "--intrinsics sized.json",
    ];
    check(&cameras.map(|camera| works(refine(camera))));
}
