use super::{Chart, Curve};
use crate::{Error, Result};
use plotters::coord::Shift;
use plotters::prelude::*;
use plotters::style::text_anchor::{HPos, Pos, VPos};
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

pub(super) fn write(chart: &Chart, path: &Path) -> Result<()> {
    let area = SVGBackend::new(path, SIZE).into_drawing_area();
    drawn(chart, &area)
        .and_then(|()| area.present())
        .map_err(|fault| Error::Method(format!("{}: the figure can't be written: {fault}", path.display())))
}

fn drawn<B: DrawingBackend>(
    chart: &Chart,
    area: &DrawingArea<B, Shift>,
) -> Result<(), DrawingAreaErrorKind<B::ErrorType>> {
    area.fill(&WHITE)?;
    let [x, y] = ranges(&chart.lines);
    let mut context = ChartBuilder::on(area)
        .caption(&chart.title, (FONT, 24))
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
        .x_desc(&chart.x)
        .y_desc(&chart.y)
        .draw()?;
    for line in &chart.lines {
        let style = colour(line).stroke_width(if line.colour.is_none() { 1 } else { 2 });
        context.draw_series(LineSeries::new(line.points.iter().map(|p| (p[0], p[1])), style))?;
    }
    let ends = chart.lines.iter().filter_map(|line| Some((line, line.points.last()?)));
    let ends = ends.map(|(line, end)| (line, context.plotting_area().map_coordinate(&(end[0], end[1]))));
    let mut names: Vec<(&Curve, (i32, i32))> = ends.filter(|(line, _)| !line.name.is_empty()).collect();
    spread(&mut names);
    for (line, (x, y)) in names {
        let style = (FONT, 19).into_font().color(&colour(line)).pos(Pos::new(HPos::Left, VPos::Center));
        area.draw_text(&line.name, &style, (x + 8, y))?;
    }
    Ok(())
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
    let bottom = SIZE.1 as i32 - 50;
    let mut floor = bottom;
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
