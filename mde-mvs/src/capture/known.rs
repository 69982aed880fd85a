//! Depths that are known at some pixels of a photograph.

use super::{Result, content, fault, read_colmap_depths, read_text};
use std::path::Path;

/// Most rows of a file.
const MOST: usize = 10_000_000;

/// A depth that is known at a pixel.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct KnownDepth {
    /// Column in pixels, pixel centres at integers.
    pub x: f64,
    /// Row.
    pub y: f64,
    /// Depth z, positive.
    pub depth: f64,
    /// Its standard deviation, 0 where it is not known.
    pub sigma: f64,
}

/// The known depths of a photograph whose file has `(height, width)` pixels: from a file with a row `x,y,depth` or `x,y,depth,sigma` for each,
/// with or without a head, or at the points of a COLMAP model's folder, in its unit. No photograph is read.
///
/// # Errors
/// [`Error::Read`](super::Error::Read) for a file that can't be read, [`Error::Content`](super::Error::Content) for other columns, or a model
/// of another photograph.
pub fn read_known_depths(
    path: &Path,
    photograph: &Path,
    (height, width): (usize, usize),
) -> Result<Vec<KnownDepth>> {
    if !path.is_dir() {
        return rows(path);
    }
    let inside = path.join("sparse/0");
    let model = if inside.is_dir() { &inside } else { path };
    let name = photograph.file_name().unwrap_or_default().to_string_lossy();
    let ((h, w), known) = read_colmap_depths(model, &name)?;
    if (h, w) != (height, width) {
        return Err(fault(
            path,
            format!(
                "{name} has {w}x{h} pixels in the model but {width}x{height} in its file; give the model of this file"
            ),
        ));
    }
    Ok(known)
}

fn rows(path: &Path) -> Result<Vec<KnownDepth>> {
    let text = read_text(path)?;
    let lines = text.lines().map(str::trim).filter(|line| !line.is_empty() && !line.starts_with('#'));
    let mut depths = Vec::new();
    for (index, line) in lines.enumerate() {
        let numbers: Vec<Option<f64>> = line.split(',').map(|cell| cell.trim().parse().ok()).collect();
        match *numbers {
            [Some(x), Some(y), Some(depth)] => depths.push(KnownDepth { x, y, depth, sigma: 0.0 }),
            [Some(x), Some(y), Some(depth), Some(sigma)] => depths.push(KnownDepth { x, y, depth, sigma }),
            // A head.
            _ if index == 0 && numbers.iter().all(Option::is_none) => {}
            _ => {
                let remedy = "give the column, the row, the depth, and if it is known its standard deviation";
                return Err(content(path, format!("row {}", index + 1), format!("is {line:?}; {remedy}")));
            }
        }
        if depths.len() > MOST {
            return Err(fault(path, format!("more than {MOST} rows; give fewer")));
        }
    }
    Ok(depths)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rows_are_read_with_and_without_a_head() {
        let place = tempfile::tempdir().unwrap();
        let read = |text: &str| {
            std::fs::write(place.path().join("known.csv"), text).unwrap();
            read_known_depths(&place.path().join("known.csv"), Path::new("a.jpg"), (100, 200)).unwrap()
        };
        let one = KnownDepth { x: 10.0, y: 20.0, depth: 1.5, sigma: 0.0 };
        let other = KnownDepth { x: 30.0, y: 40.0, depth: 2.5, sigma: 0.1 };
        assert_eq!(read("x,y,depth\n10, 20, 1.5\n\n# a comment\n30,40,2.5,0.1\n"), [one, other]);
        assert_eq!(read("10,20,1.5"), [one]);
    }
}
