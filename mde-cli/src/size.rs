//! The size that a picture is worked on in, and the memory that it may take.

use crate::args::MemoryArgs;
use anyhow::{Result, ensure};
use mde_cli::memory::most_pixels;
use mde_prior::resample::{Filter, resize};
use ndarray::{Array3, Axis};

/// Pictures are at least this wide and high.
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

/// The picture at that size.
pub(crate) fn shrink(image: &Array3<f32>, (height, width): (usize, usize)) -> Array3<f32> {
    let mut small = Array3::zeros((height, width, 3));
    for (mut to, from) in small.axis_iter_mut(Axis(2)).zip(image.axis_iter(Axis(2))) {
        to.assign(&resize(from, (height, width), Filter::BilinearAntialias));
    }
    small
}

/// Refuses a run that would take more than it may; `what` is its picture, `bytes` its estimate by pixels.
pub(crate) fn check_memory(
    args: &MemoryArgs,
    what: &str,
    (height, width): (usize, usize),
    bytes: impl Fn(u64) -> u64,
) -> Result<()> {
    let gib = |bytes: u64| bytes as f64 / f64::from(1 << 30);
    let bound = (args.max_memory * f64::from(1 << 30)) as u64;
    let pixels = width as u64 * height as u64;
    let needed = bytes(pixels);
    let remedy = match most_pixels(bound, &bytes) {
        Some(most) if most < pixels => {
            let side = width.max(height) as f64 * (most as f64 / pixels as f64).sqrt();
            format!(
                "resize it to {} pixels a side at most, give fewer views, or a larger --max-memory",
                side as u64
            )
        }
        _ => "give fewer views or a smaller field, or a larger --max-memory".to_owned(),
    };
    ensure!(
        needed <= bound,
        "{what}: {width}x{height} pixels with these settings need about {:.1} GiB, more than --max-memory {}; {remedy}",
        gib(needed),
        args.max_memory
    );
    Ok(())
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
