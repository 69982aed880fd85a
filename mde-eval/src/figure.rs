//! The paper's Figure 2 and its relatives, as SVG (feature `plot`).
//!
//! Every curve is labelled at its end.

mod draw;

use crate::score::UncertaintyCurves;
use crate::table::Entry;
use crate::{Error, Result};
use mde_uncertainty::normal::central_half_width;
use mde_uncertainty::pooled::share_below;
use std::path::Path;

/// One curve of a [`Chart`].
#[derive(Debug, Clone, PartialEq)]
pub struct Curve {
    /// Label at its end; none where empty.
    pub name: String,
    /// Its points, in order of x.
    pub points: Vec<[f64; 2]>,
    /// The method that gives the colour; nothing for a guide, thin and grey.
    pub colour: Option<usize>,
}

/// Lines over one pair of axes.
#[derive(Debug, Clone, PartialEq)]
pub struct Chart {
    /// Title, above the chart.
    pub title: String,
    /// Name and unit of the horizontal axis.
    pub x: String,
    /// Name and unit of the vertical axis.
    pub y: String,
    /// The lines, first below.
    pub lines: Vec<Curve>,
}

impl Chart {
    /// Writes an SVG of 900 x 560 pixels.
    ///
    /// # Errors
    /// [`Error::Empty`] without a point, [`Error::Method`] where it cannot be drawn or written.
    pub fn write(&self, path: impl AsRef<Path>) -> Result<()> {
        if self.lines.iter().all(|line| line.points.is_empty()) {
            return Err(Error::Empty("a figure"));
        }
        draw::write(self, path.as_ref())
    }
}

/// Mean \\(|e|\\) by percentile of sigma, averaged over scenes (the paper's Figure 2): a sigma that is correlated with the errors rises from
/// left to right. Methods as in [`methods`].
pub fn error_by_percentile(entries: &[Entry], names: &[String]) -> Chart {
    let lines = each(entries, names, |curves| {
        let bins = curves.error_by_percentile.len() as f64;
        let place = |(bin, &error): (usize, &f64)| [(bin as f64 + 0.5) * 100.0 / bins, error];
        curves.error_by_percentile.iter().enumerate().map(place).collect()
    });
    Chart {
        title: "Error by percentile of the predicted uncertainty".to_owned(),
        x: "percentile of sigma within a scene".to_owned(),
        y: "mean |error|, m".to_owned(),
        lines,
    }
}

/// Mean \\(|e|\\) of the rest when the most uncertain pixels are removed, relative to all pixels (random), averaged over scenes; the oracle of the
/// first method beside them.
pub fn sparsification(entries: &[Entry], names: &[String]) -> Chart {
    let relative = |curves: &UncertaintyCurves, values: &[f64]| {
        let points = curves.removed.iter().zip(values).map(|(r, v)| [100.0 * r, v / curves.random]);
        points.collect::<Vec<_>>()
    };
    let mut lines = each(entries, names, |curves| relative(curves, &curves.by_sigma));
    let first = names.first().map(std::slice::from_ref).unwrap_or_default();
    for mut oracle in each(entries, first, |curves| relative(curves, &curves.oracle)) {
        (oracle.name, oracle.colour) = ("oracle".to_owned(), None);
        lines.insert(0, oracle);
    }
    lines.insert(0, guide("no order", vec![[0.0, 1.0], [99.0, 1.0]]));
    Chart {
        title: "Error of the rest when the most uncertain pixels are removed".to_owned(),
        x: "pixels removed, %".to_owned(),
        y: "mean |error| of the rest / of all".to_owned(),
        lines,
    }
}

/// Observed against stated coverage of central intervals, averaged over scenes: below the diagonal sigma is too small.
pub fn reliability(entries: &[Entry], names: &[String]) -> Chart {
    let mut lines = each(entries, names, |curves| {
        let level = |k: u32| {
            let nominal = f64::from(k) / 100.0;
            [100.0 * nominal, 100.0 * share_below(&curves.abs_z_quantiles, central_half_width(nominal))]
        };
        std::iter::once([0.0, 0.0]).chain((1..100).map(level)).collect()
    });
    lines.insert(0, guide("right", vec![[0.0, 0.0], [99.0, 99.0]]));
    Chart {
        title: "Share of truths inside the predicted interval".to_owned(),
        x: "nominal probability, %".to_owned(),
        y: "share of pixels inside, %".to_owned(),
        lines,
    }
}

/// The methods that have an uncertainty, in the order of their first entry.
pub fn methods(entries: &[Entry]) -> Vec<String> {
    let mut names: Vec<String> = Vec::new();
    for entry in entries.iter().filter(|entry| entry.curves.is_some()) {
        if !names.contains(&entry.method) {
            names.push(entry.method.clone());
        }
    }
    names
}

fn guide(name: &str, points: Vec<[f64; 2]>) -> Curve {
    Curve { name: name.to_owned(), points, colour: None }
}

/// One line a method: the mean over its scenes, point by point.
fn each(
    entries: &[Entry],
    names: &[String],
    points: impl Fn(&UncertaintyCurves) -> Vec<[f64; 2]>,
) -> Vec<Curve> {
    let mut lines = Vec::new();
    for (colour, name) in names.iter().enumerate() {
        let of_method = entries.iter().filter(|entry| entry.method == *name);
        let scenes: Vec<_> = of_method.filter_map(|entry| entry.curves.as_ref()).map(&points).collect();
        let longest = scenes.iter().map(Vec::len).max().unwrap_or(0);
        // A scene with fewer pixels than bins has other percentiles.
        let scenes: Vec<_> = scenes.into_iter().filter(|scene| scene.len() == longest).collect();
        let sum = |index: usize, axis: usize| scenes.iter().fold(0.0, |sum, scene| sum + scene[index][axis]);
        let mean = |index: usize| [0, 1].map(|axis| sum(index, axis) / scenes.len() as f64);
        let points = (0..longest).map(mean).filter(|point| point.iter().all(|v| v.is_finite())).collect();
        lines.push(Curve { name: name.clone(), points, colour: Some(colour) });
    }
    lines
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::table::tests::entries;

    #[test]
    fn figures_are_written_and_name_their_lines() {
        let entries = entries();
        let names = methods(&entries);
        assert_eq!(names, ["prior", "better"]);
        let place = tempfile::tempdir().unwrap();
        for chart in [
            error_by_percentile(&entries, &names),
            sparsification(&entries, &names),
            reliability(&entries, &names),
        ] {
            assert!(chart.lines.iter().all(|line| line.points.len() > 1), "{}", chart.title);
            let svg = place.path().join("a.svg");
            chart.write(&svg).unwrap();
            let text = std::fs::read_to_string(&svg).unwrap();
            for word in [&chart.title, &chart.x, "prior", "better"] {
                assert!(text.contains(&word.replace('&', "&amp;")), "{word} is not in the figure");
            }
            assert!(text.matches("<polyline").count() >= chart.lines.len(), "{}", chart.title);
        }
    }
}
