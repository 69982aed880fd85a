//! What the targets of the capture readers share: a folder for their files, and the checks of what they read.

use mde_mvs::capture::{Error, PosedCapture};
use mde_mvs::nalgebra::Point2;
use std::path::{Path, PathBuf};

/// Width and height of every photograph of the seeds.
pub const SIZE: [usize; 2] = [8, 6];

/// A folder of this process that has these files, in memory where the system has such a place.
pub fn folder(files: &[(&str, &[u8])]) -> PathBuf {
    let memory = PathBuf::from("/dev/shm");
    let parent = if memory.is_dir() { memory } else { std::env::temp_dir() };
    let folder = parent.join(format!("mde-fuzz-{}", std::process::id()));
    std::fs::create_dir_all(&folder).expect("the folder can be made");
    for (name, bytes) in files {
        std::fs::write(folder.join(name), bytes).expect("the file is writable");
    }
    folder
}

/// The size of every photograph; only `missing` does not exist.
pub fn size(photograph: &Path) -> Option<[usize; 2]> {
    (!photograph.ends_with("missing.png")).then_some(SIZE)
}

/// A capture that was read is usable, and an error is one line.
pub fn check(read: Result<PosedCapture, Error>) {
    let capture = match read {
        Ok(capture) => capture,
        Err(error) => {
            let text = error.to_string();
            assert!(!text.is_empty() && !text.contains(char::is_control), "{text:?}");
            return;
        }
    };
    assert!(capture.frames.len() >= 2);
    for frame in &capture.frames {
        let camera = &frame.lens.camera;
        assert!(camera.fx > 0.0 && camera.fy > 0.0 && camera.cx.is_finite() && camera.cy.is_finite());
        let (pose, back) = (frame.pose.to_homogeneous(), frame.pose.inverse().to_homogeneous());
        assert!(pose.iter().chain(back.iter()).all(|x| x.is_finite()), "{pose}");
        assert!((frame.pose.rotation.norm() - 1.0).abs() < 1e-9);
    }
    for point in &capture.points {
        assert!(point.error.is_finite() && point.position.iter().all(|x| x.is_finite()));
        assert!(point.frames.iter().all(|index| *index < capture.frames.len()));
        assert!(point.frames.windows(2).all(|pair| pair[0] < pair[1]));
    }
    // Without `Frame::view`, whose threads would take most of the time.
    let lens = &capture.frames[0].lens;
    for (y, x) in (0..SIZE[1]).flat_map(|y| (0..SIZE[0]).map(move |x| (y, x))) {
        if let Some(pixel) = lens.photograph_pixel(Point2::new(x as f64, y as f64)) {
            assert!(!pixel.x.is_nan() && !pixel.y.is_nan(), "{lens:?}");
        }
    }
}
