//! Working size and memory limit.

use crate::args::{MemoryArgs, SizeArgs};
use anyhow::{Result, bail};
use mde_cli::memory::{SceneMemory, most_pixels};
use mde_prior::resample::{Filter, resize};
use ndarray::{Array3, Axis};

/// Least width and height of an image, pixels.
pub(crate) const SMALLEST: usize = 8;

/// `(height, width)` with the longer side at most `longest`, the aspect kept.
pub(crate) fn within((height, width): (usize, usize), longest: Option<u32>) -> (usize, usize) {
    let longest = longest.map_or(usize::MAX, |n| n as usize);
    let longer = height.max(width);
    if longer <= longest {
        return (height, width);
    }
    let scaled = |side: usize| ((2 * side * longest + longer) / (2 * longer)).max(1);
    (scaled(height), scaled(width))
}

/// `(height, width)` with at most `--work-size` pixels, the aspect kept.
pub(crate) fn working((height, width): (usize, usize), args: &SizeArgs) -> (usize, usize) {
    let most = 1e6 * args.work_size;
    let pixels = (height * width) as f64;
    if pixels <= most {
        return (height, width);
    }
    let side = |side: usize| ((side as f64 * (most / pixels).sqrt()).round() as usize).max(1);
    (side(height), side(width))
}

/// The image at that size.
pub(crate) fn shrink(image: &Array3<f32>, (height, width): (usize, usize)) -> Array3<f32> {
    let mut small = Array3::zeros((height, width, 3));
    for (mut to, from) in small.axis_iter_mut(Axis(2)).zip(image.axis_iter(Axis(2))) {
        to.assign(&resize(from, (height, width), Filter::BilinearAntialias));
    }
    small
}

/// Refuses a run above the memory limit; `what` names its image, `bytes` estimates its memory by the number of pixels.
pub(crate) fn check_memory(
    args: &MemoryArgs,
    what: &str,
    size: (usize, usize),
    bytes: impl Fn(u64) -> u64,
) -> Result<()> {
    check(args, what, size, "with these settings", bytes, |fits| match fits {
        Some((height, width)) => {
            format!("resize it to {} pixels a side at most, give fewer views", height.max(width))
        }
        None => "give fewer views or a smaller field".to_owned(),
    })
}

/// The memory limit of an evaluation's scenes.
pub(crate) struct SceneLimit<'a> {
    pub(crate) args: &'a MemoryArgs,
    pub(crate) memory: SceneMemory,
    /// Scenes at once.
    pub(crate) jobs: usize,
}

impl SceneLimit<'_> {
    /// Refuses scenes of that size where those that run at once exceed the limit.
    pub(crate) fn check(&self, what: &str, size: (usize, usize)) -> Result<()> {
        let (with, jobs) = match self.jobs {
            1 => ("with these methods".to_owned(), ""),
            jobs => (format!("with these methods, {jobs} scenes at once,"), ", fewer --jobs"),
        };
        let bytes = |pixels| self.memory.bytes(pixels, self.jobs as u64);
        check(self.args, what, size, &with, bytes, |fits| match fits {
            Some((height, width)) => format!("give --size {width}x{height}, fewer views{jobs}"),
            None => format!("give fewer methods, fewer views or a smaller field{jobs}"),
        })
    }
}

/// Refuses maps whose scoring exceeds the limit.
pub(crate) fn check_maps(args: &MemoryArgs, what: &str, size: (usize, usize)) -> Result<()> {
    let bytes = |pixels| SceneMemory::new(&[], false).bytes(pixels, 1);
    check(args, what, size, "to be scored", bytes, |_| "give smaller maps".to_owned())
}

/// `remedy` gets the largest `(height, width)` of the same aspect ratio that fits, if there is one.
fn check(
    args: &MemoryArgs,
    what: &str,
    (height, width): (usize, usize),
    with: &str,
    bytes: impl Fn(u64) -> u64,
    remedy: impl Fn(Option<(usize, usize)>) -> String,
) -> Result<()> {
    let bound = (args.max_memory * f64::from(1 << 30)) as u64;
    let pixels = width as u64 * height as u64;
    let needed = bytes(pixels);
    if needed <= bound {
        return Ok(());
    }
    let fitting = most_pixels(bound, &bytes).and_then(|most| {
        let scale = (most as f64 / pixels as f64).sqrt();
        let side = |side: usize| (side as f64 * scale) as usize;
        Some((side(height), side(width))).filter(|(height, width)| *height.min(width) >= SMALLEST)
    });
    bail!(
        "{what}: {width}x{height} pixels {with} need about {:.1} GiB, more than --max-memory {}; {}, or a larger \
         --max-memory",
        needed as f64 / f64::from(1 << 30),
        args.max_memory,
        remedy(fitting)
    );
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_longer_side_is_bounded_and_the_aspect_kept() {
        assert_eq!(within((3648, 5472), Some(1600)), (1067, 1600));
        assert_eq!(within((480, 640), Some(640)), (480, 640));
        assert_eq!(within((480, 640), None), (480, 640));
        assert_eq!(within((16000, 20), Some(100)), (100, 1));
    }
}
