//! Depths that are known at some pixels.

use crate::error::{Error, Result, text};
use mde_mvs::capture::{Error as Fault, read_known_depths};
use std::path::Path;

pub use mde_mvs::capture::KnownDepth;

/// Known depths in pixels of the photograph's file.
#[derive(Debug, Clone)]
pub struct KnownDepths {
    /// The file or folder, or `array`.
    pub source: String,
    /// Whether the unit is that of a COLMAP model, and not metres.
    pub of_model: bool,
    depths: Vec<KnownDepth>,
    /// `(height, width)`.
    size: (usize, usize),
}

impl KnownDepths {
    /// Depths in metres, in pixels of a photograph of `(height, width)`; `source` names them.
    ///
    /// # Errors
    /// [`Error::Argument`] where there is none, or one is no positive number.
    pub fn new(
        source: String,
        depths: Vec<KnownDepth>,
        photograph: &str,
        size: (usize, usize),
    ) -> Result<Self> {
        let fault = |text: String| Error::Argument(format!("{{scale-from}} {source}: {text}"));
        if depths.is_empty() {
            return Err(fault(format!(
                "no depth of {photograph}; give its column, row and depth, separated by commas, or a COLMAP model that has points of it"
            )));
        }
        // Before the refinement, not after it.
        depths.iter().try_for_each(check).map_err(|error| fault(text(&error)))?;
        Ok(Self { source, of_model: false, depths, size })
    }

    /// Reads those of `photograph`, whose file has `(height, width)` pixels, by [`read_known_depths`].
    ///
    /// # Errors
    /// [`Error::Argument`] for a file that can't be read, has other columns, or no depth of the photograph.
    pub fn open(path: &Path, photograph: &Path, size: (usize, usize)) -> Result<Self> {
        let depths = read_known_depths(path, photograph, size).map_err(|fault| {
            Error::Argument(match fault {
                Fault::Read { path, source } => format!(
                    "{{scale-from}} {}: can't be read; give a CSV file of x, y, depth, or a COLMAP model: {source}",
                    path.display()
                ),
                other => format!("{{scale-from}} {}", text(&other)),
            })
        })?;
        let known = Self::new(path.display().to_string(), depths, &photograph.display().to_string(), size)?;
        Ok(Self { of_model: path.is_dir(), ..known })
    }

    /// In pixels of a result of `(height, width)`.
    pub fn at(&self, size: (usize, usize)) -> Vec<KnownDepth> {
        let scale = |from: usize, to: usize, at: f64| (at + 0.5) * to as f64 / from as f64 - 0.5;
        let moved = |known: &KnownDepth| KnownDepth {
            x: scale(self.size.1, size.1, known.x),
            y: scale(self.size.0, size.0, known.y),
            ..*known
        };
        self.depths.iter().map(moved).collect()
    }
}

/// Checks that a known depth is a positive number, at a place.
pub(crate) fn check(known: &KnownDepth) -> Result<()> {
    let KnownDepth { x, y, depth, sigma } = *known;
    let finite = [x, y, depth, sigma].iter().all(|v| v.is_finite());
    match finite && depth > 0.0 && sigma >= 0.0 {
        true => Ok(()),
        false => Err(Error::Argument(format!(
            "the known depth {depth} +- {sigma} at ({x}, {y}) is no positive number; check its columns"
        ))),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_pixels_are_those_of_the_result() {
        let one = KnownDepth { x: 10.0, y: 20.0, depth: 1.5, sigma: 0.0 };
        let known = KnownDepths::new("array".to_owned(), vec![one], "a.jpg", (100, 200)).unwrap();
        assert_eq!(known.at((50, 100)), [KnownDepth { x: 4.75, y: 9.75, ..one }]);
    }
}
