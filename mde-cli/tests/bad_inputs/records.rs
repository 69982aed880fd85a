//! Files that the program itself writes, each with one fault: saved fields, calibrations. And lists, known depths,
//! places of scenes.

use crate::common::Place;
use crate::table::{Case, check, misused, refused};
use serde_json::{Value, json};
use std::fs;

#[test]
pub(crate) fn unusable_numbers_of_shards() {
    let told = &["--shard", "give I/N"];
    let wrong = ["0/3", "4/3", "1", "1/", "/2", "a/b", "-1/3", "1/0", "1/1000001", "1/2/3", "1.5/3", ""];
    let refine =
        |shard: &str| misused(format!("refine shots --prior-model m.onnx --shard={shard} -o out"), told);
    let mut cases: Vec<Case> = wrong.map(refine).to_vec();
    cases.extend([
        misused("eval --dataset rooms --shard 9/8 -o out", told),
        misused(
            "refine image.png --prior-depth depth.npy --shard 1/2 --views shots -o out",
            &["cannot be used with"],
        ),
        misused("refine shots --prior-depth depth.npy --same-scale -o out", &["cannot be used with"]),
    ]);
    check(&cases);
}

#[test]
pub(crate) fn unusable_lists() {
    let place = Place::new();
    let list = |name: &str, bytes: &[u8]| {
        place.write(name, bytes);
        place.path(name).display().to_string()
    };
    let model = concat!(env!("CARGO_MANIFEST_DIR"), "/../mde-prior/tests/fixtures/midas_dynamic.onnx");
    let of = |names: &str| format!("refine {names} --prior-model {model} --model-profile midas-v2.1-small");
    let nothing = list("nothing.txt", b"");
    let comments = list("comments.txt", b"# a.png\n\n   \n");
    let prose = list("prose.txt", b"It was a dark\nand stormy night.\n");
    let latin = list("latin.txt", b"caf\xe9.png\n");
    let wide = list("wide.txt", b"\xff\xfea\0.\0p\0n\0g\0");
    let zeros = list("zeros.txt", &[0; 64]);
    let long = list("long.txt", "n".repeat(5000).as_bytes());
    let good = list("good.txt", b"image.png\n");
    fs::create_dir(place.path("none")).unwrap();
    let none = place.path("none").display().to_string();
    check(&[
        refused(of(&nothing), &["nothing.txt", "one path per line"]),
        refused(of(&comments), &["comments.txt", "one path per line"]),
        refused(of(&prose), &["prose.txt", "none of its 2 lines", "one path per line"]),
        refused(of(&latin), &["latin.txt", "UTF-8"]),
        refused(of(&wide), &["wide.txt", "UTF-8"]),
        refused(of(&zeros), &["zeros.txt", "one path per line"]),
        refused(of(&long), &["long.txt", "one path per line"]),
        refused(of("nowhere.txt"), &["nowhere.txt", "check the path"]),
        refused(of(&none), &["none", "holds no photograph"]),
        refused(of("-"), &["standard input", "one path per line"]),
        refused(of(&format!("{good} --views shots")), &["--views", "leave --views out"]),
        refused(of(&format!("{good} --gt depth.npy")), &["--gt", "mde eval"]),
        refused(of(&format!("{good} --scale-from known.csv")), &["--scale-from", "refine it alone"]),
        refused(format!("refine {good} --prior-depth depth.npy"), &["--prior-depth", "good.txt"]),
        refused("refine shots --prior-depth depth.npy", &["shots", "--prior-depth", "--prior-model"]),
    ]);
}

/// A known column, row, depth and standard deviation, and what the message must contain.
const KNOWN: &[(&str, &[&str])] = &[
    ("3;4;2.5\n", &["no depth", "separated by commas"]),
    ("3\t4\t2.5\n", &["no depth", "separated by commas"]),
    ("x,y\n3,4\n", &["row 2", "3,4"]),
    ("x,y,depth\n3,4,\n", &["row 2"]),
    ("3,4,2.5\n3,4\n", &["row 2"]),
    ("3,4,2.5 m\n4,4,2.5 m\n", &["row 1", "2.5 m"]),
    ("3,4,inf\n", &["inf", "check its columns"]),
    ("3,4,1e999\n", &["inf", "check its columns"]),
    ("nan,4,2.5\n", &["NaN", "check its columns"]),
    ("3,inf,2.5\n", &["inf", "check its columns"]),
    ("3,4,2.5,nan\n", &["NaN", "check its columns"]),
    ("3,4,2.5,inf\n", &["inf", "check its columns"]),
    ("-1,-1,2.5\n", &["0 of 1", "give 1 or more"]),
    ("63.6,4,2.5\n", &["0 of 1", "give 1 or more"]),
    ("\"3,4,2.5\n", &["no depth", "separated by commas"]),
    ("\0\0\0\0", &["no depth", "separated by commas"]),
    ("# x y z\n# 3 4 2.5\n", &["no depth"]),
];

