//! Size, memory, and a disk that takes no more.
#![allow(clippy::unwrap_used)]

mod common;

use common::{HEIGHT, Place, TINY, WIDTH, names};
use mde_cli::mde_eval::scene::{Room, room};
use mde_cli::mde_prior::format::{ReadOptions, read_values, write_npy};
use mde_cli::mde_prior::photo::write_image;
use mde_cli::memory::refine_bytes;
use mde_cli::{Config, Preset};
use serde_json::Value;
use std::fs;
use std::path::Path;

fn record(folder: &Path) -> Value {
    serde_json::from_str(&fs::read_to_string(folder.join("run.json")).unwrap()).unwrap()
}

/// A picture of that size with its depth: `large.png`, `large.npy`.
fn large(place: &Place, width: usize, height: usize) {
    let scene = room(Room::Study, 0, width, height).unwrap();
    write_image(place.path("large.png"), scene.image.view()).unwrap();
    write_npy(place.path("large.npy"), scene.depth.view()).unwrap();
}

#[test]
fn what_is_too_large_is_resized_with_its_prior_camera_and_truth() {
    let place = Place::new();
    large(&place, 256, 192);
    place.write("k.json", r#"{"fx": 200, "fy": 210, "cx": 127.5, "cy": 95.5, "width": 256, "height": 192}"#);
    let run = place
        .mde(
            "refine large.png --prior-depth large.npy --gt large.npy --intrinsics k.json --max-size 64 \
             --config tiny.toml -o out",
        )
        .assert()
        .success();
    let said = String::from_utf8(run.get_output().stderr.clone()).unwrap();
    assert!(said.contains("warning: resized from 256x192 to 64x48 pixels"), "{said}");
    let map = |name: &str| read_values(place.path(name), &ReadOptions::default()).unwrap();
    let (prior, whole) = (map("out/prior.npy"), map("large.npy"));
    assert_eq!((prior.dim(), map("out/depth.npy").dim()), ((HEIGHT, WIDTH), (HEIGHT, WIDTH)));
    // Depths are picked, never mixed.
    assert!(prior.indexed_iter().all(|((y, x), z)| *z == whole[(4 * y + 2, 4 * x + 2)]));
    let camera = record(&place.path("out"))["camera"].clone();
    assert_eq!((camera["fx"].as_f64(), camera["fy"].as_f64()), (Some(50.0), Some(52.5)));
    assert_eq!((camera["cx"].as_f64(), camera["width"].as_u64()), (Some(31.5), Some(64)));
    place.mde("warp large.png --prior-depth large.npy --fov 60 --max-size 64 -o views").assert().success();
    let views = read_values(place.path("views/depth_01.npy"), &ReadOptions::default()).unwrap();
    assert_eq!(views.dim(), (HEIGHT, WIDTH));
    // What fits is left alone.
    let mut same = place
        .mde("refine image.png --prior-depth depth.npy --fov 60 --max-size 64 --config tiny.toml -o same");
    let said = same.output().unwrap().stderr;
    assert!(!String::from_utf8(said).unwrap().contains("resized"));
}

#[test]
fn too_much_memory_is_refused_before_it_is_taken() {
    let place = Place::new();
    large(&place, 640, 480);
    place.write("many.toml", "views.count = 1000000");
    place.write("grid.toml", "nerf.field = { log2-rows = 24, levels = 24, features = 8 }");
    let refine = "refine large.png --prior-depth large.npy --fov 60";
    for (arguments, told) in [
        (
            format!("{refine} --max-memory 0.2"),
            &["large.png", "640x480", "--max-memory 0.2", "pixels a side"][..],
        ),
        (format!("{refine} --config many.toml"), &["GiB", "fewer views"]),
        (format!("{refine} --config grid.toml"), &["GiB", "smaller field"]),
        ("warp large.png --prior-depth large.npy --max-memory 0.2".into(), &["large.png", "640x480"]),
        ("demo --size 16384x16384".into(), &["--size", "16384x16384", "--max-memory 8"]),
        (
            "render --field x --size 16384x16384 --orbit 9".into(),
            &["--size", "16384x16384", "--max-memory 8"],
        ),
    ] {
        let run = place.mde(&format!("{arguments} --quiet -o out")).assert().code(1);
        let message = String::from_utf8(run.get_output().stderr.clone()).unwrap();
        assert!(told.iter().all(|part| message.contains(part)), "{arguments}: {message}");
        assert_eq!(message.lines().count(), 1, "{message}");
        assert!(!place.path("out").exists());
    }
    // The stated size does fit.
    let mut run = place.mde(&format!("{refine} --max-memory 0.2 --max-size 64 --config tiny.toml -q -o out"));
    run.assert().success();
}

/// Linux tells the peak, and the estimate is above it, though not far above.
#[test]
fn the_estimate_bounds_what_a_run_takes() {
    let place = Place::new();
    large(&place, 640, 480);
    let quick = TINY
        .replace("steps = 200", "steps = 5")
        .replace("iterations = 2", "iterations = 1")
        .replace("= 8\n", "= 2\n");
    for (name, count) in [("few", 1), ("many", 20)] {
        let text = quick.replace("[views]\ncount = 3", &format!("[views]\ncount = {count}"));
        place.write("quick.toml", &text);
        let config = Config::with_overrides(Preset::Default, &text, "quick.toml").unwrap();
        place
            .mde(&format!(
                "refine large.png --prior-depth large.npy --fov 60 --config quick.toml -q -o {name}"
            ))
            .assert()
            .success();
        let Some(peak) = record(&place.path(name))["peak_memory_bytes"].as_u64() else { return };
        let estimate = refine_bytes(640 * 480, &config);
        assert!((peak..4 * peak).contains(&estimate), "{name}: estimate {estimate}, peak {peak}");
    }
}

/// A limit on the size of files stands for a full disk: the same writes fail, and no one's disk is filled.
#[test]
#[cfg(unix)]
fn a_disk_that_takes_no_more_leaves_the_old_output() {
    let place = Place::new();
    let mde = env!("CARGO_BIN_EXE_mde");
    let limited = |blocks: u32, arguments: &str| {
        let script = format!("trap '' XFSZ; ulimit -f {blocks}; exec {mde} {arguments}");
        let run = std::process::Command::new("sh")
            .current_dir(place.path("."))
            .args(["-c", &script])
            .output()
            .unwrap();
        (run.status.code(), String::from_utf8(run.stderr).unwrap())
    };
    let refine = "refine image.png --prior-depth depth.npy --fov 60 --config tiny.toml --quiet";
    let before = place.entries();
    let (code, message) = limited(8, &format!("{refine} -o out"));
    assert!(code == Some(1) && message.contains("can't write") && message.lines().count() == 1, "{message}");
    assert_eq!(place.entries(), before);

    place.mde(&format!("{refine} -o out")).assert().success();
    let old =
        names(&place.path("out")).into_iter().map(|name| fs::read(place.path("out").join(name)).unwrap());
    let old: Vec<_> = old.collect();
    let (code, message) = limited(8, &format!("{refine} --seed 3 --force -o out"));
    assert!(code == Some(1) && message.contains("can't write"), "{message}");
    let now =
        names(&place.path("out")).into_iter().map(|name| fs::read(place.path("out").join(name)).unwrap());
    assert!(now.collect::<Vec<_>>() == old);
    fs::remove_dir_all(place.path("out")).unwrap();
    assert_eq!(place.entries(), before);

    let (code, message) = limited(8, "eval --dataset rooms --size 64x48 --limit 1 --methods guided -q -o e");
    assert!(matches!(code, Some(1 | 3)) && message.contains("can't write"), "{code:?} {message}");
    place.mde("eval --dataset rooms --size 64x48 --limit 1 --methods guided -q -o e").assert().success();
}

#[test]
#[cfg(target_os = "linux")]
fn a_full_stdout_is_told() {
    let full = fs::OpenOptions::new().write(true).open("/dev/full").unwrap();
    let run = std::process::Command::new(env!("CARGO_BIN_EXE_mde"))
        .args(["config", "--preset", "paper"])
        .stdout(full)
        .output()
        .unwrap();
    let message = String::from_utf8(run.stderr).unwrap();
    assert!(run.status.code() == Some(1) && message.starts_with("error: ") && message.lines().count() == 1);
}
