//! The refusal of runs that need too much memory.

use crate::error::{Error, Result};
use crate::refiner::plan::most_pixels;
use crate::scene::SMALLEST;

/// The limit of `max-memory`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MemoryLimit {
    /// In GiB.
    pub gib: f64,
}

impl Default for MemoryLimit {
    fn default() -> Self {
        Self { gib: Self::USUAL }
    }
}

impl MemoryLimit {
    /// The usual limit, GiB.
    pub const USUAL: f64 = 8.0;

    /// In bytes.
    pub fn bytes(&self) -> u64 {
        (self.gib * f64::from(1 << 30)) as u64
    }

    /// Refuses a refinement above the limit; `what` names its image of `(height, width)`, `bytes` estimates the memory of so many pixels.
    ///
    /// # Errors
    /// [`Error::Argument`] with the size that fits.
    pub fn check(&self, what: &str, size: (usize, usize), bytes: impl Fn(u64) -> u64) -> Result<()> {
        self.check_with(what, size, "with these settings", bytes, |fits| match fits {
            Some((height, width)) => {
                format!("resize it to {} pixels a side at most, give fewer views", height.max(width))
            }
            None => "give fewer views, fewer rays or samples, a smaller field".to_owned(),
        })
    }

    /// The same with other words, `with` what it needs the memory; `remedy` gets the largest `(height, width)` of that aspect that fits.
    ///
    /// # Errors
    /// As [`check`](Self::check).
    pub fn check_with(
        &self,
        what: &str,
        (height, width): (usize, usize),
        with: &str,
        bytes: impl Fn(u64) -> u64,
        remedy: impl Fn(Option<(usize, usize)>) -> String,
    ) -> Result<()> {
        let bound = self.bytes();
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
        Err(Error::Argument(format!(
            "{what}: {width}x{height} pixels {with} need about {:.1} GiB, more than {{max-memory}} {}; {}, or a larger {{max-memory}}",
            needed as f64 / f64::from(1 << 30),
            self.gib,
            remedy(fitting)
        )))
    }
}
