//! Several photographs through the program.

use crate::common::{Place, SIZE, STUDY, finished, names, on_disk, ratios, rendered, wait_until};
use mde_cli::Preset;
use mde_cli::mde_mvs::capture::{CaptureFiles, Frame, PixelCentres, read_transforms};
use mde_cli::mde_prior::format::{ReadOptions, read_values};
use mde_cli::mde_prior::photo::image_size;
use mde_cli::ndarray::{Array2, Array3};
use mde_cli::refiner::scene_bytes;
use mde_eval::capture::Capture as Rendered;
use mde_eval::scene::Room;
use mde_uncertainty::statistics::median;
use std::fs;
use std::path::Path;
use std::sync::LazyLock;

/// Enough where the poses are given.
const SMALL: [usize; 2] = [96, 72];

// At this size matches are few; this room has enough.
static KITCHEN: LazyLock<Rendered> = LazyLock::new(|| rendered(Room::Kitchen, 3, SIZE));

const REFINE: &str = "refine images/0.png --prior-depth prior.npy --config quick.toml -q";

/// The depth is that of the parallax, in the unit of the poses, as good as with a prior; one photograph alone needs a network.
#[test]
fn several_photographs_need_no_network() {
    let place = on_disk(&STUDY);
    place.run("refine images/0.png --views transforms.json --no-nerf -q -o parallax");
    let record = place.record("parallax");
    assert!(record["unit"] == "capture" && record["prior"]["source"] == "none", "{record}");
    let depth = place.map("parallax/depth.npy");
    let error = median(ratios(depth.view(), &STUDY.truth).map(|ratio| (ratio - 1.0).abs())).unwrap();
    assert!(error < 0.05, "{error}");
    place.run("dense transforms.json --no-nerf --export mesh -q -o all");
    assert!(place.has("all/3/depth.npy") && place.has("all/cloud.ply"));
    // Scored against the true depths that the capture's file names: here that of the first photograph.
    let mut capture = place.json("transforms.json");
    capture["frames"][0]["depth_file_path"] = "truth.npy".into();
    place.save("truth.npy", &STUDY.truth);
    place.write("truth.json", capture.to_string());
    place.prints(
        "score all --gt truth.json -o scores",
        0,
        "3.png: no truth ; photographs used ; cloud.ply within",
    );
    let summary = place.json("scores/summary.json");
    let of_cloud = |i: usize, key: &str| summary["made_from"]["cloud"][i][key].as_f64().unwrap();
    assert!(of_cloud(2, "accuracy") > 0.8 && of_cloud(2, "completeness") > 0.8, "{}", summary["made_from"]);
    assert!(of_cloud(0, "f") < of_cloud(1, "f") && of_cloud(1, "f") < of_cloud(2, "f"));
    place.refused("score all --gt truth.json --sigma all -o none", "--sigma");
    let page = place.text("all/index.html");
    assert!(page.contains("id=\"capture\"") && page.contains("\"folder\":\"3\""), "no view of the capture");
    assert!(page.contains("\"triangles\":"), "no surface of the capture");
    // Without the cloud there is no view, and no error.
    fs::remove_file(place.path("all/cloud.ply")).unwrap();
    place.run("report all");
    assert!(!place.text("all/index.html").contains("id=\"capture\""));
    let surface = "dense transforms.json --no-nerf --export mesh --max-memory 0.15 -q -o none";
    place.refused(surface, "4 photographs: ; --max-memory 0.15");
    // What can't be read is named, and the others are used, not so the reference; the first photograph is one like the others.
    place.write("images/0.png", "torn");
    place.refused("refine images/0.png --views transforms.json -q -o out", "0.png");
    let left_out = "0.png: no readable photograph; left out";
    place.prints("refine images/1.png --views transforms.json --no-nerf -o torn", 0, left_out);
    assert!(place.record("torn")["capture"]["fallback"].is_null());
    place.prints("dense transforms.json --no-nerf -o rest", 3, left_out);
    assert!(place.has("rest/1/depth.npy") && place.has("rest/cloud.ply"));
}

