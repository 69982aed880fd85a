//! Progress: bars on a terminal, plain lines elsewhere, JSON lines, or nothing.

use crate::args::RunArgs;
use crate::run::interrupt;
use crate::terminal::{columns, shown, wrapped};
use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};
use mde_cli::results::{TrainingCurve, follow};
use mde_cli::{Event, Stage};
use mde_eval::table::Document;
use mde_nerf::FieldEvent;
use serde_json::{Value, json};
use std::io::{self, IsTerminal, Write};
use std::ops::ControlFlow;
use std::time::Instant;

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
    stage: Stage,
    /// Current iteration, from 1, and their number.
    iteration: [usize; 2],
    bar: Option<ProgressBar>,
    /// Tenths of the stage that have been printed.
    tenths: usize,
    warnings: Vec<String>,
    training: Vec<TrainingCurve>,
}

impl Progress {
    pub(crate) fn new(args: &RunArgs) -> Self {
        let mode = match (args.quiet, args.log_json) {
            (true, _) => Mode::Quiet,
            (_, true) => Mode::Json,
            _ if io::stderr().is_terminal() => Mode::Bars,
            _ => Mode::Lines,
        };
        Self { mode, ..Self::silent() }
    }

    /// One that prints nothing and keeps its warnings.
    pub(crate) fn silent() -> Self {
        Self {
            mode: Mode::Quiet,
            start: Instant::now(),
            stage: Stage::Prior,
            iteration: [1, 1],
            bar: None,
            tenths: 0,
            warnings: Vec::new(),
            training: Vec::new(),
        }
    }

    /// Seconds since the program began.
    pub(crate) fn seconds(&self) -> f64 {
        self.start.elapsed().as_secs_f64()
    }

    /// Prints a warning and keeps it for the record.
    pub(crate) fn warn(&mut self, warning: String) {
        match self.mode {
            Mode::Quiet => {}
            Mode::Json => self.json(json!({ "event": "warning", "message": warning })),
            Mode::Lines | Mode::Bars => self.line(&format!("warning: {warning}")),
        }
        self.warnings.push(warning);
    }

    /// Every warning so far.
    pub(crate) fn warnings(&self) -> &[String] {
        &self.warnings
    }

    /// The fits so far, one per iteration.
    pub(crate) fn training(&self) -> &[TrainingCurve] {
        &self.training
    }

    /// Begins another refinement of the same run: its curves are its own.
    pub(crate) fn next(&mut self, what: &str) {
        self.training.clear();
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
        match self.mode {
            Mode::Quiet => {}
            Mode::Json => self.json(value),
            // A closed pipe is no error.
            Mode::Lines | Mode::Bars => {
                drop(writeln!(io::stdout().lock(), "{}", wrapped(text, columns(), 2)))
            }
        }
    }

    /// Tables, and `text` below them, on stdout, or `value` as JSON.
    pub(crate) fn tables(&mut self, tables: &Document, text: &str, value: Value) {
        if matches!(self.mode, Mode::Lines | Mode::Bars) {
            self.finish_bar();
            let _ = writeln!(io::stdout().lock(), "{}\n", shown(tables, columns()));
        }
        self.result(text, value);
    }

    /// The callback of the loop.
    pub(crate) fn observe(&mut self, event: &Event) -> ControlFlow<()> {
        match *event {
            Event::Begin { stage, iteration, iterations } => self.begin(stage, [iteration + 1, iterations]),
            Event::Field { event, view, views } => self.field(&event, view, views),
            Event::Predicted { done, total } => self.predicted(done, total),
            _ => {}
        }
        interrupt::flow()
    }

    fn begin(&mut self, stage: Stage, iteration: [usize; 2]) {
        self.finish_bar();
        (self.stage, self.iteration, self.tenths) = (stage, iteration, 0);
        let [index, all] = iteration;
        match self.mode {
            Mode::Quiet => {}
            Mode::Json => {
                self.json(
                    json!({ "event": "begin", "stage": stage.name(), "iteration": index, "iterations": all }),
                );
            }
            // These two get a bar at their first event.
            Mode::Bars if matches!(stage, Stage::Fit | Stage::Render) => {}
            // The prior's stage comes before the loop.
            Mode::Bars | Mode::Lines if matches!(stage, Stage::Prior | Stage::Merge) => {
                self.line(stage.name())
            }
            Mode::Bars | Mode::Lines => self.line(&format!("iteration {index}/{all}: {}", stage.name())),
        }
    }

