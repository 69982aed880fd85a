use super::assumed;
use super::files::find_scenes;
use super::pairs::{Pair, Sensor, Sequences};
use crate::Result;
use mde_mvs::capture::read_tum_list;
use mde_warp::PinholeCamera;
use std::path::{Path, PathBuf};

/// Largest difference of the time stamps of a pair, seconds.
const TOLERANCE: f64 = 0.02;

/// Time stamps with the files that they name.
type Stamped = Vec<(f64, PathBuf)>;

impl Sequences {
    /// TUM RGB-D (Sturm et al., IROS 2012): folders at or below one with `rgb.txt` and `depth.txt`, lines of a time stamp and a file.
    ///
    /// An image belongs to the depth map nearest in time within 20 ms, each used once, nearest first, as the published
    /// `associate.py` has it. Depth PNGs hold 5000 units a metre, 0 = missing, and are trusted up to 5 m (a Kinect). The
    /// camera is the published one of `freiburg1`, `freiburg2` or `freiburg3` where the folder's name contains it, else
    /// has the assumed field of view.
    ///
    /// # Errors
    /// [`Error::Io`](crate::Error::Io) for a folder that cannot be read, [`Error::Capture`](crate::Error::Capture) for lists that are broken,
    /// [`Error::Layout`](crate::Error::Layout) where there is no pair.
    pub fn tum(root: impl AsRef<Path>) -> Result<Self> {
        let root = root.as_ref();
        let mut pairs = Vec::new();
        for folder in find_scenes(root, is_sequence)? {
            let images = read_tum_list(&folder.join("rgb.txt"))?;
            let depths = read_tum_list(&folder.join("depth.txt"))?;
            let pair = |(image, depth): (usize, usize)| Pair {
                image: images[image].1.clone(),
                depth: depths[depth].1.clone(),
                sequence: folder.clone(),
            };
            pairs.extend(associate(&images, &depths).into_iter().map(pair));
        }
        let sensor = Sensor { units_per_metre: 5000.0, trusted_depth: 5.0, camera };
        let what = "folder with rgb.txt and depth.txt whose time stamps agree within 20 ms";
        Self::new(root, pairs, sensor, |_| true, what)
    }
}

pub(super) fn is_sequence(folder: &Path) -> bool {
    folder.join("rgb.txt").is_file() && folder.join("depth.txt").is_file()
}

fn camera(pair: &Pair, [width, height]: [usize; 2], fov: Option<f64>) -> Result<(PinholeCamera, bool)> {
    let path = pair.sequence.to_string_lossy();
    let known = [
        (["freiburg1", "fr1"], [517.3, 516.5, 318.6, 255.3]),
        (["freiburg2", "fr2"], [520.9, 521.0, 325.1, 249.7]),
        (["freiburg3", "fr3"], [535.4, 539.2, 320.1, 247.6]),
    ];
    match known.iter().find(|(names, _)| names.iter().any(|name| path.contains(name))) {
        Some((_, [fx, fy, cx, cy])) => {
            Ok((PinholeCamera::new(*fx, *fy, *cx, *cy, 640, 480)?.resized(width, height)?, false))
        }
        None => Ok((assumed(fov, &path, "freiburg1, 2 or 3 in its name", width, height)?, true)),
    }
}

/// Indices of images and depth maps that belong together, in the images' order.
fn associate(images: &Stamped, depths: &Stamped) -> Vec<(usize, usize)> {
    let mut in_time: Vec<usize> = (0..depths.len()).collect();
    in_time.sort_by(|&a, &b| depths[a].0.total_cmp(&depths[b].0));
    let mut near = Vec::new();
    for (image, (time, _)) in images.iter().enumerate() {
        let from = in_time.partition_point(|&d| depths[d].0 < time - TOLERANCE);
        let within = in_time[from..].iter().take_while(|&&d| depths[d].0 <= time + TOLERANCE);
        near.extend(within.map(|&depth| ((depths[depth].0 - time).abs(), image, depth)));
    }
    near.sort_by(|a, b| a.0.total_cmp(&b.0).then((a.1, a.2).cmp(&(b.1, b.2))));
    let (mut image_used, mut depth_used) = (vec![false; images.len()], vec![false; depths.len()]);
    let mut pairs = Vec::new();
    for (_, image, depth) in near {
        if !image_used[image] && !depth_used[depth] {
            (image_used[image], depth_used[depth]) = (true, true);
            pairs.push((image, depth));
        }
    }
    pairs.sort_unstable();
    pairs
}