/// With noise, which no compression makes small; enlarged, as rooms take seconds to render at such a size.
#[test]
fn the_report_of_several_large_photographs_is_below_five_megabytes() {
    let mut room = rendered(Room::Study, 3, [160, 120]);
    for (index, known) in room.views.iter_mut().enumerate() {
        let mut state = index as u32 + 1;
        let small = &known.view.image;
        known.view.image = Array3::from_shape_fn((480, 640, 3), |(y, x, c)| {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            small[(y / 4, x / 4, c)] + 0.04 * ((state >> 8) as f32 / (1 << 24) as f32 - 0.5)
        })
        .into_shared();
        known.view.camera = known.view.camera.resized(640, 480).unwrap();
        let prior = known.prior.as_mut().unwrap();
        prior.map = Array2::from_shape_fn((480, 640), |(y, x)| prior.map[(y / 4, x / 4)]);
        prior.valid = Array2::from_elem((480, 640), true);
    }
    let place = on_disk(&room);
    let quick = "train = { steps = 5, rays = 128 }, render = { coarse = 4, fine = 4 }, field.finest = 64";
    place.write("quick.toml", format!("nerf = {{ {quick} }}"));
    place.run(&format!("{REFINE} --views transforms.json -o out"));
    assert!(place.record("out")["capture"]["fallback"].is_null());
    let bytes = place.bytes("out/report.html").len();
    assert!((2_000_000..5_000_000).contains(&bytes), "{bytes}");
}

#[test]
fn photographs_can_be_limited_and_the_unit_be_named() {
    let place = on_disk(&STUDY);
    let views = format!("{REFINE} --views transforms.json --max-views 2 --export sigma");
    place.run(&format!("{views} --unit capture -o capture"));
    let record = place.record("capture");
    // The factor to the prior counts in the prior's unit only.
    place.run(&format!("{views} -o metres"));
    assert!(place.has("capture/sigma/ambiguity.npy") && !place.has("capture/sigma/gauge.npy"));
    assert!(place.has("metres/sigma/gauge.npy"));
    let capture = &record["capture"];
    let photographs = capture["photographs"].as_array().unwrap();
    assert_eq!((photographs.len(), photographs.iter().filter(|one| one["used"] == true).count()), (4, 2));
    assert!(record["unit"] == "capture" && record["preset"] == "multi-view", "{record}");
    assert!(capture["poses"] != "estimated" && capture["fallback"].is_null(), "{capture}");
    assert!(place.has("capture/report.html") && place.has("capture/sigma.npy"));
    if let Some(peak) = record["peak_memory_bytes"].as_u64() {
        let config = Preset::MultiView.config().with_text(&place.text("quick.toml"), "quick").unwrap();
        let estimate = scene_bytes((SIZE[0] * SIZE[1]) as u64, 4, 4, 2, &config);
        assert!((peak..4 * peak).contains(&estimate), "estimate {estimate}, peak {peak}");
    }
    let ratio = median(ratios(place.map("capture/depth.npy").view(), &STUDY.truth)).unwrap();
    assert!(ratio.ln().abs() < 0.15, "{ratio}");
}

