use super::files::find_scenes;
use super::pairs::{
    Pair, Sensor, Sequences, in_one_folder, pairs_in_one_folder, pairs_side_by_side, side_by_side,
};
use crate::{Error, Result};
use mde_warp::PinholeCamera;
use std::path::Path;

impl Sequences {
    /// NYU Depth v2 (Silberman et al., ECCV 2012) as files at or below a folder: pairs of an image and a PNG in millimetres, 0 =
    /// missing.
    ///
    /// Two layouts are found: `rgb/00001.png` beside `depth/00001.png` (any file names whose first numbers agree), and
    /// `rgb_00045.jpg` with `sync_depth_00045.png` in one folder, as the training sets of BTS and its successors have it. The
    /// published `nyu_depth_v2_labeled.mat` must be exported first. Depth is trusted up to 10 m; the camera is the published one of
    /// the colour sensor, scaled to the images' size.
    ///
    /// # Errors
    /// [`Error::Io`] for a folder that cannot be read, [`Error::Layout`] where there is no pair.
    pub fn nyu(root: impl AsRef<Path>) -> Result<Self> {
        let root = root.as_ref();
        if root.extension().is_some_and(|e| e == "mat") {
            let reason =
                "is MATLAB's format, which is not read; export it as rgb/N.png and depth/N.png (16 bit, mm)"
                    .into();
            return Err(Error::Layout { path: root.to_owned(), reason });
        }
        let mut pairs = Vec::new();
        for folder in find_scenes(root, |folder| side_by_side(folder) || in_one_folder(folder))? {
            let side = side_by_side(&folder);
            pairs.extend(if side { pairs_side_by_side(&folder)? } else { pairs_in_one_folder(&folder)? });
        }
        // The labelled images are of many places; the files of a recording lie in one folder.
        let recorded = |pair: &Pair| pair.image.parent() == Some(&pair.sequence);
        let sensor = Sensor { units_per_metre: 1000.0, trusted_depth: 10.0, camera };
        let what = "rgb/N.png beside depth/N.png and no rgb_N.jpg with sync_depth_N.png";
        Self::new(root, pairs, sensor, recorded, what)
    }
}

fn camera(pair: &Pair, [width, height]: [usize; 2], _: Option<f64>) -> Result<(PinholeCamera, bool)> {
    if width * 480 != height * 640 {
        let reason = format!(
            "is {width}x{height}, but the published camera is that of 640x480; use a plain folder with a scene.json"
        );
        return Err(Error::Layout { path: pair.image.clone(), reason });
    }
    // The published principal point counts pixels from 1.
    let published =
        PinholeCamera::new(518.857_901, 519.469_611, 325.582_449 - 1.0, 253.736_166 - 1.0, 640, 480)?;
    Ok((published.resized(width, height)?, false))
}
