//! Depths that are known at some pixels.

use crate::error::{Error, Result, text};

/// A depth that is known at a pixel.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct KnownDepth {
    /// Column in pixels of the result, pixel centres at integers.
    pub x: f64,
    /// Row.
    pub y: f64,
    /// Depth z, positive.
    pub depth: f64,
    /// Its standard deviation, 0 where it is not known.
    pub sigma: f64,
}

impl KnownDepth {
    pub(crate) fn check(&self) -> Result<()> {
        let Self { x, y, depth, sigma } = *self;
        let finite = [x, y, depth, sigma].iter().all(|v| v.is_finite());
        match finite && depth > 0.0 && sigma >= 0.0 {
            true => Ok(()),
            false => Err(Error::Argument(format!(
                "the known depth {depth} +- {sigma} at ({x}, {y}) is no positive number; check its columns"
            ))),
        }
    }
}

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
        depths.iter().try_for_each(KnownDepth::check).map_err(|error| fault(text(&error)))?;
        Ok(Self { source, of_model: false, depths, size })
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

#[cfg(feature = "files")]
mod files {
    use super::{Error, KnownDepth, KnownDepths, Result};
    use crate::error::text;
    use mde_mvs::capture::read_colmap_depths;
    use mde_prior::{FileKind, open};
    use nalgebra::Point2;
    use std::path::Path;

    /// Most rows of a file.
    const MOST: usize = 10_000_000;

    impl KnownDepths {
        /// Reads the depths of `photograph`, whose file has `(height, width)` pixels, from a CSV file or a COLMAP model.
        ///
        /// # Errors
        /// [`Error::Argument`] for a file that can't be read, has other columns, or no depth of the photograph.
        pub fn open(path: &Path, photograph: &Path, size: (usize, usize)) -> Result<Self> {
            let shown = format!("{{scale-from}} {}", path.display());
            let fault = |text: String| Error::Argument(format!("{shown}: {text}"));
            let (depths, of_model) = match path.is_dir() {
                true => (of_colmap(path, photograph, size).map_err(fault)?, true),
                false => (of_csv(path).map_err(fault)?, false),
            };
            let source = path.display().to_string();
            let known = Self::new(source, depths, &photograph.display().to_string(), size)?;
            Ok(Self { of_model, ..known })
        }
    }

    /// Rows `x,y,depth` or `x,y,depth,sigma`, with or without a head.
    fn of_csv(path: &Path) -> Result<Vec<KnownDepth>, String> {
        let file = open::open(path, FileKind::Text).map_err(|error| {
            format!("can't be read; give a CSV file of x, y, depth, or a COLMAP model: {error}")
        })?;
        let mut reader = csv::ReaderBuilder::new()
            .has_headers(false)
            .trim(csv::Trim::All)
            .flexible(true)
            .comment(Some(b'#'))
            .from_reader(file);
        let mut depths = Vec::new();
        for (index, row) in reader.records().enumerate() {
            let row = row.map_err(|error| text(&error))?;
            if depths.len() >= MOST {
                return Err(format!("more than {MOST} rows; give fewer"));
            }
            let numbers: Result<Vec<f64>, _> = row.iter().map(str::parse).collect();
            match numbers.as_deref() {
                Ok(&[x, y, depth]) => depths.push(KnownDepth { x, y, depth, sigma: 0.0 }),
                Ok(&[x, y, depth, sigma]) => depths.push(KnownDepth { x, y, depth, sigma }),
                // A head.
                Err(_) if index == 0 && row.iter().all(|cell| cell.parse::<f64>().is_err()) => {}
                _ => {
                    return Err(format!(
                        "row {} is {:?}; give the column, the row, the depth, and if it is known its standard deviation",
                        index + 1,
                        row.iter().collect::<Vec<_>>().join(",")
                    ));
                }
            }
        }
        Ok(depths)
    }

    fn of_colmap(
        model: &Path,
        photograph: &Path,
        (height, width): (usize, usize),
    ) -> Result<Vec<KnownDepth>, String> {
        let model = match model.join("sparse").join("0") {
            inside if inside.is_dir() => inside,
            _ => model.to_owned(),
        };
        let name = photograph.file_name().unwrap_or_default().to_string_lossy();
        let found = read_colmap_depths(&model, &name).map_err(|error| text(&error))?;
        let [w, h] = found.size;
        if [w, h] != [width, height] {
            return Err(format!(
                "{name} has {w}x{h} pixels in the model but {width}x{height} in its file; give the model of this file"
            ));
        }
        let known = |(at, depth): (Point2<f64>, f64)| KnownDepth { x: at.x, y: at.y, depth, sigma: 0.0 };
        Ok(found.depths.into_iter().map(known).collect())
    }
}

#[cfg(all(test, feature = "files"))]
mod tests {
    use super::*;
    use std::path::Path;

    #[test]
    fn rows_are_read_with_and_without_a_head() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("known.csv");
        let read = |text: &str| {
            std::fs::write(&path, text).unwrap();
            KnownDepths::open(&path, Path::new("a.jpg"), (100, 200))
        };
        let known = read("x,y,depth\n10, 20, 1.5\n# a comment\n30,40,2.5,0.1\n").unwrap();
        let half = known.at((50, 100));
        assert_eq!((half[0].x, half[0].y, half[0].depth, half[0].sigma), (4.75, 9.75, 1.5, 0.0));
        assert_eq!((half[1].depth, half[1].sigma), (2.5, 0.1));
        assert_eq!(read("1,2,3").unwrap().depths.len(), 1);
    }
}
