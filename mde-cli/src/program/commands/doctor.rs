//! `mde doctor`: checks of the machine and of a model.

use crate::config::Preset;
use crate::output::record::versions;
use crate::prior::OpenPrior;
use crate::program::open::prior;
use crate::program::{DoctorArgs, NetworkArgs, columns, line_of, message, visible};
use anyhow::{Result, bail, ensure};
use mde_eval::order_check::{Order, OrderCheck, SIZE};
use mde_eval::scene::{Room, room};
use mde_eval::table::wrapped;
use mde_prior::augment::Plan;
use mde_prior::predict_each;
use std::io::{self, Write};
use std::ops::ControlFlow;
use std::path::Path;
use std::time::Instant;

/// `(height, width)` of the photograph whose cost is stated.
const USUAL: (usize, usize) = (480, 640);

pub(super) fn run(args: &DoctorArgs) -> Result<()> {
    let crates: Vec<String> = versions().iter().map(|(name, version)| format!("{name} {version}")).collect();
    let models = if cfg!(feature = "onnx") { "ONNX files" } else { "none: built without the feature onnx" };
    let cores = std::thread::available_parallelism().map_or_else(|e| e.to_string(), |n| n.to_string());
    print("program", &crates.join(", "));
    print("models", models);
    print("machine", &format!("{} {}, {cores} processors", std::env::consts::OS, std::env::consts::ARCH));
    args.prior_model.as_ref().map_or(Ok(()), |path| model(path, args))
}

/// Times the model with every runtime, and compares its predictions of rooms with their depth.
fn model(path: &Path, args: &DoctorArgs) -> Result<()> {
    let open = |runtime: &str| {
        let (model_profile, runtime) = (args.model_profile.clone(), Some(runtime.to_owned()));
        let format = NetworkArgs { model_profile, prior_kind: args.prior_kind, png_scale: None, runtime };
        prior::network(path, &format)
    };
    let prior = open("tract")?;
    print("model", &line_of(path));
    if let Some(spec) = &prior.origin().model {
        print("profile", &format!("{}x{}, {}", spec.width, spec.height, spec.output));
    }
    time(&prior)?;
    if cfg!(feature = "onnxruntime") {
        let other = args.runtime.as_deref().filter(|runtime| *runtime != "tract").unwrap_or("onnxruntime");
        if let Err(error) = open(other).and_then(|prior| time(&prior)) {
            print("runtime", &message(&error));
        }
    }
    verdict(path, &prior)
}

/// Seconds per prediction and of a run with the preset `default`.
fn time(prior: &OpenPrior<'_>) -> Result<()> {
    let scene = room(Room::Study, 0, SIZE[0], SIZE[1])?;
    // The first prediction may take longer.
    prior.prior().predict(scene.image.view())?;
    let start = Instant::now();
    prior.prior().predict(scene.image.view())?;
    let alone = start.elapsed().as_secs_f64();
    let at_once = prior.prior().concurrency().clamp(1, rayon::current_num_threads());
    let start = Instant::now();
    _ = predict_each(prior.prior(), &vec![scene.image.view(); at_once], None, |_| ControlFlow::Continue(()))?;
    let seconds = start.elapsed().as_secs_f64();
    let usual = Preset::Default.config().augmentation.predictions;
    let predictions = Plan::new(usual, USUAL, prior.prior().resolution(USUAL.0, USUAL.1)).predictions();
    print(
        "runtime",
        &format!(
            "{}: {alone:.3} s for one prediction, {seconds:.3} s for {at_once} at once; for a photograph of {}x{} the preset default needs {predictions} \
             predictions, about {:.1} s",
            prior.origin().runtime.as_deref().unwrap_or("-"),
            USUAL.1,
            USUAL.0,
            (predictions as f64 / at_once as f64).ceil() * seconds
        ),
    );
    Ok(())
}

/// Whether the model's order of depths agrees with that of procedural rooms beyond chance.
fn verdict(path: &Path, prior: &OpenPrior<'_>) -> Result<()> {
    let trial = OrderCheck::new(prior.prior())?;
    for tried in &trial.rooms {
        ensure!(
            tried.missing < 0.5,
            "{}: {:.0} % of its output for {} is no valid depth; check its profile and its weights",
            path.display(),
            100.0 * tried.missing,
            tried.room
        );
    }
    let each: Vec<_> = trial.rooms.iter().map(|tried| format!("{:.2}", tried.correlation)).collect();
    let what = format!("Spearman's correlation with the true depth of {} procedural rooms", each.len());
    print("trial", &format!("{what}: {}", each.join(", ")));
    match trial.order() {
        Order::True => print("verdict", "the model works here"),
        Order::Swapped => bail!(prior.origin().swapped(trial.mean())),
        Order::Chance => bail!(
            "{}: its depth does not agree with the rooms' beyond chance (mean correlation {:.2}); check the profile and the weights",
            path.display(),
            trial.mean()
        ),
    }
    Ok(())
}

/// A closed pipe is no error.
fn print(what: &str, text: &str) {
    let _ = writeln!(io::stdout().lock(), "{}", wrapped(&visible(&format!("{what:8} {text}")), columns(), 9));
}
