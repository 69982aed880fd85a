//! An evaluation in a few sentences: which method is better than the reference in what, beyond chance.

use crate::program::evaluation::runner::Failure;
use crate::program::evaluation::scoring::{SIGMA_BY, UNSHARP};
use mde_eval::score::{Better, Group, METRICS, Metric};
use mde_eval::table::{MethodSummary, Statistics, Summary};
use std::collections::BTreeMap;

/// Places from which on an interval is more than the range of a few numbers.
const ENOUGH: usize = 6;
/// Most methods that get a sentence, and most metrics named in one.
const METHODS: usize = 5;
const NAMED: usize = 4;
/// The metric of the headline.
const HEADLINE: &str = "abs_rel";

/// A sentence for each method, the smallest error first.
pub(crate) fn sentences(summary: &Summary) -> Vec<String> {
    // Controls are no methods.
    let is_method = |name: &str| !name.contains(SIGMA_BY) && !name.starts_with(UNSHARP);
    let mut methods: Vec<&MethodSummary> = summary.methods.iter().filter(|m| is_method(&m.method)).collect();
    let error = |method: &MethodSummary| method.metrics.get(HEADLINE).map_or(f64::INFINITY, |s| s.mean);
    methods.sort_by(|a, b| error(a).total_cmp(&error(b)));
    let Some(reference) = &summary.reference else {
        let alone = |method: &&MethodSummary| {
            let error = method.metrics.get(HEADLINE)?;
            Some(format!("{}: AbsRel {:.4} over {} scenes", method.method, error.mean, error.scenes))
        };
        return methods.iter().filter_map(alone).collect();
    };
    let own = summary.get(reference, HEADLINE).map(|s| s.mean);
    let mut lines: Vec<String> = methods
        .iter()
        .filter(|method| method.method != *reference)
        .take(METHODS)
        .map(|method| compared(method, reference, own))
        .collect();
    let more = methods.len().saturating_sub(1 + METHODS);
    if more > 0 {
        lines.push(format!("{more} more methods are in table.md"));
    }
    if summary.places < ENOUGH && !lines.is_empty() {
        let what = if summary.places < summary.scenes { "place" } else { "scene" };
        let few = match summary.places {
            1 => format!("one {what} is too few"),
            places => format!("{places} {what}s are too few"),
        };
        lines.push(format!("{few} to tell a difference from chance; evaluate {ENOUGH} or more"));
    }
    lines
}

/// What failed, one line for each method and reason.
pub(crate) fn failures(failures: &[Failure]) -> Vec<String> {
    let mut groups: BTreeMap<(&str, &str), Vec<&str>> = BTreeMap::new();
    for failure in failures {
        let method = failure.method.as_deref().unwrap_or("all methods");
        groups.entry((method, &failure.error)).or_default().push(&failure.scene);
    }
    let line = |((method, error), scenes): ((&str, &str), Vec<&str>)| match scenes.as_slice() {
        [scene] => format!("failed: {method} on {scene}: {error}"),
        scenes => format!("failed: {method} on {} scenes: {error}", scenes.len()),
    };
    groups.into_iter().map(line).collect()
}

fn compared(method: &MethodSummary, reference: &str, own: Option<f64>) -> String {
    let headline = method.metrics.get(HEADLINE).zip(own).map_or_else(String::new, |(s, own)| {
        let change = match s.ratio {
            Some(ratio) => format!(" ({:+.1} %)", 100.0 * (ratio.value - 1.0)),
            None => String::new(),
        };
        format!("AbsRel {own:.4} -> {:.4}{change}; ", s.mean)
    });
    let (mut better, mut worse, mut open) = (Vec::new(), Vec::new(), 0);
    // Gradients are raised by any sharpening, and seconds are no quality.
    let judges = |metric: &&Metric| metric.shown && !matches!(metric.group, Group::Gradient | Group::Cost);
    for metric in METRICS.iter().filter(judges) {
        match method.metrics.get(metric.key).and_then(|s| gain(metric, s)) {
            None => {}
            Some(0) => open += 1,
            Some(gain) => if gain > 0 { &mut better } else { &mut worse }.push(metric.label),
        }
    }
    let (on_better, on_worse) = (named(&better, &worse), named(&worse, &better));
    let text = match (better.is_empty(), worse.is_empty()) {
        (true, true) => format!("no difference to {reference} beyond chance"),
        (false, true) => format!("better than {reference} in {on_better}"),
        (true, false) => format!("worse than {reference} in {on_worse}"),
        (false, false) => format!("better than {reference} in {on_better}, worse in {on_worse}"),
    };
    let rest = if open > 0 && !(better.is_empty() && worse.is_empty()) {
        format!("; {open} others within chance")
    } else {
        String::new()
    };
    format!("{}: {headline}{text}{rest}", method.method)
}

