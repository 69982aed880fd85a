//! The photograph.

use crate::table::{Case, QUICK, check, refused, works};

fn with_prior(image: &str, prior: &str) -> String {
    format!("refine {image} --prior-depth {prior} {QUICK}")
}

#[test]
pub(crate) fn unusable_photographs() {
    let formats = "give a JPEG, PNG, TIFF, BMP or WebP";
    let cases: [(&str, &[&'static str]); 31] = [
        ("none.png", &["none.png", "check the path"]),
        ("empty.png", &["empty.png", "is empty"]),
        ("text.png", &["text.png", formats]),
        (".", &["give a file, not a folder"]),
        ("folder.png", &["folder.png", "give a file, not a folder"]),
        ("file/image.png", &["file/image.png", "check"]),
        ("dot.png", &["dot.png", "1x1", "8x8"]),
        ("row.png", &["row.png", "64x1", "8x8"]),
        ("column.png", &["column.png", "1x48", "8x8"]),
        ("thin.png", &["thin.png", "7x48", "8x8"]),
        ("half.png", &["half.png", formats]),
        ("half.jpg", &["half.jpg", formats]),
        ("cut.jpg", &["cut.jpg", "truncated"]),
        ("cut-progressive.jpg", &["cut-progressive.jpg", "truncated"]),
        ("zeroed.jpg", &["zeroed.jpg", formats]),
        ("two-frames.jpg", &["two-frames.jpg", "damaged", formats]),
        ("wide.tif", &["wide.tif", "32-bit integers", "8 or 16 bits"]),
        ("wide-motorola.tif", &["wide-motorola.tif", "32-bit integers"]),
        ("line.png", &["line.png", "134217728x1", "resize"]),
        ("half.webp", &["half.webp", formats]),
        ("half.bmp", &["half.bmp", formats]),
        ("half.tif", &["half.tif", formats]),
        ("header.png", &["header.png", formats]),
        ("signature.png", &["signature.png", formats]),
        ("huge.png", &["huge.png", "60000x60000", "resize"]),
        ("zero.png", &["zero.png"]),
        ("damaged.png", &["damaged.png", formats]),
        ("nan.tif", &["nan.tif", "NaN", "8 or 16 bits"]),
        ("drawing.svg", &["drawing.svg", formats]),
        ("photo.heic", &["photo.heic", formats]),
        ("page.pdf", &["page.pdf", formats]),
    ];
    let mut cases: Vec<Case> =
        cases.into_iter().map(|(image, told)| refused(with_prior(image, "depth.npy"), told)).collect();
    cases.push(refused(with_prior("animated.gif", "depth.npy"), &["animated.gif", formats]));
    cases.push(refused(with_prior("depth.npy", "depth.npy"), &["depth.npy", formats]));
    cases.push(refused(with_prior("big.png", "turned.npy"), &["turned.npy", "48x64", "640x480", "resize"]));
    check(&cases);
}

#[test]
pub(crate) fn odd_photographs() {
    let same_size = [
        "grey.png",
        "grey16.png",
        "grey-alpha.png",
        "alpha.png",
        "rgb16.png",
        "rgba16.png",
        "grey.jpg",
        "plain.webp",
        "plain.bmp",
        "plain.tif",
        "floats.tif",
        "cmyk.jpg",
        "progressive.jpg",
        "rotated.jpg",
        "palette.png",
        "bilevel.png",
        "no-extension",
        "wrong.jpg",
        "black.png",
    ];
    let mut cases: Vec<Case> = same_size.iter().map(|image| works(with_prior(image, "depth.npy"))).collect();
    cases.extend(
        [
            ("smallest.png", "smallest.npy"),
            ("long.png", "long.npy"),
            // Their first picture.
            ("animated.png", "half-size.npy"),
            ("animated.webp", "half-size.npy"),
        ]
        .map(|(image, prior)| works(with_prior(image, prior))),
    );
    check(&cases);
}
