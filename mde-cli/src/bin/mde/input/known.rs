//! `--scale-from`: depths that are known at some pixels.

use anyhow::{Context, Result, bail, ensure};
use mde_cli::scale::KnownDepth;
use mde_mvs::capture::read_colmap_depths;
use serde::Serialize;
use std::path::Path;

/// Known depths in pixels of the photograph's file.
#[derive(Debug, Clone)]
pub(crate) struct Known {
    /// The file or folder.
    pub(crate) source: String,
    /// Whether the unit is that of a COLMAP model, and not metres.
    pub(crate) of_model: bool,
    depths: Vec<KnownDepth>,
    /// `(height, width)`.
    size: (usize, usize),
}

/// How the result came to its unit, for the record.
#[derive(Debug, Clone, Serialize)]
pub(crate) struct Scaled {
    pub(crate) from: String,
    #[serde(flatten)]
    pub(crate) report: mde_cli::scale::ScaleReport,
}

/// Most rows of a file.
const MOST: usize = 10_000_000;

impl Known {
    /// Reads the depths of `photograph`, whose file has `(height, width)` pixels, from a CSV file or a COLMAP model.
    pub(crate) fn open(path: &Path, photograph: &Path, size: (usize, usize)) -> Result<Self> {
        let source = path.display().to_string();
        let (depths, of_model) = match path.is_dir() {
            true => (of_colmap(path, photograph, size)?, true),
            false => (of_csv(path)?, false),
        };
        ensure!(!depths.is_empty(), "--scale-from {source}: no depth of {}", photograph.display());
        Ok(Self { source, of_model, depths, size })
    }

    /// In pixels of a result of `(height, width)`.
    pub(crate) fn at(&self, size: (usize, usize)) -> Vec<KnownDepth> {
        let scale = |from: usize, to: usize, at: f64| (at + 0.5) * to as f64 / from as f64 - 0.5;
        let moved = |known: &KnownDepth| KnownDepth {
            x: scale(self.size.1, size.1, known.x),
            y: scale(self.size.0, size.0, known.y),
            ..*known
        };
        self.depths.iter().map(moved).collect()
    }
}

/// Rows `x,y,depth` or `x,y,depth,sigma`, with or without a head.
fn of_csv(path: &Path) -> Result<Vec<KnownDepth>> {
    let shown = path.display();
    let mut reader = csv::ReaderBuilder::new()
        .has_headers(false)
        .trim(csv::Trim::All)
        .flexible(true)
        .comment(Some(b'#'))
        .from_path(path)
        .with_context(|| {
            format!("--scale-from {shown}: can't be read; give a CSV file of x, y, depth, or a COLMAP model")
        })?;
    let mut depths = Vec::new();
    for (index, row) in reader.records().enumerate() {
        let row = row.with_context(|| format!("--scale-from {shown}"))?;
        ensure!(depths.len() < MOST, "--scale-from {shown}: more than {MOST} rows; give fewer");
        let numbers: Result<Vec<f64>, _> = row.iter().map(str::parse).collect();
        match numbers.as_deref() {
            Ok(&[x, y, depth]) => depths.push(KnownDepth { x, y, depth, sigma: 0.0 }),
            Ok(&[x, y, depth, sigma]) => depths.push(KnownDepth { x, y, depth, sigma }),
            // A head.
            Err(_) if index == 0 && row.iter().all(|cell| cell.parse::<f64>().is_err()) => {}
            _ => bail!(
                "--scale-from {shown}: row {} is {:?}; give the column, the row, the depth, and if it is known its standard deviation",
                index + 1,
                row.iter().collect::<Vec<_>>().join(",")
            ),
        }
    }
    Ok(depths)
}

fn of_colmap(model: &Path, photograph: &Path, (height, width): (usize, usize)) -> Result<Vec<KnownDepth>> {
    let shown = model.display();
    let model = match model.join("sparse").join("0") {
        inside if inside.is_dir() => inside,
        _ => model.to_owned(),
    };
    let name = photograph.file_name().unwrap_or_default().to_string_lossy();
    let found = read_colmap_depths(&model, &name).with_context(|| format!("--scale-from {shown}"))?;
    let [w, h] = found.size;
    ensure!(
        [w, h] == [width, height],
        "--scale-from {shown}: {name} has {w}x{h} pixels in the model but {width}x{height} in its file; give the model of this file"
    );
    let depth = |(pixel, depth): (mde_cli::nalgebra::Point2<f64>, f64)| KnownDepth {
        x: pixel.x,
        y: pixel.y,
        depth,
        sigma: 0.0,
    };
    Ok(found.depths.into_iter().map(depth).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rows_are_read_with_and_without_a_head() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("known.csv");
        let read = |text: &str| {
            std::fs::write(&path, text).unwrap();
            Known::open(&path, Path::new("a.jpg"), (100, 200))
        };
        let known = read("x,y,depth\n10, 20, 1.5\n# a comment\n30,40,2.5,0.1\n").unwrap();
        let half = known.at((50, 100));
        assert_eq!((half[0].x, half[0].y, half[0].depth, half[0].sigma), (4.75, 9.75, 1.5, 0.0));
        assert_eq!((half[1].depth, half[1].sigma), (2.5, 0.1));
        assert_eq!(read("1,2,3").unwrap().depths.len(), 1);
        for (text, part) in [
            ("", "no depth"),
            ("x,y,depth\n", "no depth"),
            ("1,2\n", "row 1"),
            ("1,2,3\na,b,c\n", "row 2"),
            ("1,2,three\n", "row 1"),
        ] {
            let error = read(text).err().unwrap().to_string();
            assert!(error.contains("known.csv") && error.contains(part), "{text:?}: {error}");
        }
        let missing = Known::open(&folder.path().join("no.csv"), Path::new("a.jpg"), (1, 1)).err().unwrap();
        assert!(format!("{missing:#}").contains("no.csv"));
    }
}