#[test]
pub(crate) fn unusable_known_depths() {
    let place = Place::new();
    let with = |path: &std::path::Path| {
        format!(
            "refine image.png --prior-depth depth.npy --preset fast --no-nerf --scale-from {}",
            path.display()
        )
    };
    let mut cases = Vec::new();
    for (index, (text, told)) in KNOWN.iter().enumerate() {
        let name = format!("known-{index}.csv");
        place.write(&name, text);
        let told: Vec<_> = told.iter().copied().chain([".csv"]).collect();
        cases.push(refused(with(&place.path(&name)), &told));
    }
    // A COLMAP model: of other photographs, without points, and none at all.
    let model = |name: &str, images: &str, points: &str| {
        let folder = place.path(name);
        fs::create_dir_all(&folder).unwrap();
        fs::write(folder.join("cameras.txt"), "1 PINHOLE 64 48 60 60 32 24\n").unwrap();
        fs::write(folder.join("images.txt"), images).unwrap();
        fs::write(folder.join("points3D.txt"), points).unwrap();
        folder
    };
    let own = "1 1 0 0 0 0 0 0 1 image.png\n\n";
    let point = "1 0 0 2 9 9 9 0.5 1 0\n";
    for (name, images, points, told) in [
        ("other", "1 1 0 0 0 0 0 0 1 a.png\n\n", point, &["image.png", "0 photographs of that name"]),
        (
            "double",
            "1 1 0 0 0 0 0 0 1 a/image.png\n\n2 1 0 0 0 0 0 0 1 b/image.png\n\n",
            point,
            &["image.png", "2 photographs"],
        ),
        ("pointless", own, "", &["pointless", "no depth"]),
        ("behind", own, "1 0 0 -2 9 9 9 0.5 1 0\n", &["behind", "no depth"]),
        ("beside", own, "1 9 0 2 9 9 9 0.5 1 0\n", &["beside", "no depth"]),
        ("unseen", own, "1 0 0 2 9 9 9 0.5 7 0\n", &["unseen", "no depth"]),
        ("lensless", "1 1 0 0 0 0 0 0 7 image.png\n\n", point, &["camera 7", "not among"]),
        ("turned", "1 0 0 0 0 0 0 0 1 image.png\n\n", point, &["image.png", "unit length"]),
    ] {
        cases.push(refused(with(&model(name, images, points)), told));
    }
    cases.push(refused(with(std::path::Path::new("empty")), &["empty", "cameras.txt"]));
    check(&cases);
}

/// A field of the record in a saved field's header, what is put there, and what the message must contain.
const FIELDS: &[(&str, &str, &[&str])] = &[
    ("/version", "2", &["version is 2", "fit the field again"]),
    ("/version", "null", &["not a usable field", "give a file"]),
    ("/config/field/levels", "99", &["field.levels is 99", "1 to 24"]),
    ("/config/field/levels", "3", &["do not fit its configuration"]),
    ("/config/field/width", "-8", &["not a usable field", "give a file"]),
    ("/config/field/kind", "\"splat\"", &["splat", "hash"]),
    ("/config/sampling", "3", &["not a usable field"]),
    ("/config/render/coarse", "1", &["render.coarse is 1", "2 to 1024"]),
    ("/frustum/near", "-1.5", &["near and far", "fit the field again"]),
    ("/frustum/near", "0.0", &["near and far", "fit the field again"]),
    ("/frustum/near", "1e300", &["near and far", "fit the field again"]),
    ("/frustum/far", "0.5", &["near and far", "fit the field again"]),
    ("/frustum/unit", "0.0", &["unit is not positive", "fit the field again"]),
    ("/frustum/unit", "null", &["not a usable field"]),
    ("/frustum/scale/0", "-0.77", &["scale is not positive", "fit the field again"]),
    ("/frustum/rotation/0/0", "2.0", &["rotation", "fit the field again"]),
    ("/frustum/rotation/0/0", "-1.0", &["rotation", "fit the field again"]),
    ("/frustum/rotation/0", "[1.0, 0.0]", &["not a usable field"]),
    ("/checksum", "7", &["checksum is wrong", "fit the field again"]),
    ("/seed", "-1", &["not a usable field"]),
];

