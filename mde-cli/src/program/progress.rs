//! Progress: a line that is drawn again on a terminal, plain lines elsewhere, JSON lines, or nothing.

use crate::output::record::{TrainingCurve, follow};
use crate::program::open::start_threads;
use crate::program::{RunArgs, columns, flags, interrupt, one_line, visible};
use crate::refinement::{Event, Stage};
use crate::refiner::Observer;
use anyhow::Result;
use console::{Term, style, truncate_str};
use mde_eval::table::{Document, wrapped};
use mde_nerf::FieldEvent;
use serde_json::{Value, json};
use std::io::{self, IsTerminal, Write};
use std::ops::ControlFlow;
use std::path::Path;
use std::time::{Duration, Instant};

/// Least time between two drawings of a line.
const REDRAW: Duration = Duration::from_millis(50);
/// Least time between two lines of a stage where there is no terminal.
const LINES: Duration = Duration::from_secs(10);
const WARNING: &str = "warning:";

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Mode {
    Terminal,
    Lines,
    Json,
    Quiet,
}

/// A stage, or the pieces of a run's work.
struct Current {
    name: String,
    start: Instant,
    drawn: Option<Instant>,
    /// What is done of how much, where that is known.
    counts: Option<[usize; 2]>,
    /// When a line of it was last printed.
    printed: Instant,
    /// Whether its line stays on a terminal.
    stays: bool,
}

impl Current {
    fn new(name: String) -> Self {
        let start = Instant::now();
        Self { name, start, drawn: None, counts: None, printed: start, stays: true }
    }

    fn seconds(&self) -> f64 {
        self.start.elapsed().as_secs_f64()
    }

    /// Its name and counts, the time that it has taken, and what is left.
    fn line(&self, left: &str) -> String {
        let counts = self.counts.map(|[done, all]| format!(" {done}/{all}")).unwrap_or_default();
        format!("{}{counts} [{}{left}]", self.name, duration(self.seconds()))
    }
}

impl Drop for Current {
    /// On a terminal its line stays, with the time that it took, but for those of one of many photographs.
    fn drop(&mut self) {
        if self.drawn.is_some() {
            let term = Term::stderr();
            let line = |()| if self.stays { term.write_line(&self.line("")) } else { Ok(()) };
            let _ = term.clear_line().and_then(line);
        }
    }
}

pub(crate) struct Progress {
    mode: Mode,
    start: Instant,
    /// Current iteration, from 1, and their number.
    iteration: [usize; 2],
    current: Option<Current>,
    /// Of the whole run, and of the refinement that it is at.
    pub(crate) warnings: Vec<String>,
    pub(crate) own_warnings: Vec<String>,
    pub(crate) begun: Instant,
    /// Warnings that follow before the result.
    unprinted: Vec<String>,
    /// Whether the run reports pieces of work, each with its warnings.
    in_pieces: bool,
    /// The fits of that refinement so far, one per iteration.
    pub(crate) training: Vec<TrainingCurve>,
}

impl Progress {
    /// Begins a run: starts its threads.
    pub(crate) fn start(args: &RunArgs) -> Result<Self> {
        Self::start_with(args, false)
    }

    /// The same; whether this thread `waits` for work [`side_by_side`](crate::program::side_by_side).
    pub(crate) fn start_with(args: &RunArgs, waits: bool) -> Result<Self> {
        start_threads(args.threads.map(usize::from), waits)?;
        let mode = match (args.quiet, args.log_json) {
            (true, _) => Mode::Quiet,
            (_, true) => Mode::Json,
            _ if io::stderr().is_terminal() => Mode::Terminal,
            _ => Mode::Lines,
        };
        Ok(Self { mode, ..Self::silent() })
    }

    /// One that prints nothing and keeps its warnings.
    pub(crate) fn silent() -> Self {
        let now = Instant::now();
        Self {
            mode: Mode::Quiet,
            start: now,
            iteration: [1, 1],
            current: None,
            warnings: Vec::new(),
            own_warnings: Vec::new(),
            begun: now,
            unprinted: Vec::new(),
            in_pieces: false,
            training: Vec::new(),
        }
    }

    pub(crate) fn seconds(&self) -> f64 {
        self.start.elapsed().as_secs_f64()
    }

    /// As a warning, for a failure that the results list too: a terminal leaves it to them.
    pub(crate) fn failed(&mut self, failure: String) {
        if self.mode == Mode::Terminal {
            self.warnings.push(failure);
        } else {
            self.warn(failure);
        }
    }

    fn print_warnings(&mut self) {
        for warning in std::mem::take(&mut self.unprinted) {
            self.line(&format!("{WARNING} {warning}"));
        }
    }

