use std::path::Path;
use std::str::SplitWhitespace;

use super::{
    Frame, Lens, MAX_FRAMES, PosedCapture, Result, check_photograph, content, pose, quaternion, read_text,
};

/// Seconds between a photograph and its pose, at most, as in the benchmark's own tools.
const MAX_GAP: f64 = 0.02;

/// Reads a trajectory of the TUM RGB-D benchmark: `rgb.txt` (time, photograph) beside `groundtruth.txt` (time, camera
/// centre x y z, camera-to-world rotation x y z w), all photographs by one lens, which the format does not have.
///
/// A photograph takes the pose nearest in time; one without a pose within 20 ms is left out. `size` returns the width and
/// height of a photograph, or `None` if it is missing.
///
/// # Errors
/// One line that names the file and the line: what is missing, not finite, of another size, a rotation that is none,
/// fewer than two photographs with poses, or all of them taken from one place.
pub fn read_tum(
    folder: &Path,
    lens: &Lens,
    size: &dyn Fn(&Path) -> Option<[usize; 2]>,
) -> Result<PosedCapture> {
    let (rgb, poses) = (folder.join("rgb.txt"), folder.join("groundtruth.txt"));
    parse(&rgb, &read_text(&rgb)?, &poses, &read_text(&poses)?, lens, size)
}

/// The time and the file of a line.
pub(super) fn stamped<'t>(path: &Path, (line, text): (usize, &'t str)) -> Result<(f64, &'t str)> {
    let (time, name) = text.split_once(char::is_whitespace).unwrap_or((text, ""));
    let time = number(path, line, Some(time), "time")?;
    match name.trim() {
        "" => Err(content(path, format!("line {line}"), "the file's name is missing")),
        name => Ok((time, name)),
    }
}

/// Lines that are no comment, with their numbers from 1.
pub(super) fn lines(text: &str) -> impl Iterator<Item = (usize, &str)> {
    let numbered = text.lines().enumerate().map(|(i, line)| (i + 1, line.trim()));
    numbered.filter(|(_, line)| !line.is_empty() && !line.starts_with('#'))
}

pub(super) fn number(path: &Path, line: usize, word: Option<&str>, what: &str) -> Result<f64> {
    let place = || format!("line {line}");
    let word = word.ok_or_else(|| content(path, place(), format!("{what} is missing")))?;
    let value = word.parse::<f64>().ok().filter(|x| x.is_finite());
    value.ok_or_else(|| content(path, place(), format!("{what} is {word}; a finite number is needed")))
}

/// The next words as numbers, by their names.
pub(super) fn numbers<const N: usize>(
    path: &Path,
    line: usize,
    words: &mut SplitWhitespace<'_>,
    names: [&str; N],
) -> Result<[f64; N]> {
    let mut values = [0.0; N];
    for (value, what) in values.iter_mut().zip(names) {
        *value = number(path, line, words.next(), what)?;
    }
    Ok(values)
}

pub(super) fn parse(
    rgb: &Path,
    rgb_text: &str,
    truth: &Path,
    truth_text: &str,
    lens: &Lens,
    size: &dyn Fn(&Path) -> Option<[usize; 2]>,
) -> Result<PosedCapture> {
    lens.check().map_err(|problem| content(rgb, "intrinsics", problem))?;
    let mut poses = Vec::new();
    for (line, text) in lines(truth_text) {
        let mut words = text.split_whitespace();
        let names = ["time", "tx", "ty", "tz", "qx", "qy", "qz", "qw"];
        poses.push(numbers(truth, line, &mut words, names)?);
    }
    poses.sort_by(|a, b| a[0].total_cmp(&b[0]));
    let folder = rgb.parent().unwrap_or(Path::new(""));
    let mut capture = PosedCapture::default();
    for (line, text) in lines(rgb_text) {
        let (time, name) = stamped(rgb, (line, text))?;
        let after = poses.partition_point(|p| p[0] < time);
        let near = [after.checked_sub(1), Some(after)].into_iter().flatten().filter_map(|i| poses.get(i));
        let nearest = near.min_by(|a, b| (a[0] - time).abs().total_cmp(&(b[0] - time).abs()));
        let Some(row) = nearest.filter(|p| (p[0] - time).abs() <= MAX_GAP) else { continue };
        let photograph = folder.join(name);
        let Some(found) = size(&photograph) else {
            capture.unreadable.push(photograph);
            continue;
        };
        check_photograph(rgb, &photograph, lens, found)?;
        let rotation = quaternion([row[7], row[4], row[5], row[6]]);
        let pose = pose(truth, name, rotation, [row[1], row[2], row[3]])?.inverse();
        capture.frames.push(Frame { photograph, lens: *lens, pose });
        if capture.frames.len() > MAX_FRAMES {
            return Err(content(rgb, format!("line {line}"), format!("more than {MAX_FRAMES} photographs")));
        }
    }
    capture.checked(rgb)
}
