//! Values that are chosen by a name.

use crate::config::Preset;
use crate::refiner::finish::Unit;
use clap::builder::{PossibleValue, PossibleValuesParser, TypedValueParser};
use mde_eval::align::AlignmentRule;
use mde_prior::DepthKind;

/// Values with their names and help texts.
type Choices<T> = &'static [(T, &'static str, &'static str)];

pub(super) const PRESETS: Choices<Preset> = &[
    (Preset::Paper, "paper", "The equations as printed: an MLP trained on colours alone, two iterations"),
    (Preset::Fast, "fast", "As default, with at most five predictions"),
    (
        Preset::Default,
        "default",
        "Predictions of crops and mirror images too, merged; a depth map gets an error bar and stays as it is",
    ),
    (
        Preset::MultiView,
        "multi-view",
        "Several photographs (--views): a field on their colours and on the consensus of plane sweeps",
    ),
];

pub(super) const KINDS: Choices<DepthKind> = &[
    (DepthKind::Metric, "metric", "Depth in metres"),
    (DepthKind::RelativeDepth, "depth", "Depth in an unknown unit"),
    (
        DepthKind::AffineDisparity,
        "disparity",
        "1/depth up to a scale and a shift (MiDaS, DPT, Depth Anything)",
    ),
];

pub(super) const UNITS: Choices<Unit> = &[
    (Unit::Prior, "prior", "The prior's unit: metres for a metric prior"),
    (Unit::Capture, "capture", "The unit of the poses that the capture came with"),
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
    ((AlignmentRule::Median, true), "prior", "The prior's, by medians, for every method"),
];

pub(super) fn choice<T: Copy + Send + Sync + 'static>(all: Choices<T>) -> impl TypedValueParser<Value = T> {
    let names = all.iter().map(|(_, name, help)| PossibleValue::new(*name).help(*help));
    PossibleValuesParser::new(names).try_map(|name| {
        let chosen = all.iter().find(|(_, known, _)| *known == name);
        chosen.map(|(value, ..)| *value).ok_or("not one of the names")
    })
}