    /// Begins another refinement of the same run, with estimated seconds `left` for all: its curves, warnings and seconds are its own.
    pub(crate) fn next(&mut self, what: &str, left: Option<f64>) {
        self.training.clear();
        self.own_warnings.clear();
        (self.begun, self.in_pieces, self.current) = (Instant::now(), true, None);
        let value = json!({ "event": "begin", "stage": what, "seconds_left": left });
        self.report(&format!("{what}{}", about(left)), value);
    }

    /// Announces a step outside of the loop.
    pub(crate) fn step(&mut self, what: &str) {
        self.current = None;
        self.report(what, json!({ "event": "begin", "stage": what }));
    }

    /// The results: `tables` and `text` below them on stdout, or `value` as JSON.
    pub(crate) fn result(&mut self, tables: &Document, text: &str, value: Value) {
        self.current = None;
        self.print_warnings();
        if matches!(self.mode, Mode::Quiet | Mode::Json) {
            return self.report("", value);
        }
        // A file gets Markdown.
        let mut shown = match columns() {
            usize::MAX => tables.markdown().trim_end().to_owned(),
            columns => tables.text(columns),
        };
        if !tables.blocks.is_empty() {
            shown += "\n\n";
        }
        // A closed pipe is no error.
        let text = visible(&shown) + &wrapped(&visible(text), columns(), 2);
        let _ = writeln!(io::stdout().lock(), "{text}");
    }

    /// The results of a run that is done: what is in `output`, and where that is.
    pub(crate) fn done(&mut self, tables: &Document, text: &str, output: &Path, mut value: Value) {
        (value["event"], value["output"]) = ("done".into(), output.display().to_string().into());
        self.result(tables, text, value);
    }

    fn begin(&mut self, stage: Stage, iteration: [usize; 2]) {
        self.current = None;
        self.iteration = iteration;
        let [index, all] = iteration;
        // The prior's stages come before the loop.
        let name = match all > 1 && !matches!(stage, Stage::Prior | Stage::Merge) {
            true => format!("iteration {index}/{all}: {}", stage.name()),
            false => stage.name().to_owned(),
        };
        if self.mode == Mode::Json || self.mode == Mode::Lines && !self.in_pieces {
            let value =
                json!({ "event": "begin", "stage": stage.name(), "iteration": index, "iterations": all });
            self.report(&name, value);
        }
        self.current.insert(Current::new(name)).stays = !self.in_pieces;
        self.draw("", None);
    }

    fn advance(&mut self, stage: Stage, counts @ [done, all]: [usize; 2], text: &str, mut value: Value) {
        let current = self.current.get_or_insert_with(|| Current::new(stage.name().to_owned()));
        current.counts = Some(counts);
        let left = current.seconds() * all.saturating_sub(done) as f64 / done.max(1) as f64;
        let due = self.mode == Mode::Lines && !self.in_pieces && current.printed.elapsed() >= LINES;
        if due {
            current.printed = Instant::now();
        }
        if self.mode == Mode::Json || due {
            value["iteration"] = json!(self.iteration[0]);
            self.report(&format!("  {} {done}/{all} {text}", stage.name()), value);
        }
        self.draw(text, Some(left));
    }

    /// Reports a finished piece of work, with estimated seconds `left`. On a terminal only one with an `error` in its `value` leaves a line.
    pub(crate) fn piece(&mut self, done: usize, all: usize, text: &str, left: Option<f64>, mut value: Value) {
        self.in_pieces = true;
        if self.mode == Mode::Terminal {
            if value["error"].is_string() {
                self.line(text);
            }
            self.current.get_or_insert_with(|| Current::new("done".to_owned())).counts = Some([done, all]);
            self.draw(text, left);
        } else {
            (value["done"], value["all"], value["seconds_left"]) = (json!(done), json!(all), json!(left));
            self.report(&format!("[{done}/{all}] {text}{}", about(left)), value);
        }
        self.print_warnings();
    }

    /// Draws the line of the terminal again, with the estimated seconds that are left, cut to the terminal's width.
    fn draw(&mut self, text: &str, left: Option<f64>) {
        let Some(current) = self.current.as_mut().filter(|_| self.mode == Mode::Terminal) else { return };
        if current.drawn.is_some_and(|drawn| drawn.elapsed() < REDRAW) {
            return;
        }
        current.drawn = Some(Instant::now());
        let left = left.map(|s| format!(", {} left", duration(s))).unwrap_or_default();
        let line = one_line(&format!("{} {text}", current.line(&left)));
        let shown = style(truncate_str(&line, terminal_columns().saturating_sub(1), "")).for_stderr().cyan();
        let term = Term::stderr();
        let _ = term.clear_line().and_then(|()| term.write_str(&shown.to_string()));
    }

