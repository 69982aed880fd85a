//! Progress: bars on a terminal, plain lines elsewhere, JSON lines, or nothing.

use crate::output::record::{TrainingCurve, follow};
use crate::program::args::RunArgs;
use crate::program::error::flags;
use crate::program::interrupt;
use crate::program::open::settings::start_threads;
use crate::program::terminal::{columns, shown, visible, wrapped};
use crate::refinement::event::{Event, Stage};
use crate::refiner::Observer;
use anyhow::Result;
use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};
use mde_eval::table::Document;
use mde_nerf::FieldEvent;
use serde_json::{Value, json};
use std::io::{self, IsTerminal, Write};
use std::ops::ControlFlow;
use std::thread;
use std::time::{Duration, Instant};

/// Time between two redraws of a stage that reports no progress of its own.
const TICK: Duration = Duration::from_millis(200);

/// Begins the line of a warning.
const WARNING: &str = "warning:";

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Mode {
    Bars,
    Lines,
    Json,
    Quiet,
}

/// Progress of a run.
#[derive(Debug)]
pub(crate) struct Progress {
    mode: Mode,
    start: Instant,
    /// Current iteration, from 1, and their number.
    iteration: [usize; 2],
    bar: Option<ProgressBar>,
    /// Tenths of the stage that have been printed.
    tenths: usize,
    /// Of the whole run, and of the refinement that it is at.
    warnings: Vec<String>,
    own_warnings: Vec<String>,
    /// When that refinement began.
    begun: Instant,
    /// Warnings that have been printed; the others follow before the result.
    printed: usize,
    /// Whether the run reports pieces of work, each with its warnings.
    in_pieces: bool,
    training: Vec<TrainingCurve>,
}

impl Progress {
    /// Begins a run: starts its threads.
    pub(crate) fn start(args: &RunArgs) -> Result<Self> {
        start_threads(args.threads.map(usize::from))?;
        let mode = match (args.quiet, args.log_json) {
            (true, _) => Mode::Quiet,
            (_, true) => Mode::Json,
            _ if io::stderr().is_terminal() => Mode::Bars,
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
            bar: None,
            tenths: 0,
            warnings: Vec::new(),
            own_warnings: Vec::new(),
            begun: now,
            printed: 0,
            in_pieces: false,
            training: Vec::new(),
        }
    }

    /// Seconds since the program began.
    pub(crate) fn seconds(&self) -> f64 {
        self.start.elapsed().as_secs_f64()
    }

    /// As a warning, for a failure that the results list too: a terminal leaves it to them.
    pub(crate) fn failed(&mut self, failure: String) {
        if self.mode == Mode::Bars {
            self.print_warnings();
            self.warnings.push(failure);
            self.printed = self.warnings.len();
        } else {
            self.warn(failure);
        }
    }

    fn print_warnings(&mut self) {
        if matches!(self.mode, Mode::Lines | Mode::Bars) {
            let new = self.warnings.iter().skip(self.printed);
            new.for_each(|warning| self.line(&format!("{WARNING} {warning}")));
        }
        self.printed = self.warnings.len();
    }

    /// Every warning so far.
    pub(crate) fn all_warnings(&self) -> &[String] {
        &self.warnings
    }

    /// The warnings of the refinement that the run is at.
    pub(crate) fn own_warnings(&self) -> &[String] {
        &self.own_warnings
    }

    /// Seconds since that refinement began.
    pub(crate) fn own_seconds(&self) -> f64 {
        self.begun.elapsed().as_secs_f64()
    }

    /// The fits so far, one per iteration.
    pub(crate) fn training(&self) -> &[TrainingCurve] {
        &self.training
    }

    /// Begins another refinement of the same run: its curves, warnings and seconds are its own.
    pub(crate) fn next(&mut self, what: &str) {
        self.training.clear();
        self.own_warnings.clear();
        self.begun = Instant::now();
        self.step(what);
    }

    /// Announces a step outside of the loop.
    pub(crate) fn step(&mut self, what: &str) {
        self.finish_bar();
        match self.mode {
            Mode::Quiet => {}
            Mode::Json => self.json(json!({ "event": "begin", "stage": what })),
            Mode::Lines | Mode::Bars => self.line(what),
        }
    }

    /// The results: `text` on stdout, or `value` as JSON.
    pub(crate) fn result(&mut self, text: &str, value: Value) {
        self.finish_bar();
        self.print_warnings();
        match self.mode {
            Mode::Quiet => {}
            Mode::Json => self.json(value),
            // A closed pipe is no error.
            Mode::Lines | Mode::Bars => {
                drop(writeln!(io::stdout().lock(), "{}", wrapped(&visible(text), columns(), 2)))
            }
        }
    }

