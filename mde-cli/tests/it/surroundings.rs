//! Names that are no Unicode, a system without threads, a full disk.

use crate::common::{Place, REFINE, fixture, names};
use mde_cli::mde_prior::format::write_png16;
use std::ffi::OsString;
use std::fs;
use std::os::unix::ffi::{OsStrExt, OsStringExt};
use std::process::Command;

/// `text` with every `?` as a byte that is no UTF-8.
fn odd(text: &str) -> OsString {
    OsString::from_vec(text.bytes().map(|byte| if byte == b'?' { 0xff } else { byte }).collect())
}

#[test]
fn paths_need_not_be_unicode() {
    let place = Place::new();
    let folder = place.path(".");
    write_png16(place.path("depth.png"), place.scene.depth.view(), 1000.0).unwrap();
    place.take(fixture("grey_nchw.onnx"), "net.onnx");
    place.write("scene.json", r#"{"fx": 60, "fy": 60, "cx": 31.5, "cy": 23.5}"#);
    for (from, to) in [
        ("image.png", "ph?.png"),
        ("depth.npy", "d?.npy"),
        ("tiny.toml", "t?.toml"),
        ("depth.npy", "maps?/a.npy"),
        ("depth.npy", "gt?/a.npy"),
        ("depth.npy", "pr?/scene.npy"),
        ("image.png", "data?/scene/color.png"),
        ("depth.png", "data?/scene/depth.png"),
        ("scene.json", "data?/scene/scene.json"),
        ("image.png", "shots?/a?.png"),
        ("image.png", "shots?/b.png"),
        ("net.onnx", "net?.onnx"),
    ] {
        let to = folder.join(odd(to));
        fs::create_dir_all(to.parent().unwrap()).unwrap();
        fs::copy(place.path(from), to).unwrap();
    }
    #[cfg(feature = "onnx")]
    let net = "--prior-model net?.onnx --model-profile fastdepth --fov 60";
    let eval = "data? --dataset plain --prior-depth pr? -q";
    for arguments in [
        "refine ph?.png --prior-depth d?.npy --gt d?.npy --fov 60 --config t?.toml --export ply,colmap,field -o out?",
        "refine ph?.png --prior-depth d?.npy --fov 60 --config t?.toml --log-json -o json?",
        "refine ph?.png --prior-depth d?.npy --fov 60 --no-nerf -o q?/deep?",
        "warp ph?.png --prior-depth d?.npy --fov 60 --config t?.toml --log-json -o views?",
        "render --field out?/field.safetensors --size 32x24 --fov 60 --log-json -o render?",
        "report out?",
        #[cfg(feature = "onnx")]
        &format!("refine ph?.png {net} -o net?"),
        #[cfg(feature = "onnx")]
        &format!("refine shots? {net} --log-json -o many?"),
        #[cfg(feature = "onnx")]
        &format!("refine ph?.png --views shots? {net} --config t?.toml --log-json -o views-of?"),
        "score maps? --gt gt? -q -o scores?",
        &format!("eval {eval} --methods guided -o e?"),
        &format!("ablate {eval} --config t?.toml --rows min-depth --seeds 1 -o a?"),
        &format!("calibrate {eval} --method t?.toml -o c?"),
        "demo --preset fast --size 32x24 --config t?.toml -q -o demo?",
    ] {
        // An option's value that is text, and not a path, may still be refused with the usage.
        let expected = match arguments {
            text if text.contains("--method t?") => 2,
            // They are copies of the photograph.
            text if text.contains("--views") => 3,
            _ => 0,
        };
        place.mde("").args(arguments.split_whitespace().map(odd)).assert().code(expected);
    }
    // Only a file of JSON can't have such names.
    let poses = "poses image.png shots?/a?.png --prior-depth depth.npy --fov 60 -q -o found.json";
    let refused = place.mde("").args(poses.split_whitespace().map(odd)).assert().code(1);
    let told = String::from_utf8_lossy(&refused.get_output().stderr).into_owned();
    assert!(told.contains("not UTF-8") && told.lines().count() == 1, "{told}");
    let mut left = fs::read_dir(&folder).unwrap().map(|entry| entry.unwrap().file_name());
    assert!(!left.any(|name| name.as_bytes().starts_with(b".mde-")));
    assert!(folder.join(odd("out?")).join("report.html").is_file());
}

/// No thread starts whose stack is larger than the memory.
#[test]
fn a_system_without_threads_takes_one() {
    let place = Place::new();
    place.run(&format!("{REFINE} -q -o usual"));
    let alone = |arguments: &str| {
        place.mde(arguments).env("RUST_MIN_STACK", (1_u64 << 46).to_string()).assert().success();
    };
    alone(&format!("{REFINE} -q -o alone"));
    for map in ["depth.npy", "sigma.npy"] {
        assert!(place.bytes(&format!("usual/{map}")) == place.bytes(&format!("alone/{map}")), "{map}");
    }
    alone("eval --dataset rooms --size 64x48 --limit 2 --jobs 2 --methods guided -q -o e");
    assert_eq!(names(&place.path("e/scenes")).len(), 2);
}

/// A limit on the size of files stands for a full disk: the same writes fail. Nor is an empty folder left, there or with 4 open files.
#[test]
fn a_disk_that_takes_no_more_leaves_the_old_output() {
    let place = Place::new();
    let limited = |limit: &str, arguments: &str| {
        let script = format!("trap '' XFSZ; ulimit {limit}; exec {} {arguments}", env!("CARGO_BIN_EXE_mde"));
        let run = Command::new("sh").current_dir(place.path(".")).args(["-c", &script]).output().unwrap();
        let told = String::from_utf8(run.stderr).unwrap();
        assert!(limit == "-n 4" || told.contains("can't write"), "{arguments}: {told}");
        (run.status.code(), told.lines().count())
    };
    let before = place.entries();
    // Four files are enough where no two threads write at once.
    for (limit, tries) in [("-f 8", 1), ("-n 4", 20)] {
        let fails = |_| {
            let (code, _) = limited(limit, &format!("{REFINE} -q -o new/deep/out"));
            let _ = (code == Some(0)).then(|| fs::remove_dir_all(place.path("new")).unwrap());
            code == Some(1)
        };
        assert!((0..tries).any(fails), "{limit}");
        assert_eq!(place.entries(), before, "{limit}");
    }
    place.run(&format!("{REFINE} -q -o out"));
    let all = || names(&place.path("out")).iter().map(|name| place.bytes(&format!("out/{name}"))).collect();
    let old: Vec<_> = all();
    assert_eq!(limited("-f 8", &format!("{REFINE} -q --seed 3 --force -o out")), (Some(1), 1));
    assert!(all() == old && place.entries().len() == before.len() + 1);
    let eval = "eval --dataset rooms --size 64x48 --limit 1 --methods guided -q -o e";
    assert!(matches!(limited("-f 8", eval).0, Some(1 | 3)) && !place.has("e"));
    place.run(eval);

    let full = fs::OpenOptions::new().write(true).open("/dev/full").unwrap();
    let run = Command::new(env!("CARGO_BIN_EXE_mde")).arg("config").stdout(full).output().unwrap();
    let told = String::from_utf8(run.stderr).unwrap();
    assert!(run.status.code() == Some(1) && told.starts_with("error: "), "{told}");
    assert_eq!(told.lines().count(), 1, "{told}");
}
