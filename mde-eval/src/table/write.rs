use super::{Better, Entry, Group, METRICS, Metric, Statistics, Summary};
use crate::statistics::Estimate;
use crate::{Error, Result};
use std::fmt::Write as _;
use std::io::Write;

/// Writes one row a scene, method and seed: `scene,method,seed,alignment`, then every metric's key; an empty field where there is no value.
///
/// # Errors
/// [`Error::Method`] with what the writer says.
pub fn csv(entries: &[Entry], to: impl Write) -> Result<()> {
    let fault = |error: csv::Error| Error::Method(format!("the scores can't be written: {error}"));
    let mut writer = csv::Writer::from_writer(to);
    writer
        .write_record(
            ["scene", "method", "seed", "alignment"]
                .into_iter()
                .chain(METRICS.iter().map(|metric| metric.key)),
        )
        .map_err(fault)?;
    for entry in entries {
        let values = METRICS.iter().map(|m| m.value(entry).map_or_else(String::new, |v| v.to_string()));
        let Entry { scene, method, seed, alignment, .. } = entry;
        let names = [scene.clone(), method.clone(), seed.to_string(), alignment.clone()];
        writer.write_record(names.into_iter().chain(values)).map_err(fault)?;
    }
    writer.flush().map_err(|error| fault(error.into()))
}

/// The summary as Markdown: for every group of metrics the means with ranks, then the paired differences to the reference with
/// their intervals, bold where the interval leaves 0 out.
pub fn markdown(summary: &Summary) -> String {
    let mut text = String::new();
    for group in Group::ALL {
        let metrics: Vec<&Metric> = METRICS.iter().filter(|m| m.group == group && m.shown).collect();
        let metrics: Vec<&Metric> = metrics
            .into_iter()
            .filter(|m| summary.methods.iter().any(|s| s.metrics.contains_key(m.key)))
            .collect();
        if metrics.is_empty() {
            continue;
        }
        let _ = write!(text, "## {}\n\nMean over scenes{}.\n\n", group.title(), rank_note(group));
        text.push_str(&table(summary, &metrics, |metric, statistics| {
            let rank = statistics.rank.map_or_else(String::new, |rank| format!(" ({rank:.1})"));
            number(statistics.mean, metric) + &rank
        }));
        text.push('\n');
        if group == Group::Edges {
            text.push_str(&pooled(summary));
        }
        let Some(reference) = &summary.reference else { continue };
        if group == Group::Cost || !compared(summary, &metrics) {
            continue;
        }
        let level = 100.0 * summary.bootstrap.level;
        let _ = write!(
            text,
            "Difference to {reference}, scene by scene [{level} % of resampled scenes]; bold where that leaves 0 out and \
             there are {ENOUGH} scenes or more.\n\n"
        );
        text.push_str(&table(summary, &metrics, |metric, s| {
            s.difference.map_or_else(dash, |d| interval(&d, metric, s.paired >= ENOUGH))
        }));
        text.push('\n');
    }
    text.trim_end().to_owned() + "\n"
}

/// F1 of the thinned edges at the threshold that is best for all scenes together.
fn pooled(summary: &Summary) -> String {
    let rows = summary.methods.iter().filter(|method| !method.ods.is_empty());
    let rows: Vec<String> = rows
        .map(|method| {
            let cells = method.ods.values().map(|ods| format!(" {ods:.3} |"));
            format!("| {} |{}", method.method, cells.collect::<String>())
        })
        .collect();
    let Some(first) = summary.methods.iter().find(|method| !method.ods.is_empty()) else {
        return String::new();
    };
    let heads: String =
        first.ods.keys().map(|threshold| format!(" thinned F1 (ODS), {threshold} m ↑ |")).collect();
    let rules = " ---: |".repeat(first.ods.len());
    format!("Pooled over scenes.\n\n| method |{heads}\n| --- |{rules}\n{}\n\n", rows.join("\n"))
}

fn rank_note(group: Group) -> &'static str {
    match group {
        Group::Gradient | Group::Cost => "",
        _ => " (mean rank, 1 is best)",
    }
}