#[test]
pub(crate) fn unusable_fields() {
    let place = Place::new();
    let refine =
        "refine image.png --prior-depth depth.npy --fov 60 --config tiny.toml --save-field -q -o fit";
    place.mde(refine).assert().success();
    let good = fs::read(place.path("fit/field.safetensors")).unwrap();
    let length = u64::from_le_bytes(*good.first_chunk().unwrap()) as usize;
    let (text, tensors) = good[8..].split_at(length);
    let text = std::str::from_utf8(text).unwrap();
    let written =
        |header: &str| [&(header.len() as u64).to_le_bytes()[..], header.as_bytes(), tensors].concat();
    let with = |from: &str, to: &str| {
        let changed = text.replace(from, to);
        assert!(changed != text, "{from} is not in {text}");
        written(&changed)
    };
    let mut flipped = good.clone();
    *flipped.last_mut().unwrap() ^= 1;
    let mut endless = good.clone();
    endless[..8].copy_from_slice(&u64::MAX.to_le_bytes());
    let mut files: Vec<(Vec<u8>, &[&'static str])> = vec![
        (good[..7].to_vec(), &["give a file written by"]),
        (good[..200].to_vec(), &["give a file written by"]),
        (good[..good.len() - 4].to_vec(), &["give a file written by"]),
        ([&good[..], b"more"].concat(), &["give a file written by"]),
        (endless, &["give a file written by"]),
        (flipped, &["damaged", "fit the field again"]),
        (with("\\\"steps\\\":60", "\\\"steps\\\":61"), &["checksum of its header", "fit the field again"]),
        (with("mde-nerf", "mde-derf"), &["give a file written by"]),
        (with("\"network\"", "\"netwrok\""), &["network", "give a file written by"]),
        (with("\"F32\"", "\"I32\""), &["32-bit floats"]),
        (with("\"F32\"", "\"F64\""), &["give a file written by"]),
    ];
    for (field, value, told) in FIELDS {
        let mut outer: Value = serde_json::from_str(text).unwrap();
        let record = &mut outer["__metadata__"]["mde-nerf"];
        let mut inner: Value = serde_json::from_str(record.as_str().unwrap()).unwrap();
        *inner.pointer_mut(field).unwrap() = serde_json::from_str(value).unwrap();
        // Without its checksum, as in older files.
        inner.as_object_mut().unwrap().remove("header_checksum");
        *record = json!(inner.to_string());
        files.push((written(&outer.to_string()), told));
    }
    let cases: Vec<Case> = files
        .into_iter()
        .enumerate()
        .map(|(index, (bytes, told))| {
            let name = format!("field-{index}.safetensors");
            place.write(&name, bytes);
            let told: Vec<_> = told.iter().copied().chain(["field-"]).collect();
            refused(format!("render --field {} --size 64x48", place.path(&name).display()), &told)
        })
        .collect();
    check(&cases);
}

/// A fuzz target whose seeds are refused for their version never gets further. The crate's package has no such folder.
#[test]
fn the_seeds_of_fuzzing_are_fields_of_this_version() {
    let place = Place::new();
    let folder = concat!(env!("CARGO_MANIFEST_DIR"), "/../fuzz/seeds/saved_field");
    for (index, entry) in fs::read_dir(folder).into_iter().flatten().enumerate() {
        let path = entry.unwrap().path();
        let render = format!("render --field {} --size 8x8 --fov 60 -q -o {index}", path.display());
        place.mde(&render).assert().success();
    }
}

#[test]
pub(crate) fn damaged_calibrations() {
    let good = include_str!("../../src/calibration/default.toml");
    let with = |from: &str, to: &str| {
        let changed = good.replacen(from, to, 1);
        assert!(changed != good, "{from} is not in the calibration");
        changed
    };
    let without =
        |from: &str| good.lines().filter(|line| !line.starts_with(from)).collect::<Vec<_>>().join("\n");
    let files: Vec<(String, &[&'static str])> = vec![
        (String::new(), &["format"]),
        (good[..300].to_owned(), &[]),
        (with("format = 2", "format = 1"), &["format is 1"]),
        (with("format = 2", "format = 3"), &["format is 3"]),
        (with("format = 2", "format = 'two'"), &["format"]),
        (without("settings"), &["settings"]),
        (without("half-widths"), &["half-widths"]),
        (without("[source]"), &["source"]),
        (with("half-widths = [0.0, ", "half-widths = ["), &[]),
        (with("0.007735", "-0.007735"), &[]),
        (with("0.007735", "nan"), &[]),
        (with("0.007735", "inf"), &[]),
        (with("0.007735", "'wide'"), &["half-widths"]),
        (with("0.007735", "9.0"), &[]),
        (with("scale-error = 0.118816", "scale-error = -1.0"), &["scale-error", "0 to 10"]),
        (with("scale-error = 0.118816", "scale-error = nan"), &["scale-error", "0 to 10"]),
        (with("scale-error = 0.118816", "scale-error = 'much'"), &["scale-error"]),
        (with("scale-error", "scale-terror"), &["scale-terror"]),
        (with("probability = 0.5", "probability = 'half'"), &["probability"]),
    ];
    let place = Place::new();
    let cases: Vec<Case> = files
        .into_iter()
        .enumerate()
        .map(|(index, (text, told))| {
            let name = format!("calibration-{index}.toml");
            place.write(&name, text);
            let told: Vec<_> = told.iter().copied().chain(["calibration-", "calibrate again"]).collect();
            let path = place.path(&name);
            refused(
                format!("refine image.png --prior-depth depth.npy --calibration {}", path.display()),
                &told,
            )
        })
        .collect();
    check(&cases);
}

#[test]
pub(crate) fn unusable_maps_and_places() {
    let place = Place::new();
    let places = |name: &str, text: &[u8]| {
        place.write(name, text);
        format!(
            "eval --dataset rooms --limit 1 --size 64x48 --methods guided --places {}",
            place.path(name).display()
        )
    };
    check(&[
        refused(places("unplaced.txt", b"study-0\n"), &["study-0", "white space"]),
        refused(places("twice.txt", b"study-0 a\nstudy-0 b\n"), &["study-0 b", "give each scene once"]),
        refused(places("strange.txt", b"attic b\n"), &["attic", "study-0"]),
        refused(places("latin.txt", b"caf\xe9 a\n"), &["latin.txt"]),
        refused(places("bytes.txt", &[0xff, 0xfe, 0]), &["bytes.txt"]),
        refused("eval --dataset rooms --places nowhere.txt", &["nowhere.txt"]),
        refused("eval --dataset rooms --places folder.png", &["folder.png"]),
        refused("eval --pred maps --gt maps --sigma none", &["none"]),
        refused("eval --pred maps --gt maps --sigma empty", &["empty"]),
        refused("eval --pred maps --gt maps --sigma small-maps", &["a.npy", "[24, 32]"]),
        refused("eval --pred maps --gt maps --gt-scale 0", &["--gt-scale", "0 is no scale"]),
        refused("eval --pred maps --gt maps --pred-scale nan", &["--pred-scale", "NaN is no scale"]),
        refused("eval --pred maps --gt maps --pred-scale=-1", &["--pred-scale", "-1 is no scale"]),
        refused("eval --pred maps --gt maps --min-depth 9", &["a.npy", "check the depth range"]),
        refused("eval --pred maps --gt maps --min-depth 3 --max-depth 2", &["max-depth"]),
        refused("eval --pred maps --gt maps --max-depth nan", &["max-depth"]),
        refused("eval --pred maps --gt maps --max-depth=-2", &["max-depth"]),
        refused("eval --pred cut-priors --gt maps", &["a.npy", "truncated"]),
        refused("eval --pred file --gt maps", &["file"]),
        refused("eval --pred maps --gt file", &["file"]),
        refused("eval --pred shots --gt maps", &["shots"]),
        misused("eval --pred maps --gt maps --alignment best -o out", &["best", "median"]),
        misused("eval --dataset captures --photographs two -o out", &["--photographs"]),
        refused("eval --dataset captures --photographs 1", &["photographs"]),
        refused("eval --dataset captures --baseline nan", &["baseline"]),
        refused("eval --dataset captures --baseline=-1", &["baseline"]),
        refused("eval --dataset captures --pose-noise inf", &["pose-noise"]),
        refused("eval --dataset captures --gain nan", &["gain"]),
        misused("eval good-set --prior-depth priors --assume-fov 0 -o out", &["--assume-fov", "below 180"]),
        misused("eval good-set --prior-depth priors --assume-fov nan -o out", &["--assume-fov", "below 180"]),
        misused("eval good-set --prior-depth priors --assume-fov 180 -o out", &["--assume-fov", "below 180"]),
        refused("eval good-set --prior-depth priors --png-scale 0", &["--png-scale", "0 is no scale"]),
        misused("eval good-set --prior-depth priors --stride 0 -o out", &["--stride"]),
    ]);
}
