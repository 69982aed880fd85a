//! Summary of a finished run.

use crate::prior::origin::PriorForm;
use crate::refiner::Refined;
use crate::refiner::error_bar::ErrorBar;
use crate::reports::capture::{CaptureReport, PoseSource};
use mde_uncertainty::statistics::{median, quantile};
use ndarray::ArrayView2;

/// What `--interval` adds to each folder of several photographs, as a line; nothing without it.
pub(crate) fn intervals(error_bar: &ErrorBar) -> String {
    let line = |p| format!("lower.npy and upper.npy in each folder: {:.0} % interval\n", 100.0 * p);
    error_bar.probability().map(line).unwrap_or_default()
}

/// Change of the depth, its sigma, the photographs that were used, and the estimates of the last fusion.
pub(crate) fn summary(result: &Refined<'_>, of_model: bool) -> String {
    let Refined { refinement, unit, stated, .. } = result;
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
    let unit = match *unit {
        "unscaled" => String::new(),
        "capture" => " of the capture's units".to_owned(),
        unit => format!(" {unit}"),
    };
    let same = refinement.iterations.is_empty() && moves.iter().all(|change| *change == 0.0);
    let change = match (same, refinement.augmentation.predictions > 1) {
        _ if result.origin.form == PriorForm::Nothing => match result.unit {
            "unscaled" => "by parallax alone, in a unit of its own; --scale-from gives metres".to_owned(),
            _ => "by parallax alone, in the unit of the capture".to_owned(),
        },
        (true, false) => {
            "as it came: no field was fitted, and the prior is one map without others to compare it with"
                .to_owned()
        }
        _ => format!(
            "typical change {}; 90 % of pixels changed by less than {}",
            percent(median(moves.iter().copied())),
            percent(quantile(&mut moves, 0.9))
        ),
    };
    let least = least_sure(depth, sigma.view())
        .map_or_else(String::new, |(place, share)| format!("; least sure {place}: {}", percent(Some(share))));
    let assumed = stated.common_assumed.map_or_else(String::new, |share| {
        let measure = "assumed here: mde calibrate measures this network's";
        format!("; in it {:.0} % of the depth is FastDepth's error, {measure}", 100.0 * share)
    });
    let scale = match (&stated.scale, of_model) {
        (Some(scale), _) => {
            format!(
                "; the scale of the whole map: {} beside sigma ({})",
                percent(Some(scale.relative)),
                scale.by
            )
        }
        (None, true) => "; the scale of the whole map is not in it".to_owned(),
        (None, false) => String::new(),
    };
    let mut lines = vec![format!(
        "depth: {change}\nsigma: median {}{unit}, {} of the depth{assumed}{least}{scale}",
        median(known).map_or_else(|| "-".to_owned(), |s| format!("{s:.3}")),
        percent(median(relative)),
    )];
    lines.extend(refinement.capture.as_ref().and_then(photographs));
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

/// The ninth of the image whose median of sigma over depth is the largest, and that median; nothing where all are alike.
fn least_sure(depth: ArrayView2<'_, f32>, sigma: ArrayView2<'_, f32>) -> Option<(&'static str, f64)> {
    const PLACES: [&str; 9] = [
        "at the upper left",
        "at the top",
        "at the upper right",
        "at the left",
        "in the middle",
        "at the right",
        "at the lower left",
        "at the bottom",
        "at the lower right",
    ];
    let (height, width) = depth.dim();
    let mut shares: [Vec<f64>; 9] = Default::default();
    for ((row, column), &z) in depth.indexed_iter() {
        let s = sigma[(row, column)];
        if z > 0.0 && s.is_finite() {
            shares[3 * (3 * row / height) + 3 * column / width].push(f64::from(s / z));
        }
    }
    let medians = shares.into_iter().zip(PLACES).filter_map(|(shares, place)| Some((place, median(shares)?)));
    let medians: Vec<_> = medians.collect();
    let most = medians.iter().copied().max_by(|a, b| a.1.total_cmp(&b.1))?;
    let least = medians.iter().map(|(_, share)| *share).fold(f64::INFINITY, f64::min);
    (most.1 > 1.1 * least).then_some(most)
}

/// The photographs that were used, and how the field renders one of them.
fn photographs(report: &CaptureReport) -> Option<String> {
    if report.fallback.is_some() {
        return None;
    }
    let poses = match report.poses {
        PoseSource::Given => "poses as given",
        PoseSource::Refined => "poses refined",
        PoseSource::Estimated => "poses estimated",
    };
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
    let novel = report.novel.as_ref();
    if let Some((novel, psnr, prior)) =
        novel.and_then(|novel| Some((novel, novel.psnr?, novel.psnr_of_prior?)))
    {
        let name = report.photographs.get(novel.photograph).map_or("", |photograph| photograph.name.as_str());
        let kind = if novel.withheld { "withheld" } else { "in the fit" };
        line += &format!("\nPSNR of {name}, {kind}: field {psnr:.1} dB, moved by the prior {prior:.1} dB");
    }
    Some(line)
}

#[cfg(test)]
mod tests {
    use super::*;
    use ndarray::Array2;

    #[test]
    fn the_least_sure_part_is_named() {
        let depth = Array2::from_elem((9, 12), 2.0);
        let mut sigma = Array2::from_elem((9, 12), 0.1);
        assert_eq!(least_sure(depth.view(), sigma.view()), None);
        sigma.slice_mut(ndarray::s![6.., 8..]).fill(0.5);
        let (place, share) = least_sure(depth.view(), sigma.view()).unwrap();
        assert_eq!((place, share), ("at the lower right", 0.25));
        sigma.fill(f32::INFINITY);
        assert_eq!(least_sure(depth.view(), sigma.view()), None);
    }
}
