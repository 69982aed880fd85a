//! `mde doctor`: checks of the machine and of a model.

use crate::config::Preset;
use crate::prior::OpenPrior;
use crate::program::open::prior;
use crate::program::{DoctorArgs, NetworkArgs, columns, line_of, message, visible};
use anyhow::{Result, bail, ensure};
use mde_eval::order_check::{Order, OrderCheck, SIZE};
use mde_eval::scene::{Room, room};
use mde_eval::table::wrapped;
use mde_prior::augment::Plan;
use mde_prior::{ModelSpec, predict_each};
use std::io::{self, Write};
use std::ops::ControlFlow;
use std::path::Path;
use std::time::Instant;

/// `(height, width)` of the photograph whose cost is stated.
const USUAL: (usize, usize) = (480, 640);

pub(super) fn run(args: &DoctorArgs) -> Result<()> {
    if let Some(path) = &args.prior_model {
        return model(path, args);
    }
    let networks = if cfg!(feature = "onnx") { "ONNX files" } else { "none: built without the feature onnx" };
    let cores = std::thread::available_parallelism().map_or_else(|e| e.to_string(), |n| n.to_string());
    let machine = format!("{} {}, {cores} processors", std::env::consts::OS, std::env::consts::ARCH);
    print("program", &format!("mde {}; {machine}; networks: {networks}", env!("CARGO_PKG_VERSION")));
    Ok(())
}

/// Times the model with every runtime, and compares its predictions of rooms with their depth.
fn model(path: &Path, args: &DoctorArgs) -> Result<()> {
    let open = |runtime: &str| {
        let (model_profile, runtime) = (args.model_profile.clone(), Some(runtime.to_owned()));
        let format = NetworkArgs { model_profile, prior_kind: args.prior_kind, png_scale: None, runtime };
        prior::network(path, &format)
    };
    let prior = open("tract")?;
    let format = |spec: &ModelSpec| format!(": {}x{}, {}", spec.width, spec.height, spec.output);
    let format = prior.origin().model.as_ref().map(format).unwrap_or_default();
    print("network", &(line_of(path) + &format));
    time(&prior)?;
    if cfg!(feature = "onnxruntime") {
        let other = args.runtime.as_deref().filter(|runtime| *runtime != "tract");
        match open(other.unwrap_or("onnxruntime")).and_then(|prior| time(&prior)) {
            Err(error) if other.is_some() => print("runtime", &message(&error)),
            _ => {}
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
    let text = format!(
        "{}: {alone:.3} s a prediction; a photograph of {}x{} takes {predictions} by default, about {:.1} s",
        prior.origin().runtime.as_deref().unwrap_or("-"),
        USUAL.1,
        USUAL.0,
        (predictions as f64 / at_once as f64).ceil() * seconds
    );
    print("runtime", &text);
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
    let what = format!("{what}: {}", each.join(", "));
    match trial.order() {
        Order::True => print("verdict", &format!("works here. {what}")),
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