fn compared(summary: &Summary, metrics: &[&Metric]) -> bool {
    let statistics =
        summary.methods.iter().flat_map(|method| metrics.iter().map(|m| method.metrics.get(m.key)));
    statistics.flatten().any(|s| s.difference.is_some())
}

/// Methods down, metrics across; methods without any of them are left out.
fn table(summary: &Summary, metrics: &[&Metric], cell: impl Fn(&Metric, &Statistics) -> String) -> String {
    let arrow = |metric: &Metric| match metric.better {
        Better::Lower => " ↓".to_owned(),
        Better::Higher => " ↑".to_owned(),
        Better::Near(target) => format!(" → {target}"),
        Better::Neither => String::new(),
    };
    let mut lines = vec![
        metrics.iter().fold("| method |".to_owned(), |line, m| format!("{line} {}{} |", m.label, arrow(m))),
        metrics.iter().fold("| --- |".to_owned(), |line, _| line + " ---: |"),
    ];
    for method in &summary.methods {
        let cells: Vec<String> =
            metrics.iter().map(|m| method.metrics.get(m.key).map_or_else(dash, |s| cell(m, s))).collect();
        if cells.iter().any(|cell| *cell != dash()) {
            lines.push(format!("| {} | {} |", method.method, cells.join(" | ")));
        }
    }
    lines.join("\n") + "\n"
}

fn dash() -> String {
    "–".to_owned()
}

/// Scenes from which on an interval is more than the range of a few numbers.
const ENOUGH: usize = 6;

fn interval(estimate: &Estimate, metric: &Metric, enough: bool) -> String {
    let Estimate { value, low, high } = *estimate;
    // All three to the digits of the largest: they are read together.
    let digits = decimals(value.abs().max(low.abs()).max(high.abs()), metric);
    let [value, low, high] = [value, low, high].map(|v| {
        let text = format!("{v:+.digits$}");
        // A sign that no digit bears out.
        if text.chars().any(|c| ('1'..='9').contains(&c)) { text } else { format!("{:.digits$}", 0.0) }
    });
    let value = if enough && estimate.excludes(0.0) { format!("**{value}**") } else { value };
    format!("{value} [{low}, {high}]")
}

fn number(value: f64, metric: &Metric) -> String {
    let digits = decimals(value.abs(), metric);
    format!("{value:.digits$}")
}

/// Decimals for three significant digits, four at most.
fn decimals(magnitude: f64, metric: &Metric) -> usize {
    match (metric.group, magnitude) {
        (_, m) if m >= 100.0 => 0,
        (Group::Cost, _) | (_, 10.0..) => 1,
        (_, 1.0..) => 2,
        (_, 0.05..) => 3,
        _ => 4,
    }
}

#[cfg(test)]
mod tests {
    use super::super::tests::entries;
    use super::*;
    use crate::statistics::Bootstrap;

    #[test]
    fn the_file_has_every_metric_of_every_entry() {
        let entries = entries();
        let mut bytes = Vec::new();
        csv(&entries, &mut bytes).unwrap();
        let mut reader = ::csv::Reader::from_reader(bytes.as_slice());
        let header = reader.headers().unwrap().clone();
        assert_eq!(header.len(), METRICS.len() + 4);
        let column = header.iter().position(|name| name == "mse").unwrap();
        for (row, entry) in reader.records().map(|row| row.unwrap()).zip(&entries) {
            assert_eq!((&row[0], &row[1]), (entry.scene.as_str(), entry.method.as_str()));
            assert_eq!(row[column].parse::<f64>().unwrap(), entry.depth.as_ref().unwrap().mse);
        }
    }

    #[test]
    fn every_table_has_as_many_cells_as_heads() {
        let summary = Summary::new(&entries(), Some("prior"), &Bootstrap::default()).unwrap();
        let text = markdown(&summary);
        for table in text.split("\n\n").filter(|block| block.starts_with('|')) {
            let widths: Vec<usize> = table.lines().map(|line| line.matches('|').count()).collect();
            assert!(widths.windows(2).all(|w| w[0] == w[1]), "{table}");
        }
        assert!(text.contains("## Depth") && text.contains("Difference to prior") && !text.contains("NaN"));
    }
}
