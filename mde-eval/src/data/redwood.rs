use super::assumed;
use super::files::{find_scenes, read_json};
use super::pairs::{Pair, Sensor, Sequences, pairs_side_by_side, side_by_side};
use crate::Result;
use mde_warp::PinholeCamera;
use serde::Deserialize;
use std::path::Path;

/// Names of Open3D's camera file.
const FILES: [&str; 3] = ["camera_intrinsic.json", "intrinsic.json", "camera_primesense.json"];

/// Open3D's camera file.
#[derive(Deserialize)]
struct Intrinsic {
    width: usize,
    height: usize,
    /// Column by column.
    intrinsic_matrix: [f64; 9],
}

impl Sequences {
    /// Redwood's RGB-D scans (Choi et al., 2016) and others in Open3D's layout, at or below a folder: `color/`, `rgb/` or `image/`
    /// beside `depth/` (PNG in millimetres, 0 = missing), paired by the first number in the files' names.
    ///
    /// The camera is read from `camera_intrinsic.json`, `intrinsic.json` or `camera_primesense.json` beside those folders (Open3D's
    /// `PinholeCameraIntrinsic`: pixel centres at integers from 0); without such a file it is Open3D's PrimeSense default for
    /// 640 x 480, and has the assumed field of view for other sizes. Depth is trusted up to 4 m, where a PrimeSense sensor's step is about 4 cm.
    ///
    /// # Errors
    /// [`Error::Io`](crate::Error::Io) for a folder that cannot be read, [`Error::Layout`](crate::Error::Layout) where there is no pair.
    pub fn redwood(root: impl AsRef<Path>) -> Result<Self> {
        let root = root.as_ref();
        let mut pairs = Vec::new();
        for folder in find_scenes(root, side_by_side)? {
            pairs.extend(pairs_side_by_side(&folder)?);
        }
        let sensor = Sensor { units_per_metre: 1000.0, trusted_depth: 4.0, camera };
        let what = "color/ (rgb/, image/) beside depth/ with files of the same numbers";
        Self::new(root, pairs, sensor, |_| true, what)
    }
}

fn camera(pair: &Pair, [width, height]: [usize; 2], fov: Option<f64>) -> Result<(PinholeCamera, bool)> {
    match FILES.iter().map(|name| pair.sequence.join(name)).find(|path| path.is_file()) {
        Some(path) => Ok((read(&path)?.resized(width, height)?, false)),
        None if [width, height] == [640, 480] => {
            Ok((PinholeCamera::new(525.0, 525.0, 319.5, 239.5, 640, 480)?, false))
        }
        None => {
            let scene = pair.sequence.display().to_string();
            Ok((assumed(fov, &scene, FILES[0], width, height)?, true))
        }
    }
}

fn read(path: &Path) -> Result<PinholeCamera> {
    let intrinsic: Intrinsic = read_json(path)?;
    let Intrinsic { width, height, intrinsic_matrix: [fx, _, _, _, fy, _, cx, cy, _] } = intrinsic;
    Ok(PinholeCamera::new(fx, fy, cx, cy, width, height)?)
}