/// 1 for better beyond chance, -1 for worse, 0 for neither; nothing where the metric ranks nothing.
fn gain(metric: &Metric, statistics: &Statistics) -> Option<i8> {
    let sign = match metric.better {
        Better::Lower => -1.0,
        Better::Higher => 1.0,
        Better::Near(_) | Better::Neither => return None,
    };
    let difference = statistics.difference?;
    Some(match statistics.places >= ENOUGH && difference.excludes(0.0) {
        false => 0,
        true if sign * difference.value > 0.0 => 1,
        true => -1,
    })
}

/// Labels without their parameters and units, each once; with them where the name is among the others too.
fn named(labels: &[&str], others: &[&str]) -> String {
    let short = |label: &str| label.split(',').next().unwrap_or(label).to_owned();
    let mut shortened: Vec<String> = Vec::new();
    for label in labels {
        let name = match others.iter().any(|other| short(other) == short(label)) {
            true => label.replacen(", ", " (", 1) + if label.contains(", ") { ")" } else { "" },
            false => short(label),
        };
        if !shortened.contains(&name) {
            shortened.push(name);
        }
    }
    let more = shortened.len().saturating_sub(NAMED);
    shortened.truncate(NAMED);
    let more = if more > 0 { format!(" and {more} more") } else { String::new() };
    shortened.join(", ") + &more
}

#[cfg(test)]
mod tests {
    use super::*;
    use mde_eval::score::{Subject, score};
    use mde_eval::statistics::Bootstrap;
    use mde_eval::table::Entry;
    use ndarray::Array2;

    /// A map whose error is `error` of the depth in stripes, on a number of scenes.
    fn entries(scenes: usize) -> Vec<Entry> {
        let mut entries = Vec::new();
        for scene in 0..scenes {
            let truth = Array2::from_shape_fn((24, 32), |(y, x)| 1.0 + 0.05 * (x + y + scene) as f32);
            for (name, error) in [("prior", 0.2), ("good", 0.1), ("bad", 0.4), ("good, sigma by depth", 0.1)]
            {
                let depth = Array2::from_shape_fn(truth.dim(), |(y, x)| {
                    truth[(y, x)] * (1.0 + if x % 4 < 2 { error } else { 0.0 } * (1.0 + 0.01 * scene as f32))
                });
                let scores = score(&Subject::new(depth.view(), truth.view()), &Default::default()).unwrap();
                entries.push(Entry::new(format!("scene {scene}"), name, scores));
            }
        }
        entries
    }

    #[test]
    fn what_is_better_beyond_chance_is_said_of_each_method() {
        let summary = Summary::new(&entries(8), Some("prior"), &Bootstrap::default()).unwrap();
        let lines = sentences(&summary);
        assert_eq!(lines.len(), 2, "{lines:?}");
        assert!(
            lines[0].starts_with("good: AbsRel ") && lines[0].contains("better than prior in "),
            "{lines:?}"
        );
        assert!(
            lines[1].starts_with("bad: AbsRel ") && lines[1].contains("worse than prior in "),
            "{lines:?}"
        );
    }

    #[test]
    fn equal_failures_take_one_line() {
        let failure = |scene: &str, method: Option<&str>, error: &str| Failure {
            scene: scene.to_owned(),
            method: method.map(str::to_owned),
            error: error.to_owned(),
        };
        let all = [failure("a", Some("zoom"), "x"), failure("b", Some("zoom"), "x"), failure("a", None, "y")];
        assert_eq!(failures(&all), ["failed: all methods on a: y", "failed: zoom on 2 scenes: x"]);
        assert_eq!(named(&["F1, 0.25 m", "MSE, m²", "F1, 0.5 m"], &["D3R"]), "F1, MSE");
        assert_eq!(named(&["F1, 0.25 m", "MSE, m²"], &["F1, 0.5 m"]), "F1 (0.25 m), MSE");
    }

    #[test]
    fn few_scenes_show_nothing() {
        let summary = |scenes| Summary::new(&entries(scenes), Some("prior"), &Bootstrap::default()).unwrap();
        assert!(sentences(&summary(1)).last().unwrap().starts_with("one scene is too few"));
        let lines = sentences(&summary(3));
        assert!(
            lines[..2].iter().all(|line| line.contains("no difference to prior beyond chance")),
            "{lines:?}"
        );
        assert!(lines[2].contains("3 scenes are too few"), "{lines:?}");
    }
}