/// What `mde poses` writes is a capture that `mde refine` reads, with the poses and the focal length that it found.
#[test]
fn poses_are_written_and_read_again() {
    let place = on_disk(&KITCHEN);
    place.photograph("black.png", Array3::zeros((SIZE[1], SIZE[0], 3)).view());
    fs::create_dir(place.path("found")).unwrap();
    let fov = 2.0 * (0.5 * SIZE[0] as f64 / KITCHEN.views[0].view.camera.fx).atan().to_degrees();
    place.run(&format!("{REFINE} --views images --fov {fov} --export colmap -o estimated"));
    let estimated = place.record("estimated")["capture"].clone();
    assert!(estimated["poses"] == "estimated" && estimated["fallback"].is_null(), "{estimated}");
    let size = |path: &Path| image_size(path);
    let model = CaptureFiles::find(&place.path("estimated/colmap")).unwrap().read(None, &size).unwrap();
    let used = estimated["photographs"].as_array().unwrap().iter().filter(|one| one["used"] == true).count();
    assert!(used > 1 && model.frames.len() == used);
    for frame in model.frames.iter().filter(|frame| !frame.photograph.ends_with("image.png")) {
        assert!(frame.pose.translation.vector.norm() > 0.0, "{frame:?}");
    }
    let assumed = "refine images/0.png --views images --prior-depth prior.npy --no-nerf -o assumed";
    place.prints(assumed, 0, "px +- ; % ( ; estimated with the poses");
    // Left out before those that follow, whose names stay theirs.
    fs::copy(place.path("images/0.png"), place.path("images/0-copy.png")).unwrap();
    place.write("images/0-torn.png", "torn");
    let poses = "poses images/0.png images black.png --prior-depth prior.npy -o found/found.json";
    let camera = format!("camera: focal length {:.0} px (", KITCHEN.views[0].view.camera.fx);
    place.prints(
        &format!("{poses} --fov {fov}"),
        0,
        &format!("{camera} ; given, taken as exact ; 1 can't be read"),
    );
    let file = place.path("found/found.json");
    let found = read_transforms(&file, PixelCentres::Integers, &size).unwrap();
    // A file of nerfstudio: pixel centres at halves, without the key.
    place.write("found/transforms.json", place.text("found/found.json").replace("pixel_centres", "some_key"));
    let read = CaptureFiles::find(&place.path("found/transforms.json")).unwrap().read(None, &size).unwrap();
    assert_eq!(read.frames[0].lens.camera, found.frames[0].lens.camera);
    // The black photograph fits nowhere; at this size another may not.
    let index =
        |frame: &Frame| frame.photograph.file_stem().unwrap().to_str().unwrap().parse::<usize>().unwrap();
    assert!((2..=3).contains(&found.frames.len()) && index(&found.frames[0]) == 0);
    let frame = KITCHEN.views[0].view.pose.inverse();
    for frame_found in &found.frames {
        let known = &KITCHEN.views[index(frame_found)];
        let turned = (known.view.pose * frame).rotation.angle_to(&frame_found.pose.rotation).to_degrees();
        assert!(turned < 3.0, "{turned}");
        assert!((frame_found.lens.camera.fx / known.view.camera.fx - 1.0).abs() < 1e-9);
    }
    place.run(&format!("{REFINE} --views found/found.json -o refined"));
    let capture = place.record("refined")["capture"].clone();
    assert!(capture["poses"] != "estimated" && capture["fallback"].is_null(), "{capture}");
}

const DENSE: &str = "dense transforms.json --prior-model grey.onnx --model-profile fastdepth \
                   --prior-kind metric --config quick.toml";

/// What is written fits together. Killed after its first photograph, the same command takes that one and writes what an unbroken run does.
#[test]
#[cfg(feature = "onnx")]
fn every_photograph_gets_a_folder_and_all_a_cloud() {
    let room = rendered(Room::Study, 3, SMALL);
    let place = on_disk(&room);
    let all = format!("{DENSE} --unit capture --interval 0.8");
    let (mut child, _lines) = place.start(&format!("{all} -q -o out"));
    wait_until(&mut child, || place.has("out/0/finished.json"));
    child.kill().unwrap();
    assert!(!child.wait().unwrap().success() && !place.has("out/run.json"));
    let words = "lower.npy and upper.npy in each folder: 80 % interval ; 0.png: finished before";
    assert!(finished(&place.prints(&format!("{all} -o out"), 0, words)) <= 2);
    place.run(&format!("{all} -q -o unbroken"));
    let unbroken = place.maps("unbroken");
    assert!(place.maps("out") == unbroken);
    assert_eq!(place.text("out/transforms.json"), place.text("unbroken/transforms.json"));
    assert!(!names(&place.path("out")).iter().any(|name| name.starts_with(".mde-")));

    let record = place.record("out");
    let rows = record["photographs"].as_array().unwrap();
    assert_eq!(rows.len(), 3);
    let size = |path: &Path| image_size(path);
    let transforms =
        read_transforms(&place.path("out/transforms.json"), PixelCentres::Integers, &size).unwrap();
    let whole = place.json("out/transforms.json");
    let page = place.text("out/index.html");
    for (index, name) in ["0", "1", "2"].iter().enumerate() {
        assert_eq!(rows[index]["folder"], *name);
        for file in ["depth.npy", "sigma.npy", "run.json", "report.html", "image.png"] {
            assert!(place.has(&format!("out/{name}/{file}")), "{name}/{file}");
        }
        let frame = &whole["frames"][index];
        assert_eq!(frame["depth_file_path"], format!("{name}/depth.png"));
        assert!(place.has(&format!("out/{}", frame["sigma_file_path"].as_str().unwrap())));
        // In the world of the capture, in its unit; the reference's pose is as given.
        let known = &room.views[index].view.pose;
        let apart = (transforms.frames[index].pose * known.inverse()).translation.vector.norm();
        assert!(apart < if index == 0 { 1e-9 } else { 0.02 }, "{apart}");
        assert!(page.contains(&format!("href=\"{name}/report.html\"")));
    }
    assert!(record["points"].as_u64().unwrap() > (SMALL[0] * SMALL[1] / 10) as u64, "{}", record["points"]);

    // The same command has nothing left to do.
    let kept = |more: &str| finished(&place.run(&format!("{all} {more} -o out")));
    assert_eq!([kept(""), kept("--predictions 2"), kept("--predictions 2 --force"), kept("")], [3, 0, 0, 0]);
    assert!(place.maps("out") == unbroken);
}

