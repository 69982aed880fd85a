use super::files::find_scenes;
use super::pairs::{Pair, Paired};
use super::{DataSet, Fallback, Sample};
use crate::{Error, Result};
use mde_warp::PinholeCamera;
use std::fs;
use std::path::{Path, PathBuf};

/// TUM RGB-D (Sturm et al., IROS 2012): folders with `rgb.txt` and `depth.txt`, lines of a time stamp and a file.
///
/// An image belongs to the depth map nearest in time within 20 ms, each used once, nearest first, as the published
/// `associate.py` has it. Depth PNGs hold 5000 units a metre, 0 = missing, and are trusted up to 5 m (a Kinect). The
/// camera is the published one of `freiburg1`, `freiburg2` or `freiburg3` where the folder's name contains it, else
/// a [`Fallback`].
#[derive(Debug, Clone)]
pub struct Tum {
    paired: Paired,
    fallback: Fallback,
}

impl Tum {
    /// Largest difference of the time stamps of a pair, seconds.
    const TOLERANCE: f64 = 0.02;

    /// Finds the sequences at or below a folder.
    ///
    /// # Errors
    /// [`Error::Io`] for files that cannot be read, [`Error::Layout`] for lists that are broken and where there is no pair.
    pub fn open(root: impl AsRef<Path>) -> Result<Self> {
        let root = root.as_ref();
        let is_sequence =
            |folder: &Path| folder.join("rgb.txt").is_file() && folder.join("depth.txt").is_file();
        let mut pairs = Vec::new();
        for folder in find_scenes(root, is_sequence)? {
            let (images, depths) = (list(&folder, "rgb.txt")?, list(&folder, "depth.txt")?);
            let pair = |(image, depth): (usize, usize)| Pair {
                image: images[image].1.clone(),
                depth: depths[depth].1.clone(),
                sequence: folder.clone(),
            };
            pairs.extend(associate(&images, &depths).into_iter().map(pair));
        }
        if pairs.is_empty() {
            let reason =
                "holds no folder with rgb.txt and depth.txt whose time stamps agree within 20 ms".into();
            return Err(Error::Layout { path: root.to_owned(), reason });
        }
        Ok(Self { paired: Paired::new(root, pairs, |_| true), fallback: Fallback::Refuse })
    }

    /// Only every `stride`-th image: neighbours in a video show the same.
    #[must_use]
    pub fn with_stride(mut self, stride: usize) -> Self {
        self.paired.step(stride);
        self
    }

    /// With a camera for sequences of unknown sensors.
    #[must_use]
    pub fn with_fallback(mut self, fallback: Fallback) -> Self {
        self.fallback = fallback;
        self
    }

    fn camera(&self, pair: &Pair, [width, height]: [usize; 2]) -> Result<(PinholeCamera, bool)> {
        let path = pair.sequence.to_string_lossy();
        let known = [
            (["freiburg1", "fr1"], [517.3, 516.5, 318.6, 255.3]),
            (["freiburg2", "fr2"], [520.9, 521.0, 325.1, 249.7]),
            (["freiburg3", "fr3"], [535.4, 539.2, 320.1, 247.6]),
        ];
        let of_path = known.iter().find(|(names, _)| names.iter().any(|name| path.contains(name)));
        match of_path {
            Some((_, [fx, fy, cx, cy])) => {
                Ok((PinholeCamera::new(*fx, *fy, *cx, *cy, 640, 480)?.resized(width, height)?, false))
            }
            None => Ok((self.fallback.camera(&path, "freiburg1, 2 or 3 in its name", width, height)?, true)),
        }
    }
}

/// Time stamps with the files that they name.
type Stamped = Vec<(f64, PathBuf)>;

fn list(folder: &Path, name: &str) -> Result<Stamped> {
    let path = folder.join(name);
    let text = fs::read_to_string(&path).map_err(|source| Error::Io { path: path.clone(), source })?;
    let mut stamped = Vec::new();
    for (number, line) in text.lines().enumerate() {
        let line = line.trim();
        if line.is_empty() || line.starts_with('#') {
            continue;
        }
        let parsed = line.split_once(char::is_whitespace).and_then(|(time, file)| {
            let time: f64 = time.parse().ok()?;
            time.is_finite().then(|| (time, folder.join(file.trim())))
        });
        let reason = || format!("line {} is no time stamp and file: {line}", number + 1);
        stamped.push(parsed.ok_or_else(|| Error::Layout { path: path.clone(), reason: reason() })?);
    }
    Ok(stamped)
}

/// Indices of images and depth maps that belong together, in the images' order.
fn associate(images: &Stamped, depths: &Stamped) -> Vec<(usize, usize)> {
    let mut in_time: Vec<usize> = (0..depths.len()).collect();
    in_time.sort_by(|&a, &b| depths[a].0.total_cmp(&depths[b].0));
    let mut near = Vec::new();
    for (image, (time, _)) in images.iter().enumerate() {
        let from = in_time.partition_point(|&d| depths[d].0 < time - Tum::TOLERANCE);
        let within = in_time[from..].iter().take_while(|&&d| depths[d].0 <= time + Tum::TOLERANCE);
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

impl DataSet for Tum {
    fn ids(&self) -> &[String] {
        &self.paired.ids
    }

    fn place(&self, index: usize) -> Option<&str> {
        self.paired.place(index)
    }

    fn load(&self, index: usize) -> Result<Sample> {
        self.paired.load(index, 5000.0, 5.0, |pair, size| self.camera(pair, size))
    }
}
