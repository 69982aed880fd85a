use super::document::{Block, Document, Table};
use super::{Statistics, Summary};
use crate::score::{Better, Group, METRICS, Metric};
use crate::statistics::Estimate;

/// The summary as a document: for every group of metrics the means with ranks, then the paired differences to the reference
/// with their intervals, strong where the interval excludes 0.
pub fn document(summary: &Summary) -> Document {
    let mut blocks = Vec::new();
    for group in Group::ALL {
        let known = |m: &&Metric| summary.methods.iter().any(|s| s.metrics.contains_key(m.key));
        let metrics: Vec<&Metric> =
            METRICS.iter().filter(|m| m.group == group && m.shown).filter(known).collect();
        if metrics.is_empty() {
            continue;
        }
        blocks.push(Block::Heading(2, group.title().to_owned()));
        let rank =
            if matches!(group, Group::Gradient | Group::Cost) { "" } else { " (mean rank, 1 is best)" };
        blocks.push(Block::Text(format!("Mean over scenes{rank}.")));
        blocks.push(table(summary, &metrics, |metric, statistics| {
            let rank = statistics.rank.map_or_else(String::new, |rank| format!(" ({rank:.1})"));
            let mean = statistics.mean;
            format!("{mean:.*}{rank}", decimals(mean.abs(), metric))
        }));
        let Some(reference) = &summary.reference else { continue };
        let of = |m: &&Metric| {
            summary.methods.iter().filter_map(|s| s.metrics.get(m.key)).any(|s| s.difference.is_some())
        };
        if group == Group::Cost || !metrics.iter().any(of) {
            continue;
        }
        let level = 100.0 * summary.bootstrap.level;
        let sample = if summary.places < summary.scenes { "places" } else { "scenes" };
        blocks.push(Block::Text(format!(
            "Difference to {reference}, scene by scene [{level} % of resampled {sample}]; bold where the interval excludes 0 \
             and there are {ENOUGH} {sample} or more."
        )));
        blocks.push(table(summary, &metrics, |metric, s| {
            s.difference.map_or_else(|| DASH.to_owned(), |d| interval(&d, metric, s.places >= ENOUGH))
        }));
    }
    Document { blocks }
}

/// Methods down, metrics across; methods without any of them are left out.
fn table(summary: &Summary, metrics: &[&Metric], cell: impl Fn(&Metric, &Statistics) -> String) -> Block {
    let arrow = |metric: &Metric| match metric.better {
        Better::Lower => " ↓".to_owned(),
        Better::Higher => " ↑".to_owned(),
        Better::Near(target) => format!(" → {target}"),
        Better::Neither => String::new(),
    };
    let heads = metrics.iter().map(|m| format!("{}{}", m.label, arrow(m)));
    let heads = std::iter::once("method".to_owned()).chain(heads);
    let mut rows = Vec::new();
    for method in &summary.methods {
        let found = |m: &&Metric| method.metrics.get(m.key).map_or_else(|| DASH.to_owned(), |s| cell(m, s));
        let cells: Vec<String> = metrics.iter().map(found).collect();
        if cells.iter().any(|cell| cell != DASH) {
            rows.push(std::iter::once(method.method.clone()).chain(cells).collect());
        }
    }
    Block::Table(Table::new(1, heads, rows))
}

/// No value.
const DASH: &str = "–";

/// Places from which on an interval is more than the range of a few numbers.
pub(super) const ENOUGH: usize = 6;

fn interval(estimate: &Estimate, metric: &Metric, enough: bool) -> String {
    let Estimate { value, low, high } = *estimate;
    // All three to the digits of the largest: they are read together.
    let digits = decimals(value.abs().max(low.abs()).max(high.abs()), metric);
    let [value, low, high] = [value, low, high].map(|v| {
        let text = format!("{v:+.digits$}");
        // A sign that no digit bears out.
        if text.chars().any(|c| ('1'..='9').contains(&c)) { text } else { format!("{:.digits$}", 0.0) }
    });
    let strong = if enough && estimate.excludes(0.0) { "**" } else { "" };
    format!("{strong}{value}{strong} [{low}, {high}]")
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
    use super::super::tests::{entries, entries_of};
    use super::*;
    use crate::statistics::Bootstrap;

    #[test]
    fn every_table_has_as_many_cells_as_heads() {
        let summary = Summary::new(&entries(), Some("prior"), &Bootstrap::default()).unwrap();
        let document = document(&summary);
        let tables: Vec<&Table> = document
            .blocks
            .iter()
            .filter_map(|block| if let Block::Table(table) = block { Some(table) } else { None })
            .collect();
        assert!(tables.len() > 8, "{}", tables.len());
        for table in &tables {
            assert!(!table.rows.is_empty());
            assert!(table.rows.iter().all(|row| row.len() == table.heads.len()), "{table:?}");
        }
        let text = document.markdown();
        assert!(text.contains("## Depth") && text.contains("Difference to prior") && !text.contains("NaN"));
        assert_eq!(text.lines().filter(|line| line.starts_with("| ---")).count(), tables.len());
    }

    #[test]
    fn few_places_make_nothing_bold() {
        let draws = Bootstrap { draws: 1000, ..Bootstrap::default() };
        let spread = |places: usize| {
            let mut entries = entries_of(8, &[("prior", 0.2), ("better", 0.1)], true);
            for (scene, of_scene) in entries.chunks_mut(2).enumerate() {
                of_scene.iter_mut().for_each(|entry| entry.place = Some(format!("room {}", scene % places)));
            }
            let summary = Summary::new(&entries, Some("prior"), &draws).unwrap();
            assert_eq!((summary.scenes, summary.places), (8, places));
            document(&summary).markdown()
        };
        let (few, many) = (spread(5), spread(8));
        assert!(!few.contains("**") && few.contains("% of resampled places"));
        assert!(many.contains("**") && many.contains("% of resampled scenes"));
    }
}