    /// A field's own event; `view` of `views` is being rendered.
    pub(crate) fn field(&mut self, event: &FieldEvent, view: usize, views: usize) {
        match *event {
            FieldEvent::Fit { step, steps, loss, psnr } => {
                follow(&mut self.training, self.iteration[0] - 1, event);
                let text = format!("steps, loss {loss:.4}, PSNR {psnr:.1} dB");
                let value =
                    json!({ "event": "fit", "step": step, "steps": steps, "loss": loss, "psnr": psnr });
                self.advance(Stage::Fit, step, steps, &text, value);
            }
            FieldEvent::Render { row, rows } => {
                let text = format!("rows, view {}/{views}", view + 1);
                let value =
                    json!({ "event": "render", "row": row, "rows": rows, "view": view + 1, "views": views });
                self.advance(Stage::Render, view * rows + row, views * rows, &text, value);
            }
            _ => {}
        }
    }

    /// The model finished a prediction.
    fn predicted(&mut self, done: usize, total: usize) {
        let value = json!({ "event": "predicted", "done": done, "total": total });
        self.advance(Stage::Prior, done, total, "predictions of the model", value);
    }

    fn advance(&mut self, stage: Stage, done: usize, all: usize, text: &str, mut value: Value) {
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
                let [index, iterations] = self.iteration;
                let bar = self.bar.get_or_insert_with(|| {
                    let bar = ProgressBar::with_draw_target(Some(all as u64), ProgressDrawTarget::stderr());
                    bar.with_style(style()).with_prefix(match stage {
                        Stage::Prior => "running the model".to_owned(),
                        _ => format!("iteration {index}/{iterations}: {}", stage.name()),
                    })
                });
                bar.set_position(done as u64);
                bar.set_message(text.to_owned());
            }
        }
    }

    /// Reports one finished piece of work; `left` estimates the remaining seconds.
    pub(crate) fn piece(&mut self, done: usize, all: usize, text: &str, left: Option<f64>, mut value: Value) {
        let left_text = left.map(|s| format!(", about {} left", duration(s))).unwrap_or_default();
        match self.mode {
            Mode::Quiet => {}
            Mode::Json => {
                (value["done"], value["all"], value["seconds_left"]) = (json!(done), json!(all), json!(left));
                self.json(value);
            }
            Mode::Lines => self.line(&format!("[{done}/{all}] {text}{left_text}")),
            Mode::Bars => {
                self.line(text);
                let bar = self.bar.get_or_insert_with(|| {
                    let bar = ProgressBar::with_draw_target(Some(all as u64), ProgressDrawTarget::stderr());
                    let template = "{bar:30} {pos}/{len} [{elapsed}{msg}]";
                    bar.with_style(
                        ProgressStyle::with_template(template)
                            .unwrap_or_else(|_| ProgressStyle::default_bar()),
                    )
                });
                bar.set_position(done as u64);
                bar.set_message(left_text);
            }
        }
    }

    fn finish_bar(&mut self) {
        if let Some(bar) = self.bar.take() {
            bar.abandon();
        }
    }

    fn json(&self, mut value: Value) {
        value["seconds"] = json!(self.seconds());
        self.line(&value.to_string());
    }

    fn line(&self, text: &str) {
        let text = match self.mode {
            Mode::Bars => wrapped(text, usize::from(console::Term::stderr().size().1), 2),
            _ => text.to_owned(),
        };
        let write = || drop(writeln!(io::stderr().lock(), "{text}"));
        match &self.bar {
            Some(bar) => bar.suspend(write),
            None => write(),
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

fn style() -> ProgressStyle {
    let columns = usize::from(console::Term::stderr().size().1);
    ProgressStyle::with_template(template(columns)).unwrap_or_else(|_| ProgressStyle::default_bar())
}

/// Template for a line of that width.
fn template(columns: usize) -> &'static str {
    match columns {
        110.. => "{prefix} {bar:30} {pos}/{len} {msg} [{elapsed}, {eta} left]",
        70.. => "{prefix} {wide_bar} {pos}/{len} [{elapsed}, {eta} left]",
        _ => "{prefix} {wide_bar} {percent} %",
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_template_of_every_width_is_valid() {
        for columns in [0, 20, 69, 70, 109, 110, 500] {
            assert!(ProgressStyle::with_template(template(columns)).is_ok(), "{columns}");
        }
        assert!(template(40).len() < template(80).len() && template(80).len() < template(200).len());
    }

    #[test]
    fn durations_have_the_two_largest_units() {
        let texts = [0.4, 59.6, 61.0, 700.0, 7260.0].map(duration);
        assert_eq!(texts, ["0 s", "1 min 0 s", "1 min 1 s", "11 min", "2 h 1 min"]);
    }
}