    /// Tables, and `text` below them, on stdout, or `value` as JSON.
    pub(crate) fn tables(&mut self, tables: &Document, text: &str, value: Value) {
        if matches!(self.mode, Mode::Lines | Mode::Bars) {
            self.finish_bar();
            self.print_warnings();
            if !tables.blocks.is_empty() {
                let _ = writeln!(io::stdout().lock(), "{}\n", visible(&shown(tables, columns())));
            }
        }
        self.result(text, value);
    }

    fn begin(&mut self, stage: Stage, iteration: [usize; 2]) {
        self.finish_bar();
        (self.iteration, self.tenths) = (iteration, 0);
        let [index, all] = iteration;
        match self.mode {
            Mode::Quiet => {}
            Mode::Json => {
                self.json(
                    json!({ "event": "begin", "stage": stage.name(), "iteration": index, "iterations": all }),
                );
            }
            Mode::Bars => self.bar = Some(self.spinner(stage)),
            Mode::Lines => self.line(&self.named(stage)),
        }
    }

    /// The name of a stage, with its iteration where there are several. The prior's stages come before the loop.
    fn named(&self, stage: Stage) -> String {
        match self.iteration {
            [index, all] if all > 1 && !matches!(stage, Stage::Prior | Stage::Merge) => {
                format!("iteration {index}/{all}: {}", stage.name())
            }
            _ => stage.name().to_owned(),
        }
    }

    /// A bar without length, which shows the time until the stage's first event.
    fn spinner(&self, stage: Stage) -> ProgressBar {
        let bar = ProgressBar::with_draw_target(None, ProgressDrawTarget::stderr());
        let bar = bar.with_style(style("{prefix} {spinner:.cyan} {elapsed}")).with_prefix(self.named(stage));
        bar.tick();
        // Ends with the bar. Where the system has no thread left, the time stands still.
        let weak = bar.downgrade();
        let tick = move || {
            while let Some(bar) = weak.upgrade().filter(|bar| !bar.is_finished()) {
                bar.tick();
                drop(bar);
                thread::sleep(TICK);
            }
        };
        drop(thread::Builder::new().spawn(tick));
        bar
    }

    fn advance(&mut self, stage: Stage, [done, all]: [usize; 2], text: &str, mut value: Value) {
        match self.mode {
            Mode::Quiet => {}
            Mode::Json => {
                value["iteration"] = json!(self.iteration[0]);
                self.json(value);
            }
            Mode::Lines => {
                let tenths = 10 * done / all.max(1);
                if tenths > self.tenths {
                    self.tenths = tenths;
                    self.line(&format!("  {} {done}/{all} {text}", stage.name()));
                }
            }
            Mode::Bars => {
                let bar = self.bar.take();
                let bar = bar.unwrap_or_else(|| self.spinner(stage));
                if bar.length().is_none() {
                    bar.set_style(style(template(terminal_columns())));
                }
                bar.set_length(all as u64);
                bar.set_position(done as u64);
                bar.set_message(text.to_owned());
                self.bar = Some(bar);
            }
        }
    }

    /// Reports one finished piece of work; `left` estimates the remaining seconds. On a terminal the bar names the last one, and only a piece
    /// with an `error` in its `value` leaves a line.
    pub(crate) fn piece(&mut self, done: usize, all: usize, text: &str, left: Option<f64>, mut value: Value) {
        self.in_pieces = true;
        let left_text = left.map(|s| format!(", about {} left", duration(s))).unwrap_or_default();
        match self.mode {
            Mode::Quiet => {}
            Mode::Json => {
                (value["done"], value["all"], value["seconds_left"]) = (json!(done), json!(all), json!(left));
                self.json(value);
            }
            Mode::Lines => self.line(&format!("[{done}/{all}] {text}{left_text}")),
            Mode::Bars => {
                if value["error"].is_string() {
                    self.line(text);
                }
                let bar = self.bar.get_or_insert_with(|| {
                    let bar = ProgressBar::with_draw_target(Some(all as u64), ProgressDrawTarget::stderr());
                    bar.with_style(style(PIECES))
                });
                bar.set_position(done as u64);
                bar.set_prefix(left_text);
                bar.set_message(text.to_owned());
            }
        }
        self.print_warnings();
    }

    /// Leaves the line of the bar, with the time that it took.
    fn finish_bar(&mut self) {
        let Some(bar) = self.bar.take() else { return };
        bar.set_message(String::new());
        if bar.length().is_none() {
            let seconds = bar.elapsed().as_secs_f64();
            bar.set_style(style("{prefix} [{msg}]"));
            bar.set_message(duration(seconds));
        } else if self.in_pieces {
            bar.set_prefix(String::new());
        } else {
            bar.set_style(style(FINISHED));
        }
        bar.abandon();
    }

