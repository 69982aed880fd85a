//! Size, memory, and a disk that takes no more.
#![allow(clippy::unwrap_used)]

mod common;

use common::{HEIGHT, Place, TINY, WIDTH, names};
use mde_cli::config::{Config, Preset};
#[cfg(feature = "onnx")]
use mde_cli::mde_prior::OnnxPrior;
use mde_cli::mde_prior::format::{ReadOptions, read_values, write_npy};
use mde_cli::mde_prior::photo::write_image;
#[cfg(feature = "onnx")]
use mde_cli::naming::Naming;
use mde_cli::refiner::plan::inference::PhotographMemory;
#[cfg(feature = "onnx")]
use mde_cli::refiner::plan::limit::MemoryLimit;
use mde_cli::refiner::plan::{SceneMemory, refine_bytes};
use ndarray::{Array2, Array3};
use serde_json::Value;
use std::fs;
use std::path::Path;

fn record(folder: &Path) -> Value {
    serde_json::from_str(&fs::read_to_string(folder.join("run.json")).unwrap()).unwrap()
}

/// A picture of that size with its depth: `large.png`, `large.npy`. Enlarged, as a room takes seconds to render at such a size.
fn large(place: &Place, width: usize, height: usize) {
    let small = &place.scene;
    let from = |y: usize, x: usize| (y * HEIGHT / height, x * WIDTH / width);
    let image =
        Array3::from_shape_fn((height, width, 3), |(y, x, c)| small.image[[from(y, x).0, from(y, x).1, c]]);
    let depth =
        Array2::from_shape_fn((height, width), |(y, x)| small.depth[from(y, x)] + 1e-4 * (x + 2 * y) as f32);
    write_image(place.path("large.png"), image.view()).unwrap();
    write_npy(place.path("large.npy"), depth.view()).unwrap();
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
    assert!(said.contains("warning: resized from 256x192 to 64x48 pixels; --max-size sets this"), "{said}");
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
    place.write("many.toml", "refinement.order = 'paper'\nviews.count = 1000000");
    place.write(
        "grid.toml",
        "refinement.order = 'paper'\nnerf.field = { log2-rows = 24, levels = 24, features = 8 }",
    );
    fs::create_dir(place.path("maps")).unwrap();
    fs::copy(place.path("large.npy"), place.path("maps/large.npy")).unwrap();
    let refine = "refine large.png --prior-depth large.npy --fov 60";
    for (arguments, told) in [
        (
            format!("{refine} --preset paper --max-memory 0.2"),
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
        (
            "eval --dataset rooms --size 16384x16384".into(),
            &["--size", "16384x16384", "--max-memory 8", "give --size"],
        ),
        (
            "eval --dataset rooms --size 640x480 --methods fast --jobs 2 --threads 2 --max-memory 0.3".into(),
            &["--size", "640x480", "2 scenes at once", "fewer --jobs"],
        ),
        (
            "eval --dataset rooms --size 64x48 --methods many.toml,grid.toml".into(),
            &["64x48", "smaller field"],
        ),
        ("ablate --dataset rooms --size 4096x4096".into(), &["--size", "4096x4096", "--max-memory 8"]),
        ("ablate --dataset rooms --limit 1 --max-memory 0.2".into(), &["study-0", "640x480", "give --size"]),
        ("calibrate --dataset rooms --size 9999x9999".into(), &["--size", "9999x9999", "give --size"]),
        ("eval --pred maps --gt maps --max-memory 0.1".into(), &["large.npy", "640x480", "smaller maps"]),
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

/// As many rays and samples as a step may have: estimated, and refused before any is taken.
#[test]
fn the_most_rays_and_samples_are_refused_by_their_estimate() {
    let place = Place::new();
    let text = "refinement.order = 'paper'\nnerf.train.rays = 65536\nnerf.sampling = { coarse = 1024, fine = 1024 }\n";
    place.write("rays.toml", text);
    let config = Config::with_overrides(Preset::Default, text, "rays.toml").unwrap();
    let estimate = refine_bytes((WIDTH * HEIGHT) as u64, &config);
    assert!(estimate > 8 << 30, "{estimate}");
    let refine = "refine image.png --prior-depth depth.npy --fov 60 --config rays.toml -q -o out";
    let refused = place.mde(refine).assert().code(1);
    let told = String::from_utf8(refused.get_output().stderr.clone()).unwrap();
    assert!(
        told.contains("--max-memory 8") && told.contains("fewer rays") && told.lines().count() == 1,
        "{told}"
    );
}

/// Linux reports the peak; the estimate is above it, but not far above.
#[test]
fn the_estimate_bounds_what_a_run_takes() {
    let place = Place::new();
    large(&place, 640, 480);
    let quick = TINY
        .replace("steps = 60", "steps = 5")
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

/// With the predictions of a network, side by side and one at a time, within a quarter of the peak when it was measured.
#[test]
#[cfg(feature = "onnx")]
#[ignore = "needs the networks and photographs that MDE_SHARED names"]
fn the_estimate_has_the_network() {
    let shared = common::shared();
    let (network, photo) =
        (shared.join("models/fastdepth/fastdepth_224.onnx"), shared.join("data/plain/nyu_living/color.png"));
    let (place, config, size) = (Place::new(), Preset::Default.config(), (480, 640));
    let prior = OnnxPrior::open_guessed(&network).unwrap();
    for (threads, gib) in [(1, 8.0), (2, 8.0), (4, 8.0), (4, 0.17)] {
        let memory = PhotographMemory::new(&config, &prior, size, size, threads);
        let limit = MemoryLimit { gib, naming: Naming::Flags };
        let at_once = memory.predictions_at_once(&limit, "photo", size).unwrap();
        assert_eq!(at_once < threads, gib < 1.0, "{at_once}");
        let mut run = place.mde(&format!("refine --threads {threads} --max-memory {gib} --force -q -o out"));
        run.arg(&photo).arg("--prior-model").arg(&network).assert().success();
        let Some(peak) = record(&place.path("out"))["peak_memory_bytes"].as_f64() else { return };
        let ratio = memory.bytes(640 * 480, at_once as u64) as f64 / peak;
        assert!((0.65..1.4).contains(&ratio), "{threads} threads, {gib} GiB: {ratio:.2} of {peak}");
    }
}

/// Of what grows with the rays of a step, with the network and with the grid, not with the image.
#[test]
fn the_estimate_of_a_large_fit_is_close() {
    let place = Place::new();
    let cases = [
        ("samples", "nerf.sampling = { coarse = 64, fine = 64 }", "levels = 8\nfeatures = 4", 16384),
        ("fewer-features", "nerf.sampling = { coarse = 256, fine = 256 }", "levels = 8\nfeatures = 2", 4096),
        ("grid", "", "levels = 16\nfeatures = 4\nlog2-rows = 20\nfinest = 2048", 512),
    ];
    for (name, sampling, field, rays) in cases {
        let text = format!(
            "refinement = {{ iterations = 1, order = 'paper' }}\nviews.count = 1\nnovel.count = 1\n{sampling}\n\
             [nerf.train]\nsteps = 2\nrays = {rays}\n[nerf.render]\ncoarse = 4\nfine = 4\n\
             [nerf.field]\nkind = 'hash'\n{field}\n"
        );
        near(&place, name, &text);
    }
    let mlp = "refinement = { iterations = 1, order = 'paper' }\nviews.count = 1\nnovel.count = 1\n[nerf.train]\nsteps = 2\nrays = 512\n\
               [nerf.render]\ncoarse = 4\nfine = 4\n[nerf.field]\nkind = 'mlp'\nlayers = 8\nwidth = 512\n";
    near(&place, "network", mlp);
}

/// The peak of a run is below the estimate, and at most a quarter of it below.
fn near(place: &Place, name: &str, text: &str) {
    let (estimate, Some(peak)) = estimate_and_peak(place, name, text) else { return };
    assert!(estimate > 120 << 20, "{name}: {estimate}");
    assert!((peak..=peak + peak / 4).contains(&estimate), "{name}: estimate {estimate}, peak {peak}");
}

/// The estimate of a run with these settings over the preset fast, and its peak where the system reports it.
fn estimate_and_peak(place: &Place, name: &str, text: &str) -> (u64, Option<u64>) {
    place.write("near.toml", text);
    let config = Config::with_overrides(Preset::Fast, text, "near.toml").unwrap();
    let run = "refine image.png --prior-depth depth.npy --fov 60 --preset fast --config near.toml -q";
    place.mde(&format!("{run} --max-memory 64 -o {name}")).assert().success();
    let peak = record(&place.path(name))["peak_memory_bytes"].as_u64();
    (refine_bytes((WIDTH * HEIGHT) as u64, &config), peak)
}

/// Rays of a step, samples of a ray in both passes, and the field.
const GRID: [(u32, u32, &str); 29] = [
    (65536, 128, "kind = 'hash'\nlevels = 8\nfeatures = 4"),
    (65536, 32, "kind = 'hash'\nlevels = 8\nfeatures = 4"),
    (65536, 128, "kind = 'hash'\nlevels = 4\nfeatures = 1"),
    (32768, 64, "kind = 'hash'\nlevels = 12\nfeatures = 2"),
    (16384, 256, "kind = 'hash'\nlevels = 8\nfeatures = 4"),
    (16384, 128, "kind = 'hash'\nlevels = 16\nfeatures = 2"),
    (16384, 64, "kind = 'hash'\nlevels = 16\nfeatures = 8"),
    (16384, 128, "kind = 'hash'\nlevels = 16\nfeatures = 4\nlog2-rows = 20\nfinest = 2048"),
    (4096, 1024, "kind = 'hash'\nlevels = 4\nfeatures = 2"),
    (4096, 512, "kind = 'hash'\nlevels = 8\nfeatures = 8"),
    (4096, 128, "kind = 'hash'\nlevels = 12\nfeatures = 2\nlog2-rows = 19"),
    (4096, 128, "kind = 'hash'\nlevels = 24\nfeatures = 4"),
    (4096, 128, "kind = 'hash'\nlevels = 8\nfeatures = 4\nlayers = 4\nwidth = 256"),
    (1024, 2048, "kind = 'hash'\nlevels = 8\nfeatures = 4"),
    (1024, 1024, "kind = 'hash'\nlevels = 16\nfeatures = 1"),
    (512, 32, "kind = 'hash'\nlevels = 16\nfeatures = 4\nlog2-rows = 20\nfinest = 2048"),
    (512, 32, "kind = 'hash'\nlevels = 16\nfeatures = 8\nlog2-rows = 20\nfinest = 2048"),
    (512, 32, "kind = 'hash'\nlevels = 16\nfeatures = 2\nlog2-rows = 22\nfinest = 4096"),
    (512, 32, "kind = 'hash'\nlevels = 8\nfeatures = 4\nlog2-rows = 22\nfinest = 2048"),
    (512, 32, "kind = 'hash'\nlevels = 4\nfeatures = 8\nlog2-rows = 21\nfinest = 1024"),
    (512, 32, "kind = 'mlp'\nlayers = 8\nwidth = 512"),
    (512, 32, "kind = 'mlp'\nlayers = 16\nwidth = 512"),
    (512, 32, "kind = 'mlp'\nlayers = 4\nwidth = 1024"),
    (512, 32, "kind = 'mlp'\nlayers = 8\nwidth = 1024"),
    (256, 16, "kind = 'mlp'\nlayers = 16\nwidth = 1024"),
    (2048, 32, "kind = 'mlp'\nlayers = 8\nwidth = 256"),
    (2048, 32, "kind = 'mlp'\nlayers = 8\nwidth = 512"),
    (1024, 64, "kind = 'mlp'\nlayers = 4\nwidth = 512"),
    (32, 16, "kind = 'mlp'\nlayers = 16\nwidth = 1024"),
];

/// Peaks of short fits over a grid of settings; `docs/reliability.md` has the summary of `memory.txt` in the folder of
/// temporary files that cargo gives to tests.
#[test]
#[ignore = "takes minutes"]
fn the_estimates_over_a_grid_of_settings_are_close() {
    let place = Place::new();
    let (mut ratios, mut lines) = (Vec::new(), Vec::new());
    for (index, (rays, samples, field)) in GRID.into_iter().enumerate() {
        let half = samples / 2;
        let text = format!(
            "refinement = {{ iterations = 1, order = 'paper' }}\nviews.count = 1\nnovel.count = 1\n\
             nerf.sampling = {{ coarse = {half}, band = 0, fine = {half} }}\n[nerf.train]\nsteps = 2\nrays = {rays}\n\
             [nerf.render]\ncoarse = 4\nfine = 4\n[nerf.field]\n{field}\n"
        );
        let (estimate, Some(peak)) = estimate_and_peak(&place, &format!("grid{index}"), &text) else {
            return;
        };
        let ratio = estimate as f64 / peak as f64;
        let mebibytes = [estimate, peak].map(|bytes| bytes >> 20);
        lines.push(format!("{rays} x {samples}, {field:?}: {mebibytes:?} {ratio:.2}"));
        if peak > 100 << 20 {
            ratios.push(ratio);
        }
    }
    ratios.sort_by(f64::total_cmp);
    let close = ratios.iter().filter(|ratio| (1.0..=1.25).contains(*ratio)).count();
    let text = lines.join("\n");
    let summary = format!("{text}\n{close} of {} within 25 %: {ratios:.2?}\n", ratios.len());
    fs::write(Path::new(env!("CARGO_TARGET_TMPDIR")).join("memory.txt"), summary).unwrap();
    assert!(ratios.len() >= 25 && close == ratios.len(), "{close} of {}:\n{text}", ratios.len());
}

/// The folder of one that is replaced stays too.
#[test]
fn an_evaluation_fails_only_where_its_scenes_are_too_large() {
    let place = Place::new();
    large(&place, 640, 480);
    fs::create_dir(place.path("priors")).unwrap();
    for (id, image, depth) in [("a", "image.png", "depth.npy"), ("b", "large.png", "large.npy")] {
        let scene = place.path("set").join(id);
        fs::create_dir_all(&scene).unwrap();
        fs::write(scene.join("scene.json"), "{}").unwrap();
        fs::copy(place.path(image), scene.join("color.png")).unwrap();
        fs::copy(place.path(depth), scene.join("depth.npy")).unwrap();
        fs::copy(place.path(depth), place.path(&format!("priors/{id}.npy"))).unwrap();
    }
    let eval = "eval set --prior-depth priors --methods guided --quiet -o out";
    let run = place.mde(&format!("{eval} --max-memory 0.15")).assert().code(3);
    let message = String::from_utf8(run.get_output().stderr.clone()).unwrap();
    assert!(["b:", "640x480", "--max-memory 0.15", "give --size"].iter().all(|part| message.contains(part)));
    assert_eq!(names(&place.path("out/scenes")), ["a"]);
    // What is refused at once leaves what is there.
    place.mde(&format!("{eval} --size 9999x9999 --force")).assert().code(1);
    assert_eq!(names(&place.path("out/scenes")), ["a"]);
    place.mde(eval).assert().success();
    assert_eq!(names(&place.path("out/scenes")), ["a", "b"]);
}

/// The same for an evaluation.
#[test]
#[cfg(target_os = "linux")]
fn the_estimate_bounds_what_an_evaluation_takes() {
    let place = Place::new();
    let text = TINY.replace("steps = 60", "steps = 5").replace("= 8\n", "= 2\n");
    place.write("quick.toml", &text);
    let quick = |preset| Config::with_overrides(preset, &text, "quick.toml").unwrap();
    let (eval, ablate) = (Some(quick(Preset::Default)), quick(Preset::Paper));
    let seeds = [0, 1].map(|seed| Some(Config { seed, ..ablate.clone() }));
    let shared = [[None].as_slice(), &seeds].concat();
    for (arguments, methods, share, jobs) in [
        ("eval --methods prior --limit 1", &[None][..], false, 1),
        ("eval --methods guided,fbs --limit 1", &[None, None, None], false, 1),
        ("eval --methods quick.toml --limit 1", &[None, eval.clone()], false, 1),
        ("eval --methods quick.toml --limit 2 --jobs 2 --threads 2", &[None, eval], false, 2),
        ("ablate --rows full --seeds 2 --limit 1 --config quick.toml", &shared, true, 1),
    ] {
        let mut run = std::process::Command::new(env!("CARGO_BIN_EXE_mde"))
            .current_dir(place.path("."))
            .args(arguments.split_whitespace())
            .args("--dataset rooms --size 320x240 --quiet -o out".split_whitespace())
            .spawn()
            .unwrap();
        let status = format!("/proc/{}/status", run.id());
        let mut peak = 0;
        while run.try_wait().unwrap().is_none() {
            let text = fs::read_to_string(&status).unwrap_or_default();
            let line = text.lines().find_map(|line| line.strip_prefix("VmHWM:")?.strip_suffix("kB"));
            peak = line.map_or(peak, |kibibytes| 1024 * kibibytes.trim().parse::<u64>().unwrap());
            std::thread::sleep(std::time::Duration::from_millis(5));
        }
        assert!(run.wait().unwrap().success(), "{arguments}");
        let estimate = SceneMemory::new(methods, share).bytes(320 * 240, jobs);
        assert!((peak..4 * peak).contains(&estimate), "{arguments}: estimate {estimate}, peak {peak}");
        fs::remove_dir_all(place.path("out")).unwrap();
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
