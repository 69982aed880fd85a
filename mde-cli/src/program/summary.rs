//! Summary of a finished run.

use crate::prior::PriorForm;
use crate::program::{flags, number};
use crate::refiner::{ErrorBar, Refined};
use crate::reports::{CaptureReport, PoseSource};
use mde_prior::ModelSpec;
use mde_uncertainty::statistics::{median, quantile};

/// What `--interval` adds to each folder of several photographs, as a line; nothing without it.
pub(crate) fn intervals(error_bar: &ErrorBar) -> String {
    let line = |p| format!("lower.npy and upper.npy in each folder: {:.0} % interval\n", 100.0 * p);
    error_bar.probability().map(line).unwrap_or_default()
}

const COMMON: &str = "\nscale: all depths may be off by one common factor";

/// Change of the depth, its sigma, the photographs that were used, and the estimates of the last fusion.
pub(crate) fn summary(result: &Refined<'_>) -> String {
    let Refined { refinement, unit, stated, origin, scene, camera, .. } = result;
    // A network's metres have a scale of their own.
    let of_model = origin.model.is_some() && scene.known.is_none() && *unit != "capture";
    let depth = refinement.depth.mean();
    let moved = |(new, old): (&f32, &f32)| (*new > 0.0 && *old > 0.0).then(|| (new / old - 1.0).abs());
    let mut moves: Vec<f32> = depth.iter().zip(&refinement.prior).filter_map(moved).collect();
    let sigma = refinement.depth.sigma();
    let known = sigma.iter().copied().filter(|s| s.is_finite());
    let relative = depth.iter().zip(&sigma).filter(|(d, s)| **d > 0.0 && s.is_finite()).map(|(d, s)| s / d);
    let percent =
        |share: Option<f64>| share.map_or_else(|| "-".to_owned(), |v| format!("{:.1} %", 100.0 * v));
    let unit = match *unit {
        "unscaled" => String::new(),
        "capture" => " of the capture's units".to_owned(),
        unit => format!(" {unit}"),
    };
    let same = refinement.iterations.is_empty() && moves.iter().all(|change| *change == 0.0);
    let typical = percent(median(moves.iter().copied()));
    let most = percent(quantile(&mut moves, 0.9));
    let change = match (same, refinement.augmentation.predictions > 1) {
        _ if origin.form == PriorForm::Nothing => match result.unit {
            "unscaled" => "by parallax alone, in a unit of its own; --scale-from gives metres",
            _ => "by parallax alone, in the unit of the capture",
        },
        (true, false) => {
            "as it came: no field was fitted, and the prior is one map without others to compare it with"
        }
        _ => &format!("typical change {typical}; 90 % of pixels changed by less than {most}"),
    };
    let assumed = stated.common_assumed.map_or_else(String::new, |share| {
        let measure = "assumed here: mde calibrate measures this network's";
        format!("; in it {:.0} % of the depth is FastDepth's error, {measure}", 100.0 * share)
    });
    let scale = match (&stated.scale, of_model) {
        (Some(scale), _) => {
            let share = percent(Some(scale.relative));
            format!("{COMMON}, +-{share} ({}), beside sigma", scale.by)
        }
        (None, true) => format!("{COMMON}, which is not in sigma; --scale-from gives it"),
        (None, false) => String::new(),
    };
    let network = |spec: &ModelSpec| {
        format!("network: {}, {}x{}, {}\n", origin.source, spec.width, spec.height, origin.kind)
    };
    let mut lines = vec![format!(
        "{}depth: {change}{scale}\nsigma: median {}{unit}, {} of the depth{assumed}",
        origin.model.as_ref().map(network).unwrap_or_default(),
        number(median(known), 3),
        percent(median(relative)),
    )];
    lines.push(format!("camera: {}", flags(&camera.title())));
    lines.extend(refinement.capture.as_ref().and_then(photographs));
    if let Some(fusion) = refinement.iterations.last().map(|last| &last.fusion) {
        lines.push(format!(
            "fusion: a {:.3}, b {:.3}, sigma_o {:.3}, weight of the field {:.0} %",
            fusion.a,
            fusion.b,
            fusion.sigma_o,
            100.0 * fusion.nerf_weight
        ));
    }
    lines.join("\n")
}

/// Where the poses come from.
pub(crate) fn poses_of(report: &CaptureReport) -> &'static str {
    match report.poses {
        PoseSource::Given => "poses as given",
        PoseSource::Refined => "poses refined",
        PoseSource::Estimated => "poses estimated",
    }
}

/// The photographs that were used, and how the field renders one of them.
fn photographs(report: &CaptureReport) -> Option<String> {
    if report.fallback.is_some() {
        return None;
    }
    let poses = poses_of(report);
    let confirmed = report.confirmed.map_or_else(String::new, |share| {
        format!("; another one confirms the depth of {:.0} % of the pixels", 100.0 * share)
    });
    let (used, all) = (report.used(), report.photographs.len());
    let chosen = report.photographs.iter().filter(|photograph| photograph.used);
    let names: Vec<&str> = chosen.map(|photograph| photograph.name.as_str()).collect();
    let mut line = format!("photographs: {used} of {all} used ({}), {poses}{confirmed}", names.join(", "));
    for photograph in report.photographs.iter().filter(|photograph| photograph.has_no_pose()) {
        line += &format!("\nleft out: {}: {}", photograph.name, photograph.verdict);
    }
    Some(line)
}