    fn json(&self, mut value: Value) {
        value["seconds"] = json!(self.seconds());
        self.line(&value.to_string());
    }

    fn line(&self, text: &str) {
        let text = &visible(text).replace('\n', "\\n");
        let text = match self.mode {
            Mode::Bars => coloured(&wrapped(text, terminal_columns(), 2)),
            _ => text.to_owned(),
        };
        let write = || drop(writeln!(io::stderr().lock(), "{text}"));
        match &self.bar {
            Some(bar) => bar.suspend(write),
            None => write(),
        }
    }
}

impl Observer for Progress {
    fn event(&mut self, event: &Event) -> ControlFlow<()> {
        match *event {
            Event::Begin { stage, iteration, iterations } => self.begin(stage, [iteration + 1, iterations]),
            Event::Field { event: ref fit @ FieldEvent::Fit { step, steps, loss, psnr }, .. } => {
                follow(&mut self.training, self.iteration[0] - 1, fit);
                let text = format!("steps, loss {loss:.4}, PSNR {psnr:.1} dB");
                let value =
                    json!({ "event": "fit", "step": step, "steps": steps, "loss": loss, "psnr": psnr });
                self.advance(Stage::Fit, [step, steps], &text, value);
            }
            Event::Field { event: FieldEvent::Render { row, rows }, view, views } => {
                let text = format!("rows, view {}/{views}", view + 1);
                let value =
                    json!({ "event": "render", "row": row, "rows": rows, "view": view + 1, "views": views });
                self.advance(Stage::Render, [view * rows + row, views * rows], &text, value);
            }
            Event::Field { .. } => {}
            Event::Predicted { done, total } => {
                let value = json!({ "event": "predicted", "done": done, "total": total });
                self.advance(Stage::Prior, [done, total], "predictions of the model", value);
            }
            Event::Part { stage, done, total } => {
                let what = if stage == Stage::Poses { "pairs of photographs" } else { "photographs" };
                let value = json!({ "event": stage.name(), "done": done, "total": total });
                self.advance(stage, [done, total], what, value);
            }
        }
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
        if self.mode == Mode::Json {
            self.json(json!({ "event": "warning", "message": warning }));
        }
        self.warnings.push(warning);
        if self.in_pieces {
            self.print_warnings();
        }
    }
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

fn style(template: &str) -> ProgressStyle {
    ProgressStyle::with_template(template).unwrap_or_else(|_| ProgressStyle::default_bar())
}

/// A line whose `warning:` has a colour, on a terminal that shows colours and without `NO_COLOR`.
fn coloured(line: &str) -> String {
    match line.strip_prefix(WARNING) {
        Some(rest) => format!("{}{rest}", console::style(WARNING).for_stderr().yellow().bold()),
        None => line.to_owned(),
    }
}

fn terminal_columns() -> usize {
    usize::from(console::Term::stderr().size().1)
}

/// Template of pieces of work: the prefix is the remaining time, the message the last piece, cut to the line.
const PIECES: &str = "{bar:20.cyan/dim} {pos}/{len} [{elapsed}{prefix}] {wide_msg}";

/// Template of a stage; only a wide terminal has the place for its message.
fn template(columns: usize) -> &'static str {
    match columns {
        110.. => "{prefix} {bar:30.cyan/dim} {pos}/{len} {msg} [{elapsed}, {eta} left]",
        _ => "{prefix} {wide_bar:.cyan/dim} {pos}/{len} [{elapsed}, {eta} left]",
    }
}

/// Template of a stage that has ended.
const FINISHED: &str = "{prefix} {wide_bar:.cyan/dim} {pos}/{len} [{elapsed}]";

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_refinement_of_a_run_has_its_own_warnings() {
        let mut progress = Progress::silent();
        progress.warn("of the capture".to_owned());
        for (name, warning) in [("a.png", "resized"), ("b.png", "resized"), ("c.png", "no pose")] {
            progress.next(name);
            progress.warn(warning.to_owned());
            assert_eq!(progress.own_warnings(), [warning], "{name}");
        }
        assert_eq!(progress.all_warnings(), ["of the capture", "resized", "no pose"]);
    }

    #[test]
    fn the_templates_are_valid() {
        for text in [template(80), template(110), FINISHED, PIECES] {
            assert!(ProgressStyle::with_template(text).is_ok(), "{text}");
        }
    }

    #[test]
    fn durations_have_the_two_largest_units() {
        let texts = [0.4, 59.6, 61.0, 700.0, 7260.0].map(duration);
        assert_eq!(texts, ["0 s", "1 min 0 s", "1 min 1 s", "11 min", "2 h 1 min"]);
    }
}
