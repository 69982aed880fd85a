//! Values of arguments.

use crate::output::export::Format;
use clap::ValueEnum;
use clap::builder::{PossibleValue, PossibleValuesParser, TypedValueParser};
use mde_eval::align::AlignmentRule;
use mde_eval::data::CaptureGrid;
use mde_prior::DepthKind;
use std::str::FromStr;

/// Values with their names and help texts.
type Choices<T> = &'static [(T, &'static str, &'static str)];

pub(super) const KINDS: Choices<DepthKind> = &[
    (DepthKind::Metric, "metric", "Metres"),
    (DepthKind::RelativeDepth, "depth", "Depth in an unknown unit"),
    (
        DepthKind::AffineDisparity,
        "disparity",
        "1/depth up to a scale and a shift (MiDaS, DPT, Depth Anything)",
    ),
];

/// The rule, and whether every method has the prior's alignment.
pub(super) const ALIGNMENTS: Choices<(AlignmentRule, bool)> = &[
    ((AlignmentRule::Median, false), "median", "By the ratio of the medians of truth and map"),
    ((AlignmentRule::MedianRatio, false), "median-ratio", "By the median of the pixels' ratios"),
    ((AlignmentRule::LeastSquaresDepth, false), "ls-depth", "Least squares, scale and shift, in depth"),
    (
        (AlignmentRule::LeastSquaresDisparity, false),
        "ls-disparity",
        "Least squares, scale and shift, in disparity",
    ),
    ((AlignmentRule::None, false), "none", "None: for metric depth"),
    ((AlignmentRule::MedianRatio, true), "prior", "The prior's, by the median of ratios, for every method"),
];

pub(super) fn choice<T: Copy + Send + Sync + 'static>(all: Choices<T>) -> impl TypedValueParser<Value = T> {
    let names = all.iter().map(|(_, name, help)| PossibleValue::new(*name).help(*help));
    PossibleValuesParser::new(names).try_map(|name| {
        let chosen = all.iter().find(|(_, known, _)| *known == name);
        chosen.map(|(value, ..)| *value).ok_or("not one of the names")
    })
}

/// The formats by their names, with or without those of a whole capture.
pub(super) fn formats(whole: bool) -> impl TypedValueParser<Value = Format> {
    let refused = move |format: Format| format.is_of_capture() && !whole;
    let named = |format: &Format| Some(format.to_possible_value()?.hide(refused(*format)));
    let values = Format::value_variants().iter().filter_map(named);
    PossibleValuesParser::new(values).try_map(move |name| match Format::from_str(&name, false) {
        Ok(format) if refused(format) => {
            Err(format!("is of a whole capture: mde dense CAPTURE --export {name}"))
        }
        parsed => parsed,
    })
}

/// `WxH` as `[width, height]`.
pub(super) fn size(text: &str) -> Result<[usize; 2], String> {
    let sides = text.split_once(['x', 'X']).and_then(|(w, h)| Some([w.parse().ok()?, h.parse().ok()?]));
    match sides {
        Some(sides) if sides.iter().all(|side| (8..=16384).contains(side)) => Ok(sides),
        _ => Err("give WIDTHxHEIGHT with 8 to 16384 pixels each, such as 320x240".to_owned()),
    }
}

/// `views=3,5;pose-noise=0,.3`: the conditions of captures.
pub(super) fn grid(text: &str) -> Result<CaptureGrid, String> {
    fn list<T: FromStr>(key: &str, values: &str) -> Result<Vec<T>, String> {
        let values = values.split(',').map(|value| value.trim().parse());
        values.collect::<Result<_, _>>().map_err(|_| format!("{key}: give numbers, such as views=3,5"))
    }
    let mut grid = CaptureGrid::default();
    for part in text.split(';').filter(|part| !part.trim().is_empty()) {
        let (key, values) = part.split_once('=').unwrap_or((part, ""));
        match key.trim() {
            "views" => grid.views = list(key, values)?,
            "baseline" => grid.baselines = list(key, values)?,
            "pose-noise" => grid.pose_noises = list(key, values)?,
            "gain" => grid.gains = list(key, values)?,
            other => return Err(format!("{other}: give views, baseline, pose-noise or gain")),
        }
    }
    Ok(grid)
}

/// Finite numbers, separated by commas.
fn numbers<const N: usize>(text: &str) -> Option<[f64; N]> {
    let numbers = text.split(',').map(|part| part.trim().parse().ok()).collect::<Option<Vec<f64>>>()?;
    numbers.try_into().ok().filter(|numbers: &[f64; N]| numbers.iter().all(|number| number.is_finite()))
}

fn number(text: &str, is_within: fn(f64) -> bool, remedy: &str) -> Result<f64, String> {
    numbers(text).map(|[number]| number).filter(|number| is_within(*number)).ok_or_else(|| remedy.to_owned())
}

pub(super) fn positive(text: &str) -> Result<f64, String> {
    number(text, |number| number > 0.0, "give a positive number")
}

pub(super) fn probability(text: &str) -> Result<f64, String> {
    number(text, |p| (0.01..=0.99).contains(&p), "give 0.01 to 0.99, such as 0.9")
}

pub(super) fn field_of_view(text: &str) -> Result<f64, String> {
    let remedy = "give degrees above 0 and below 180, such as 60";
    number(text, |degrees| 0.0 < degrees && degrees < 180.0, remedy)
}

/// `FX` or `FX,FY`.
pub(super) fn focal(text: &str) -> Result<(f64, Option<f64>), String> {
    let one = || numbers(text).map(|[fx]| (fx, None));
    let found = numbers(text).map(|[fx, fy]| (fx, Some(fy))).or_else(one);
    found.ok_or_else(|| "give pixels, such as 520 or 520,521".to_owned())
}

pub(super) fn depth_range(text: &str) -> Result<[f64; 2], String> {
    match numbers(text) {
        Some([near, far]) if near > 0.0 && far > near => Ok([near, far]),
        _ => Err("give two positive numbers, the nearer first, such as 0.8,8".to_owned()),
    }
}

pub(super) fn triple(text: &str) -> Result<[f64; 3], String> {
    numbers(text).ok_or_else(|| "give three numbers, such as 0.05,0,-0.1".to_owned())
}
