//! The paper's Figure 2 and its relatives, as SVG (feature `plot`).
//!
//! Every curve is labelled at its end.

use crate::metrics::sparsification::Sparsification;
use crate::score::UncertaintyCurves;
use crate::table::Entry;
use crate::{Error, Result};
use mde_uncertainty::normal::central_half_width;
use mde_uncertainty::pooled::share_below;
use plotters::prelude::*;
use plotters::style::text_anchor::{HPos, Pos, VPos};
use std::collections::BTreeSet;
use std::path::Path;

const SIZE: (u32, u32) = (900, 560);
/// Room for the names at the lines' ends, pixels.
const NAMES: u32 = 280;
/// Height of a name, pixels.
const NAME_HEIGHT: i32 = 20;
const FONT: &str = "sans-serif";

/// Okabe and Ito's colours, distinguishable with colour blindness; without black and yellow.
const COLOURS: [RGBColor; 6] = [
    RGBColor(0, 114, 178),
    RGBColor(213, 94, 0),
    RGBColor(0, 158, 115),
    RGBColor(204, 121, 167),
    RGBColor(86, 180, 233),
    RGBColor(230, 159, 0),
];
const GUIDE: RGBColor = RGBColor(130, 130, 130);

/// A line with its name at its end.
struct Curve {
    name: String,
    /// In order of x.
    points: Vec<[f64; 2]>,
    /// The method that gives the colour; nothing for a guide, thin and grey.
    colour: Option<usize>,
}

/// Lines over one pair of axes, the first below.
pub struct Chart {
    title: &'static str,
    x: &'static str,
    y: &'static str,
    lines: Vec<Curve>,
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
        let path = path.as_ref();
        let fault = |fault| format!("{}: the figure can't be written: {fault}", path.display());
        self.draw(path).map_err(|error| Error::Method(fault(error)))
    }

    fn draw(&self, path: &Path) -> Result<(), Box<dyn std::error::Error>> {
        let area = SVGBackend::new(path, SIZE).into_drawing_area();
        area.fill(&WHITE)?;
        let [x, y] = ranges(&self.lines);
        let mut context = ChartBuilder::on(&area)
            .caption(self.title, (FONT, 24))
            .margin(12)
            .margin_right(NAMES)
            .x_label_area_size(50)
            .y_label_area_size(70)
            .build_cartesian_2d(x, y)?;
        context
            .configure_mesh()
            .light_line_style(TRANSPARENT)
            .bold_line_style(RGBColor(228, 228, 228))
            .axis_style(RGBColor(90, 90, 90))
            .label_style((FONT, 18))
            .axis_desc_style((FONT, 19))
            .x_label_formatter(&tick)
            .y_label_formatter(&tick)
            .x_desc(self.x)
            .y_desc(self.y)
            .draw()?;
        for line in &self.lines {
            let style = colour(line).stroke_width(if line.colour.is_none() { 1 } else { 2 });
            context.draw_series(LineSeries::new(line.points.iter().map(|p| (p[0], p[1])), style))?;
        }
        let ends = self.lines.iter().filter_map(|line| Some((line, line.points.last()?)));
        let place = |end: &[f64; 2]| context.plotting_area().map_coordinate(&(end[0], end[1]));
        let mut names: Vec<(&Curve, (i32, i32))> = ends.map(|(line, end)| (line, place(end))).collect();
        spread(&mut names);
        for (line, (x, y)) in names {
            let style = (FONT, 19).into_font().color(&colour(line)).pos(Pos::new(HPos::Left, VPos::Center));
            area.draw_text(&line.name, &style, (x + 8, y))?;
        }
        Ok(area.present()?)
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
        title: "Error by percentile of the predicted uncertainty",
        x: "percentile of sigma within a scene",
        y: "mean |error|, m",
        lines,
    }
}

