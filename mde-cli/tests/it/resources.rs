//! Sizes, and the estimates of memory against the peaks of runs, where the system reports them.

use crate::common::{HEIGHT, Place, REFINE, WIDTH, config, shared, tiny};
use mde_cli::refiner::{SceneMemory, refine_bytes};
use mde_cli::{Config, Preset};
use ndarray::{Array2, Array3};
use std::fs;

/// A picture of that size with its depth: `large.png`, `large.npy`. Enlarged, as a room takes seconds to render at such a size.
fn large(place: &Place, width: usize, height: usize) {
    let small = &place.scene;
    let from = |y: usize, x: usize| (y * HEIGHT / height, x * WIDTH / width);
    let image =
        Array3::from_shape_fn((height, width, 3), |(y, x, c)| small.image[[from(y, x).0, from(y, x).1, c]]);
    let depth =
        Array2::from_shape_fn((height, width), |(y, x)| small.depth[from(y, x)] + 1e-4 * (x + 2 * y) as f32);
    place.photograph("large.png", image.view());
    place.save("large.npy", &depth);
}

const LARGE: &str = "refine large.png --prior-depth large.npy";

#[test]
fn what_is_too_large_is_resized_with_its_prior_camera_and_truth() {
    let place = Place::new();
    large(&place, 256, 192);
    place.write("k.json", r#"{"fx": 200, "fy": 210, "cx": 127.5, "cy": 95.5, "width": 256, "height": 192}"#);
    let resized = "--gt large.npy --intrinsics k.json --max-size 64 --config tiny.toml -o out";
    let words = "warning: resized from 256x192 to 64x48 pixels; --max-size sets this";
    place.prints(&format!("{LARGE} {resized}"), 0, words);
    let (prior, whole) = (place.map("out/prior.npy"), place.map("large.npy"));
    assert_eq!([prior.dim(), place.map("out/depth.npy").dim()], [(HEIGHT, WIDTH); 2]);
    // Depths are picked, never mixed.
    assert!(prior.indexed_iter().all(|((y, x), z)| *z == whole[(4 * y + 2, 4 * x + 2)]));
    let camera = place.record("out")["camera"].clone();
    assert_eq!((camera["fx"].as_f64(), camera["fy"].as_f64()), (Some(50.0), Some(52.5)));
    assert_eq!((camera["cx"].as_f64(), camera["width"].as_u64()), (Some(31.5), Some(64)));
    place.run("warp large.png --prior-depth large.npy --fov 60 --max-size 64 -o views");
    assert_eq!(place.map("views/depth_01.npy").dim(), (HEIGHT, WIDTH));
    // What fits is left alone.
    place.prints(&format!("{REFINE} --max-size 64 -o same"), 0, "!resized");
}

/// The estimate is above the peak, but not far above: of views and pixels, of the samples of a step, the network and the grid.
#[test]
fn the_estimate_bounds_what_a_run_takes() {
    let place = Place::new();
    large(&place, 640, 480);
    let quick = tiny(5, 1).replace("{ coarse = 8, fine = 8 }", "{ coarse = 2, fine = 2 }");
    for (name, count) in [("few", 1), ("many", 20)] {
        let text = quick.replace("views.count = 3", &format!("views.count = {count}"));
        place.write("quick.toml", &text);
        place.run(&format!("{LARGE} --fov 60 --config quick.toml -q -o {name}"));
        let Some(peak) = place.record(name)["peak_memory_bytes"].as_u64() else { return };
        let estimate = refine_bytes(640 * 480, &config(Preset::Default, &text));
        assert!((peak..4 * peak).contains(&estimate), "{name}: estimate {estimate}, peak {peak}");
    }
    // Rays of a step, samples of a ray in both passes, the field.
    for [rays, samples, field] in [
        ["4096", "512", "kind = 'hash', levels = 4, features = 2"],
        ["4096", "64", "kind = 'hash', levels = 12, features = 2, log2-rows = 19"],
        ["512", "16", "kind = 'hash', levels = 16, features = 4, log2-rows = 20, finest = 2048"],
        ["512", "16", "kind = 'mlp', layers = 8, width = 512"],
    ] {
        let text = format!(
            "refinement = {{ iterations = 1, order = 'paper' }}\nviews.count = 1\nnovel.count = 1\n\
             nerf.sampling = {{ coarse = {samples}, band = 0, fine = {samples} }}\nnerf.field = {{ {field} }}\n\
             nerf.train = {{ steps = 2, rays = {rays} }}\nnerf.render = {{ coarse = 4, fine = 4 }}\n"
        );
        place.write("tiny.toml", &text);
        place.run(&format!("{REFINE} --preset fast -q --max-memory 64 --force -o near"));
        let estimate = refine_bytes((WIDTH * HEIGHT) as u64, &config(Preset::Fast, &text));
        let Some(peak) = place.record("near")["peak_memory_bytes"].as_u64() else { return };
        assert!(estimate > 120 << 20, "{field}: {estimate}");
        assert!((peak..=peak + peak / 4).contains(&estimate), "{field}: estimate {estimate}, peak {peak}");
    }
}

/// With the predictions of a network, side by side and one at a time, within a quarter of the peak when it was measured.
#[test]
#[cfg(feature = "onnx")]
#[ignore = "needs the networks and photographs that MDE_SHARED names"]
fn the_estimate_has_the_network() {
    use mde_cli::mde_prior::OnnxPrior;
    use mde_cli::refiner::{MemoryLimit, PhotographMemory};
    let network = shared().join("models/fastdepth/fastdepth_224.onnx");
    let photo = shared().join("data/plain/nyu_living/color.png");
    let (place, config, size) = (Place::new(), Preset::Default.config(), (480, 640));
    let prior = OnnxPrior::open(&network, &OnnxPrior::recognise(&network).unwrap().0).unwrap();
    for (threads, gib) in [(1, 8.0), (2, 8.0), (4, 8.0), (4, 0.17)] {
        let memory = PhotographMemory::new(&config, &prior, [size; 2], 1, threads);
        let limit = MemoryLimit { gib };
        let at_once = memory.predictions_at_once(&limit, "photo", size).unwrap();
        assert_eq!(at_once < threads, gib < 1.0, "{at_once}");
        let mut run = place.mde(&format!("refine --threads {threads} --max-memory {gib} --force -q -o out"));
        run.arg(&photo).arg("--prior-model").arg(&network).assert().success();
        let Some(peak) = place.record("out")["peak_memory_bytes"].as_f64() else { return };
        let ratio = memory.bytes(640 * 480, at_once as u64) as f64 / peak;
        assert!((0.65..1.4).contains(&ratio), "{threads} threads, {gib} GiB: {ratio:.2} of {peak}");
    }
}

/// The folder of one that is replaced stays too.
#[test]
fn an_evaluation_fails_only_where_its_scenes_are_too_large() {
    let place = Place::new();
    large(&place, 640, 480);
    for (id, image, depth) in [("a", "image.png", "depth.npy"), ("b", "large.png", "large.npy")] {
        place.write(&format!("set/{id}/scene.json"), "{}");
        place.take(image, &format!("set/{id}/color.png"));
        place.take(depth, &format!("set/{id}/depth.npy"));
        place.take(depth, &format!("priors/{id}.npy"));
    }
    let scenes = || crate::common::names(&place.path("e/scenes"));
    let eval = "eval set --prior-depth priors --methods guided --quiet -o e";
    let words = "b: ; 640x480 ; --max-memory 0.15 ; give --size";
    place.prints(&format!("{eval} --max-memory 0.15"), 3, words);
    assert_eq!(scenes(), ["a"]);
    // What is refused at once leaves what is there.
    place.refused(&format!("{eval} --size 9999x9999 --force"), "9999x9999");
    assert_eq!(scenes(), ["a"]);
    place.run(eval);
    assert_eq!(scenes(), ["a", "b"]);
}

/// The same for an evaluation.
#[test]
#[cfg(target_os = "linux")]
fn the_estimate_bounds_what_an_evaluation_takes() {
    let place = Place::new();
    let text = tiny(5, 2).replace("{ coarse = 8, fine = 8 }", "{ coarse = 2, fine = 2 }");
    place.write("quick.toml", &text);
    let (eval, ablate) = (Some(config(Preset::Default, &text)), config(Preset::Paper, &text));
    let seeds = [0, 1].map(|seed| Some(Config { seed, ..ablate.clone() }));
    let shared = [[None].as_slice(), &seeds].concat();
    for (arguments, methods, share, jobs) in [
        ("eval --methods guided,fbs --limit 1", &[None, None, None][..], false, 1),
        ("eval --methods quick.toml --limit 1", &[None, eval.clone()], false, 1),
        ("eval --methods quick.toml --limit 2 --jobs 2 --threads 2", &[None, eval], false, 2),
        ("ablate --rows full --seeds 2 --limit 1 --config quick.toml", &shared, true, 1),
    ] {
        let (mut run, _lines) =
            place.start(&format!("{arguments} --dataset rooms --size 320x240 --quiet -o out"));
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
