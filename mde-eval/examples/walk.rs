//! Photographs along a path through a procedural room, with exact poses and depth, for `mde dense FOLDER/transforms.json` and `mde score`:
//! `cargo run --release -p mde-eval --example walk -- ROOM walk|into|orbit|around|turn COUNT FOLDER`.

use mde_eval::mde_prior::format::write_png16;
use mde_eval::mde_prior::photo::write_image;
use mde_eval::mde_warp::Pose;
use mde_eval::scene::{Room, World};
use mde_uncertainty::random::CounterRng;
use nalgebra::{Isometry3, Point3, UnitQuaternion, Vector3};
use rand::RngExt;
use std::f64::consts::{PI, TAU};
use std::{error::Error, fs};

/// Right, forward and up from the room's own camera, metres: the place of a camera and its aim, at that share of a path.
fn place(path: &str, share: f64) -> Option<[[f64; 3]; 2]> {
    let (sin, cos) = (TAU * share).sin_cos();
    let side = 3.0 * share - 1.5;
    Some(match path {
        "walk" => [[side, 0.6, 0.0], [side, 4.0, -0.5]],
        "into" => [[0.0, 4.5 * share, 0.0], [0.0, 4.5 * share + 3.0, -0.4]],
        "orbit" => [[1.6 * sin, 2.9 - 1.6 * cos, 0.0], [0.0, 2.9, -0.95]],
        "around" => [[0.5 * sin, 2.0 - 0.5 * cos, 0.0], [3.0 * sin, 2.0 - 3.0 * cos, -0.5]],
        "turn" => [[0.0, 0.5, 0.0], [side, 4.0, -0.5]],
        _ => return None,
    })
}

fn main() -> Result<(), Box<dyn Error>> {
    let usage = "give ROOM walk|into|orbit|around|turn COUNT FOLDER";
    let [room, path, count, folder] = &std::env::args().skip(1).collect::<Vec<_>>()[..] else {
        return Err(usage.into());
    };
    let room = Room::ALL.into_iter().find(|one| one.to_string() == *room).ok_or(usage)?;
    let (world, count) = (World::new(room, 0)?, count.parse::<usize>()?);
    let places = (0..count).map(|index| place(path, index as f64 / count as f64));
    let places = places.collect::<Option<Vec<_>>>().ok_or(usage)?;
    let camera = world.camera(540, 360)?;
    // The room's own camera looks down by 12 degrees.
    let level = UnitQuaternion::from_axis_angle(&Vector3::x_axis(), 12_f64.to_radians());
    let turned = UnitQuaternion::from_axis_angle(&Vector3::x_axis(), PI);
    let in_room = |[right, forward, up]: [f64; 3]| level * Point3::new(right, -up, forward);
    ["images", "depth"].iter().try_for_each(|part| fs::create_dir_all(format!("{folder}/{part}")))?;
    let mut frames = Vec::new();
    for (index, [eye, mut aim]) in places.into_iter().enumerate() {
        let mut rng = CounterRng::new(0, "walk", 0, index as u64);
        aim.iter_mut().for_each(|x| *x += rng.random_range(-0.1..0.1));
        let [eye, aim] = [eye, aim].map(in_room);
        // y up and z backward, as nerfstudio has its cameras.
        let graphics: Pose = Isometry3::look_at_rh(&eye, &aim, &(level * -Vector3::y()));
        let scene = world.render(&camera, &(turned * graphics));
        let names = ["images", "depth"].map(|part| format!("{part}/{index:04}.png"));
        write_image(format!("{folder}/{}", names[0]), scene.image.view())?;
        write_png16(format!("{folder}/{}", names[1]), scene.depth.view(), 1000.0)?;
        let matrix = graphics.inverse().to_homogeneous();
        let rows: Vec<Vec<f64>> = matrix.row_iter().map(|row| row.iter().copied().collect()).collect();
        frames.push(serde_json::json!({ "file_path": names[0], "depth_file_path": names[1], "transform_matrix": rows }));
    }
    let (cx, cy) = (camera.cx + 0.5, camera.cy + 0.5);
    let capture = serde_json::json!({ "fl_x": camera.fx, "fl_y": camera.fy, "cx": cx, "cy": cy, "w": 540, "h": 360, "frames": frames });
    fs::write(format!("{folder}/transforms.json"), capture.to_string())?;
    Ok(())
}