    /// A line, or `value` as JSON.
    fn report(&self, text: &str, mut value: Value) {
        match self.mode {
            Mode::Quiet => {}
            Mode::Json => {
                value["seconds"] = json!(self.seconds());
                self.line(&value.to_string());
            }
            Mode::Lines | Mode::Terminal => self.line(text),
        }
    }

    /// A line of its own, in the place of the terminal's current one, which is drawn again.
    fn line(&self, text: &str) {
        let mut text = one_line(text);
        if self.mode == Mode::Terminal {
            text = wrapped(&text, terminal_columns(), 2);
            if let Some(rest) = text.strip_prefix(WARNING) {
                text = format!("{}{rest}", style(WARNING).for_stderr().yellow().bold());
            }
            if self.current.is_some() {
                let _ = Term::stderr().clear_line();
            }
        }
        let _ = writeln!(io::stderr().lock(), "{text}");
    }
}

impl Observer for Progress {
    fn event(&mut self, event: &Event) -> ControlFlow<()> {
        let (stage, counts, text, value) = match *event {
            Event::Begin { stage, iteration, iterations } => {
                self.begin(stage, [iteration + 1, iterations]);
                return interrupt::flow();
            }
            Event::Field { event: ref fit @ FieldEvent::Fit { step, steps, loss, psnr }, .. } => {
                follow(&mut self.training, self.iteration[0] - 1, fit);
                let value =
                    json!({ "event": "fit", "step": step, "steps": steps, "loss": loss, "psnr": psnr });
                (Stage::Fit, [step, steps], format!("steps, loss {loss:.4}, PSNR {psnr:.1} dB"), value)
            }
            Event::Field { event: FieldEvent::Render { row, rows }, view, views } => {
                let value =
                    json!({ "event": "render", "row": row, "rows": rows, "view": view + 1, "views": views });
                let counts = [view * rows + row, views * rows];
                (Stage::Render, counts, format!("rows, view {}/{views}", view + 1), value)
            }
            Event::Field { .. } => return interrupt::flow(),
            Event::Part { stage, done, total } => {
                let what = match stage {
                    Stage::Prior => "predictions of the model",
                    Stage::Poses => "pairs of photographs",
                    _ => "photographs",
                };
                let value = json!({ "event": stage.name(), "done": done, "total": total });
                (stage, [done, total], what.to_owned(), value)
            }
        };
        self.advance(stage, counts, &text, value);
        interrupt::flow()
    }

    /// Keeps a warning for the record, and prints it before the result, or at once between pieces of work. A run that fails prints
    /// its error alone. One that was there before is not repeated.
    fn warn(&mut self, warning: String) {
        let warning = flags(&warning);
        if !self.own_warnings.contains(&warning) {
            self.own_warnings.push(warning.clone());
        }
        if self.warnings.contains(&warning) {
            return;
        }
        match self.mode {
            Mode::Quiet => {}
            Mode::Json => self.report("", json!({ "event": "warning", "message": warning })),
            Mode::Lines | Mode::Terminal => self.unprinted.push(warning.clone()),
        }
        self.warnings.push(warning);
        if self.in_pieces {
            self.print_warnings();
        }
    }
}

fn about(left: Option<f64>) -> String {
    left.map(|s| format!(", about {} left", duration(s))).unwrap_or_default()
}

/// A duration in its two largest units.
fn duration(seconds: f64) -> String {
    let whole = seconds.round().max(0.0) as u64;
    match (whole / 3600, whole / 60 % 60, whole % 60) {
        (0, 0, s) => format!("{s} s"),
        (0, m, s) if m < 10 => format!("{m} min {s} s"),
        (0, m, _) => format!("{m} min"),
        (h, m, _) => format!("{h} h {m} min"),
    }
}

fn terminal_columns() -> usize {
    usize::from(Term::stderr().size().1)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_refinement_of_a_run_has_its_own_warnings() {
        let mut progress = Progress::silent();
        progress.warn("of the capture".to_owned());
        for (name, warning) in [("a.png", "resized"), ("b.png", "resized"), ("c.png", "no pose")] {
            progress.next(name, None);
            progress.warn(warning.to_owned());
            assert_eq!(progress.own_warnings, [warning], "{name}");
        }
        assert_eq!(progress.warnings, ["of the capture", "resized", "no pose"]);
    }

    #[test]
    fn durations_have_the_two_largest_units() {
        let texts = [0.4, 59.6, 61.0, 700.0, 7260.0].map(duration);
        assert_eq!(texts, ["0 s", "1 min 0 s", "1 min 1 s", "11 min", "2 h 1 min"]);
    }
}
