//! `mde calibrate`.

use crate::program::args::{CalibrateArgs, CaptureArgs};
use crate::program::evaluation::method::{Method, PRIOR};
use crate::program::evaluation::results;
use crate::program::evaluation::runner::{Evaluation, Request};
use crate::program::progress::Progress;
use crate::refiner::calibration::fingerprint;
use anyhow::{Context, Result, bail, ensure};
use mde_uncertainty::calibration::{Calibration, CalibrationSource};

/// The calibration file in the folder of the evaluation.
const FILE: &str = "calibration.toml";

pub(super) fn run(args: &CalibrateArgs) -> Result<()> {
    let mut progress = Progress::start(&args.common.run)?;
    let methods = Method::parse_list(std::slice::from_ref(&args.method), None)?;
    let own = |m: &Method| Some((m.label.clone(), m.config()?.clone(), m.is_of_photographs()));
    let Some((name, config, several)) = methods.last().and_then(own) else {
        bail!("--method {}: has no sigma of its own; give a preset or settings in a .toml file", args.method);
    };
    let request = Request {
        command: "eval",
        methods: &methods,
        several: CaptureArgs { grid: None, withhold: args.withhold },
        ..Request::default()
    };
    let evaluation = Evaluation::open(&args.common, request)?;
    let (entries, failures) = evaluation.run(&mut progress)?;
    let scenes: Vec<_> = entries
        .iter()
        .filter(|entry| entry.method == name)
        .filter_map(|entry| Some((entry.scene.clone(), entry.curves.as_ref()?.abs_z_quantiles.clone())))
        .collect();
    let own = entries.iter().filter(|entry| entry.method == name && entry.curves.is_some());
    let scales: Vec<f64> = own.filter_map(|entry| entry.values.get("alignment_scale").copied()).collect();
    let (data, prior, alignment) = (
        evaluation.source.title.clone(),
        evaluation.prior.title.clone(),
        evaluation.scoring.alignment_note(),
    );
    let path = evaluation.store.root.join(FILE);
    let calibrated = !scenes.is_empty();
    if calibrated {
        let source = CalibrationSource { method: name, data, prior, alignment };
        let (prior, hash) = (&evaluation.prior, evaluation.prior.model_hash());
        let made_for = fingerprint(&config, prior.accepts_new_images(), several, hash)?;
        let mut calibration = Calibration::fit(source, made_for, scenes)?;
        if prior.is_metric() {
            calibration = calibration.with_scales(&scales);
        }
        mde_prior::write_atomic(&path, calibration.to_toml()?.as_bytes())
            .with_context(|| path.display().to_string())?;
        let factor = calibration.intervals()?.factor(Calibration::AT)?;
        progress.step(&format!("{}: sigma times {factor:.3}", path.display()));
        if let Some(error) = calibration.scale_error() {
            progress.step(&format!("  scale of the whole map: +-{:.1} % beside sigma", 100.0 * error));
        }
        for held in calibration.held_out() {
            progress.step(&format!(
                "  {:.0} % intervals: mean coverage {:.1} % on held-out scenes ({:.0} to {:.0} %)",
                100.0 * held.probability,
                100.0 * held.mean,
                100.0 * held.lowest,
                100.0 * held.highest
            ));
        }
    } else if path.exists() {
        // That of an earlier run is of other scores than the new tables.
        std::fs::remove_file(&path).with_context(|| path.display().to_string())?;
    }
    results::finish(evaluation.results(PRIOR, entries, failures), &evaluation.store, &mut progress)?;
    ensure!(calibrated, "no scene has a sigma, so there is nothing to calibrate");
    Ok(())
}
