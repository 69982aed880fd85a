//! `mde eval`, `mde ablate` and `mde calibrate`.

use crate::config::Config;
use crate::program::evaluation::ablation::FULL;
use crate::program::evaluation::{Evaluation, Method, PRIOR, Request, ablation, results};
use crate::program::open::overridden;
use crate::program::{AblateArgs, CalibrateArgs, CaptureArgs, EvalArgs, Progress};
use crate::refiner::calibration::fingerprint;
use anyhow::{Context, Result, bail, ensure};
use mde_eval::statistics::Bootstrap;
use mde_eval::table::Summary;
use mde_uncertainty::calibration::{Calibration, CalibrationSource};
use serde_json::json;

const CALIBRATION: &str = "calibration.toml";

pub(super) fn eval(args: &EvalArgs) -> Result<()> {
    let mut progress = Progress::start_with(&args.common.run, true)?;
    let methods = Method::parse_list(&args.methods, args.seed)?;
    let request = Request {
        command: "eval",
        methods: &methods,
        shard: args.shard,
        several: args.several.clone(),
        pixels: args.pixels,
        share_fields: false,
    };
    let evaluation = Evaluation::open(&args.common, request)?;
    let (entries, failures) = evaluation.run(&mut progress)?;
    if args.shard.is_some() {
        let scenes = [evaluation.scenes.len(), evaluation.all];
        return results::finish_part(scenes, &failures, &evaluation.store.root, &mut progress);
    }
    results::finish(evaluation.results(PRIOR, entries, failures), &evaluation.store, &mut progress)
}

pub(super) fn ablate(args: &AblateArgs) -> Result<()> {
    let mut progress = Progress::start_with(&args.common.run, true)?;
    let base = overridden(args.preset, &args.config)?;
    let methods = variants(args, &base)?;
    let request = Request { command: "ablate", methods: &methods, share_fields: true, ..Request::default() };
    let evaluation = Evaluation::open(&args.common, request)?;
    let (mut entries, failures) = evaluation.run(&mut progress)?;
    // Rows share fields, so their seconds would mislead.
    for entry in &mut entries {
        entry.values.remove("seconds");
    }
    let preface = if entries.is_empty() {
        Vec::new()
    } else {
        let compared = |with| Summary::new(&entries, Some(with), &Bootstrap::default());
        ablation::table(&compared(FULL)?, &compared(PRIOR)?)
    };
    let mut results = evaluation.results(FULL, entries, failures);
    results.title.insert_str(0, "Ablation: ");
    results.preface = preface;
    results.record["seeds"] = json!(args.seeds);
    results.record["preset"] = json!(args.preset.name());
    results.record["config"] = json!(base);
    results::finish(results, &evaluation.store, &mut progress)
}

/// The prior, then every row with every seed.
fn variants(args: &AblateArgs, base: &Config) -> Result<Vec<Method>> {
    ensure!(
        base.refinement.fits_a_field(),
        "--preset {}: fits no field to a photograph, so all rows are equal; give --preset paper",
        args.preset.name()
    );
    let known: Vec<&str> = ablation::rows(base).map(|row| row.name).collect();
    for name in &args.rows {
        ensure!(
            known.contains(&name.as_str()),
            "--rows {name}: no such row; use some of {}",
            known.join(", ")
        );
    }
    let is_wanted = |row| args.rows.is_empty() || row == FULL || args.rows.iter().any(|name| name == row);
    let mut methods = vec![Method::parse(PRIOR, Some(base.seed))?];
    for seed in (0..u64::from(args.seeds)).map(|more| base.seed.wrapping_add(more)) {
        let chosen = ablation::rows(base).filter(|row| is_wanted(row.name));
        methods.extend(chosen.map(|row| Method::variant(row.name, row.config(base), row.control(), seed)));
    }
    Ok(methods)
}

pub(super) fn calibrate(args: &CalibrateArgs) -> Result<()> {
    let mut progress = Progress::start_with(&args.common.run, true)?;
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
    let (mut scenes, mut scales) = (Vec::new(), Vec::new());
    for entry in entries.iter().filter(|entry| entry.method == name) {
        let Some(curves) = &entry.curves else { continue };
        scenes.push((entry.scene.clone(), curves.abs_z_quantiles.clone()));
        scales.extend(entry.values.get("alignment_scale"));
    }
    let path = evaluation.store.root.join(CALIBRATION);
    let calibrated = !scenes.is_empty();
    if calibrated {
        let (prior, hash) = (&evaluation.prior, evaluation.prior.model_hash());
        let (data, alignment) = (evaluation.source.title.clone(), evaluation.scoring.alignment_note());
        let source = CalibrationSource { method: name, data, prior: prior.title.clone(), alignment };
        let made_for = fingerprint(&config, prior.accepts_new_images(), several, hash)?;
        let mut calibration = Calibration::fit(source, made_for, scenes)?;
        if prior.is_metric() {
            calibration = calibration.with_scales(&scales);
        }
        mde_prior::write_atomic(&path, calibration.to_toml()?.as_bytes())
            .with_context(|| path.display().to_string())?;
        let factor = calibration.intervals()?.factor(Calibration::AT)?;
        progress.step(&format!("{}: sigma times {factor:.3}", path.display()));
        if let Some(error) = calibration.scale_error {
            progress.step(&format!("  scale of the whole map: +-{:.1} % beside sigma", 100.0 * error));
        }
        for held in &calibration.held_out {
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
