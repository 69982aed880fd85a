//! Summary of a finished run.

use mde_cli::{CaptureReport, Refinement};
use mde_uncertainty::statistics::{median, quantile};

/// Two lines: change of the depth and its sigma; and the estimates of the last fusion.
pub(crate) fn summary(refinement: &Refinement, unit: &str) -> String {
    let depth = refinement.depth.mean();
    let moved =
        |(new, old): (&f32, &f32)| (*new > 0.0 && *old > 0.0).then(|| f64::from((new / old - 1.0).abs()));
    let mut moves: Vec<f64> = depth.iter().zip(&refinement.prior).filter_map(moved).collect();
    let sigma = refinement.depth.sigma();
    let known: Vec<f64> = sigma.iter().filter(|s| s.is_finite()).map(|s| f64::from(*s)).collect();
    let relative: Vec<f64> = depth
        .iter()
        .zip(&sigma)
        .filter(|(d, s)| **d > 0.0 && s.is_finite())
        .map(|(d, s)| f64::from(s / d))
        .collect();
    let percent =
        |share: Option<f64>| share.map_or_else(|| "-".to_owned(), |v| format!("{:.1} %", 100.0 * v));
    let unit = match unit {
        "unscaled" => String::new(),
        "capture" => " of the capture's units".to_owned(),
        unit => format!(" {unit}"),
    };
    let mut lines = vec![format!(
        "depth: typical change {}; 90 % of pixels changed by less than {}\nsigma: median {}{unit}, {} of the depth",
        percent(median(moves.iter().copied())),
        percent(quantile(&mut moves, 0.9)),
        median(known).map_or_else(|| "-".to_owned(), |s| format!("{s:.3}")),
        percent(median(relative)),
    )];
    if let Some(last) = refinement.iterations.last() {
        let (fusion, psnr) = (&last.fusion, last.fit.psnr.first());
        let psnr = psnr.map_or_else(String::new, |p| format!("; PSNR of the photograph {p:.1} dB"));
        lines.push(format!(
            "fusion: a {:.3}, b {:.3}, sigma_o {:.3}, weight of the field {:.0} %{psnr}",
            fusion.a,
            fusion.b,
            fusion.sigma_o,
            100.0 * fusion.nerf_weight
        ));
    }
    lines.join("\n")
}

/// One line: the photographs that were used and those that were not.
pub(crate) fn photographs(report: &CaptureReport) -> String {
    let of = |used: bool| report.photographs.iter().filter(move |photograph| photograph.used == used);
    let names =
        |used: bool| of(used).map(|photograph| photograph.name.as_str()).collect::<Vec<_>>().join(", ");
    let others = match of(false).count() {
        0 => String::new(),
        count => format!("; not used: {count} ({}), see run.json", names(false)),
    };
    format!("photographs: {} of {}: {}{others}\n", report.used(), report.photographs.len(), names(true))
}
