use super::write::ENOUGH;
use super::{MethodSummary, Statistics, Summary};
use crate::score::{Better, Group, METRICS, Metric};
use crate::statistics::Estimate;

/// Separates a method's name from that of a trivial sigma.
pub(crate) const SIGMA_BY: &str = ", sigma by ";
/// Begins the name of the unsharp mask of equal sharpness.
pub(crate) const UNSHARP: &str = "unsharp as sharp as ";
/// Most methods that get a sentence, and most metrics named in one.
const METHODS: usize = 5;
const NAMED: usize = 4;
/// The metric of the headline.
const HEADLINE: &str = "abs_rel";

/// Whether an entry's method is a control of another: a trivial sigma, or the unsharp mask of equal sharpness.
pub fn is_control(method: &str) -> bool {
    method.contains(SIGMA_BY) || method.starts_with(UNSHARP)
}

/// An evaluation in a few sentences, one for each of at most five methods, the smallest error first: in what it is better or worse than the
/// reference, beyond chance. `table` names the file that has the others.
pub fn verdict(summary: &Summary, table: &str) -> Vec<String> {
    let mut methods: Vec<&MethodSummary> =
        summary.methods.iter().filter(|m| !is_control(&m.method)).collect();
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
        lines.push(format!("{more} more methods are in {table}"));
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

impl Summary {
    /// The numbers of scenes and places, in words.
    pub fn counted(&self) -> String {
        let counted =
            |count: usize, what: &str| format!("{count} {what}{}", if count == 1 { "" } else { "s" });
        match self.places < self.scenes {
            true => format!("{} of {}", counted(self.scenes, "scene"), counted(self.places, "place")),
            false => counted(self.scenes, "scene"),
        }
    }
}

fn compared(method: &MethodSummary, reference: &str, own: Option<f64>) -> String {
    let headline = method.metrics.get(HEADLINE).zip(own).map_or_else(String::new, |(s, own)| {
        let percent = |ratio: Estimate| format!(" ({:+.1} %)", 100.0 * (ratio.value - 1.0));
        let change = s.ratio.map_or_else(String::new, percent);
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
    let mut text = match (better.is_empty(), worse.is_empty()) {
        (true, true) => format!("no difference to {reference} beyond chance"),
        (false, true) => format!("better than {reference} in {on_better}"),
        (true, false) => format!("worse than {reference} in {on_worse}"),
        (false, false) => format!("better than {reference} in {on_better}, worse in {on_worse}"),
    };
    if open > 0 && !(better.is_empty() && worse.is_empty()) {
        text += &format!("; {open} others within chance");
    }
    format!("{}: {headline}{text}", method.method)
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
    use crate::statistics::Bootstrap;
    use crate::table::tests::entries_of;

    fn summary(scenes: usize) -> Summary {
        let methods = [("prior", 0.2), ("good", 0.1), ("bad", 0.4), ("good, sigma by depth", 0.1)];
        Summary::new(&entries_of(scenes, &methods, false), Some("prior"), &Bootstrap::default()).unwrap()
    }

    #[test]
    fn what_is_better_beyond_chance_is_said_of_each_method() {
        let lines = verdict(&summary(8), "table.md");
        assert_eq!(lines.len(), 2, "{lines:?}");
        let told = [("good: AbsRel ", "better than prior in "), ("bad: AbsRel ", "worse than prior in ")];
        for (line, (start, what)) in lines.iter().zip(told) {
            assert!(line.starts_with(start) && line.contains(what), "{line}");
        }
    }

    #[test]
    fn a_metric_is_named_once_and_with_its_unit_where_needed() {
        assert_eq!(named(&["F1, 0.25 m", "MSE, m²", "F1, 0.5 m"], &["D3R"]), "F1, MSE");
        assert_eq!(named(&["F1, 0.25 m", "MSE, m²"], &["F1, 0.5 m"]), "F1 (0.25 m), MSE");
    }

    #[test]
    fn few_scenes_show_nothing() {
        assert!(verdict(&summary(1), "table.md").last().unwrap().starts_with("one scene is too few"));
        let lines = verdict(&summary(3), "table.md");
        let nothing = "no difference to prior beyond chance";
        assert!(lines[..2].iter().all(|line| line.contains(nothing)), "{lines:?}");
        assert!(lines[2].contains("3 scenes are too few"), "{lines:?}");
    }
}