/// Mean \\(|e|\\) of the rest when the most uncertain pixels are removed, relative to all pixels (random), averaged over scenes; the oracle of the
/// first method beside them.
pub fn sparsification(entries: &[Entry], names: &[String]) -> Chart {
    let relative = |curves: &Sparsification, values: &[f64]| {
        let points = curves.removed.iter().zip(values).map(|(r, v)| [100.0 * r, v / curves.random]);
        points.collect::<Vec<_>>()
    };
    let mut lines =
        each(entries, names, |curves| relative(&curves.sparsification, &curves.sparsification.by_sigma));
    let first = names.first().map(std::slice::from_ref).unwrap_or_default();
    for mut oracle in
        each(entries, first, |curves| relative(&curves.sparsification, &curves.sparsification.oracle))
    {
        (oracle.name, oracle.colour) = ("oracle".to_owned(), None);
        lines.insert(0, oracle);
    }
    lines.insert(0, guide("no order", vec![[0.0, 1.0], [99.0, 1.0]]));
    Chart {
        title: "Error of the rest when the most uncertain pixels are removed",
        x: "pixels removed, %",
        y: "mean |error| of the rest / of all",
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
        title: "Share of truths inside the predicted interval",
        x: "nominal probability, %",
        y: "share of pixels inside, %",
        lines,
    }
}

/// The methods that have an uncertainty, in the order of their first entry.
pub fn methods(entries: &[Entry]) -> Vec<String> {
    let mut seen = BTreeSet::new();
    let firsts = entries.iter().filter(|entry| entry.curves.is_some() && seen.insert(&entry.method));
    firsts.map(|entry| entry.method.clone()).collect()
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
    let line = |(colour, name): (usize, &String)| {
        let of_method = entries.iter().filter(|entry| entry.method == *name);
        let scenes: Vec<_> = of_method.filter_map(|entry| entry.curves.as_ref()).map(&points).collect();
        let longest = scenes.iter().map(Vec::len).max().unwrap_or(0);
        // A scene with fewer pixels than bins has other percentiles.
        let scenes: Vec<_> = scenes.into_iter().filter(|scene| scene.len() == longest).collect();
        let sum = |index: usize, axis: usize| scenes.iter().fold(0.0, |sum, scene| sum + scene[index][axis]);
        let mean = |index: usize| [0, 1].map(|axis| sum(index, axis) / scenes.len() as f64);
        let points = (0..longest).map(mean).filter(|point| point.iter().all(|v| v.is_finite())).collect();
        Curve { name: name.clone(), points, colour: Some(colour) }
    };
    names.iter().enumerate().map(line).collect()
}

/// A number without trailing zeros.
fn tick(value: &f64) -> String {
    let text = format!("{value:.3}");
    text.trim_end_matches('0').trim_end_matches('.').to_owned()
}

fn colour(line: &Curve) -> RGBColor {
    line.colour.map_or(GUIDE, |index| COLOURS[index % COLOURS.len()])
}

/// The axes: 0 and all that is drawn.
fn ranges(lines: &[Curve]) -> [std::ops::Range<f64>; 2] {
    let points = || lines.iter().flat_map(|line| &line.points);
    [0, 1].map(|axis| {
        let high = points().map(|p| p[axis]).fold(f64::MIN, f64::max);
        let low = points().map(|p| p[axis]).fold(0.0, f64::min);
        let high = if high > low { high } else { low + 1.0 };
        low..high + if axis == 1 { 0.04 * (high - low) } else { 0.0 }
    })
}

/// Moves names apart that would overlap, and the lowest ones up from below the image.
fn spread(names: &mut [(&Curve, (i32, i32))]) {
    names.sort_by_key(|(_, (_, y))| *y);
    let mut floor = SIZE.1 as i32 - 50;
    for (_, (_, y)) in names.iter_mut().rev() {
        *y = (*y).min(floor);
        floor = *y - NAME_HEIGHT;
    }
    let mut ceiling = i32::MIN;
    for (_, (_, y)) in names.iter_mut() {
        *y = (*y).max(ceiling).max(20);
        ceiling = *y + NAME_HEIGHT;
    }
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
            for word in [chart.title, chart.x, "prior", "better"] {
                assert!(text.contains(&word.replace('&', "&amp;")), "{word} is not in the figure");
            }
            assert!(text.matches("<polyline").count() >= chart.lines.len(), "{}", chart.title);
        }
    }
}