/// The demo of several photographs: better than its prior, and refined again from its files.
#[test]
fn the_demo_has_photographs_without_poses() {
    let place = Place::new();
    place.write("quick.toml", "nerf.train = { steps = 250, rays = 256 }\nnerf.field.finest = 128\n");
    place.prints("demo --size 240x180 --config quick.toml -o demo", 0, "AbsRel ; 90 % intervals hold");
    let told = place.record("demo");
    let capture = &told["capture"];
    assert!(capture["poses"] == "estimated" && capture["fallback"].is_null(), "{capture}");
    let used: Vec<bool> =
        capture["photographs"].as_array().unwrap().iter().map(|one| one["used"].as_bool().unwrap()).collect();
    assert_eq!((used.len(), used.iter().filter(|used| **used).count()), (6, 5), "{capture}");
    let novel = &capture["novel"];
    assert!(novel["withheld"] == true && !used[novel["photograph"].as_u64().unwrap() as usize], "{novel}");
    assert!(["psnr", "psnr_of_prior"].iter().all(|key| novel[*key].as_f64().unwrap() > 16.0), "{novel}");
    let scores = &told["scores"]["by_alignment"]["median-ratio"];
    let abs_rel = |which: &str| scores[which]["abs_rel"].as_f64().unwrap();
    assert!(abs_rel("refined") < 0.6 * abs_rel("prior"), "{} {}", abs_rel("refined"), abs_rel("prior"));

    let map = |name: &str| {
        let options = ReadOptions { npz_array: Some(name.to_owned()), ..ReadOptions::default() };
        read_values(place.path("demo/evidence.npz"), &options).unwrap()
    };
    let (seen, confirmed) = (map("seen"), map("confirmed"));
    assert!(seen.iter().zip(&confirmed).all(|(seen, confirmed)| confirmed <= seen && *seen <= 4.0));
    let known = map("origin").iter().filter(|origin| **origin > 0.0).count();
    let share = confirmed.iter().filter(|count| **count > 0.0).count() as f64 / known as f64;
    assert!((share - capture["confirmed"].as_f64().unwrap()).abs() < 1e-9 && share > 0.5, "{share}");

    let again = "--views demo/photographs --prior-depth demo/prior.npy --fov 65 --config quick.toml -q";
    place.run(&format!("refine demo/photographs/0.png {again} -o from-files"));
    let found = place.record("from-files")["capture"].clone();
    assert!(found["fallback"].is_null() && found["photographs"].as_array().unwrap().len() == 6, "{found}");
    // Fewer than the most that may be used: none is left out.
    assert_eq!(found["novel"]["withheld"], false);
}
