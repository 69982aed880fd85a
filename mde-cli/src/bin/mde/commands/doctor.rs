//! `mde doctor`: checks of the machine and of a model.

use crate::args::{DoctorArgs, EncodingName, PriorArgs, PriorSource};
use crate::input::prior::NamedPrior;
use crate::output::provenance::versions;
use crate::terminal::{columns, wrapped};
use anyhow::{Context, Result, ensure};
use mde_cli::Preset;
use mde_eval::scene::{Room, room};
use mde_prior::DisparityRule;
use mde_prior::augment::Plan;
use mde_uncertainty::statistics::spearman;
use std::io::{self, IsTerminal, Write};
use std::path::Path;
use std::time::Instant;

/// Size of the image that a model is tried on.
const TRIAL: [usize; 2] = [320, 240];
/// `(height, width)` of the photograph whose cost is stated.
const USUAL: (usize, usize) = (480, 640);
/// Below this correlation with the true depth the profile of a model is probably wrong.
const AGREES: f64 = 0.0;

pub(super) fn run(args: &DoctorArgs) -> Result<()> {
    print("program", &versions().iter().map(|(n, v)| format!("{n} {v}")).collect::<Vec<_>>().join(", "));
    print(
        "models",
        if cfg!(feature = "onnx") { "ONNX files" } else { "none: built without the feature onnx" },
    );
    print("machine", &format!("{} {}", std::env::consts::OS, std::env::consts::ARCH));
    let cores = std::thread::available_parallelism().map_or_else(|e| e.to_string(), |n| n.to_string());
    print("threads", &format!("{} used, {cores} available", rayon::current_num_threads()));
    print("vectors", &vectors());
    print("memory", &memory());
    let terminal = |is: bool| if is { "terminal" } else { "no terminal" };
    print(
        "output",
        &format!(
            "stdout: {}, stderr: {}{}",
            terminal(io::stdout().is_terminal()),
            terminal(io::stderr().is_terminal()),
            if std::env::var_os("NO_COLOR").is_some_and(|v| !v.is_empty()) { ", NO_COLOR" } else { "" }
        ),
    );
    match &args.prior_model {
        Some(path) => model(path, args),
        None => Ok(()),
    }
}

/// Runs the model on a room and compares its prediction with the room's depth.
fn model(path: &Path, args: &DoctorArgs) -> Result<()> {
    let start = Instant::now();
    let prior = NamedPrior::open(&PriorArgs {
        source: PriorSource { prior_model: Some(path.to_owned()), prior_depth: None },
        model_profile: args.model_profile.clone(),
        prior_kind: None,
        png_scale: None,
        prior_encoding: EncodingName::Plain,
    })?;
    print("model", &format!("{}, opened in {:.1} s", path.display(), start.elapsed().as_secs_f64()));
    if let Some(spec) = &prior.origin.model {
        let json = serde_json::to_string(spec).with_context(|| path.display().to_string())?;
        // Spaces, so that the line can be wrapped; it is still JSON.
        print("profile", &json.replace(",\"", ", \""));
    }
    let scene = room(Room::Study, 0, TRIAL[0], TRIAL[1])?;
    // The first prediction may take longer.
    prior.prior.predict(scene.image.view())?;
    let start = Instant::now();
    let depth = prior.prior.predict(scene.image.view())?.to_depth(&DisparityRule::default())?;
    let seconds = start.elapsed().as_secs_f64();
    let (predicted, truth): (Vec<f64>, Vec<f64>) = depth
        .iter()
        .zip(&scene.depth)
        .filter(|(predicted, truth)| **predicted > 0.0 && **truth > 0.0)
        .map(|(predicted, truth)| (f64::from(*predicted), f64::from(*truth)))
        .unzip();
    ensure!(!predicted.is_empty(), "{}: its output has no valid depth; check its profile", path.display());
    let order = spearman(&predicted, &truth)?.unwrap_or(0.0);
    let [low, high] = [
        predicted.iter().copied().fold(f64::INFINITY, f64::min),
        predicted.iter().copied().fold(0.0, f64::max),
    ];
    let [width, height] = TRIAL;
    print(
        "trial",
        &format!(
            "a room of {width}x{height}: {seconds:.2} s, depths {low:.3} to {high:.3}, {:.0} % of the pixels; Spearman's \
             correlation with the true depth {order:.2}",
            100.0 * predicted.len() as f64 / depth.len() as f64
        ),
    );
    ensure!(
        order > AGREES,
        "{}: its depth hardly agrees with the room's ({order:.2}); check the profile: a disparity taken for a depth \
         has a negative correlation",
        path.display()
    );
    let usual = Preset::Default.config().augmentation.predictions;
    let predictions = Plan::new(usual, USUAL, prior.prior.resolution(USUAL.0, USUAL.1)).predictions();
    let at_once = prior.prior.concurrency().clamp(1, rayon::current_num_threads());
    print(
        "verdict",
        &format!(
            "the model works here; for a photograph of {}x{} the preset default needs {predictions} predictions, about {:.1} s",
            USUAL.1,
            USUAL.0,
            predictions as f64 * seconds / at_once as f64
        ),
    );
    Ok(())
}

/// The vector instructions that the kernels choose from at run time.
fn vectors() -> String {
    #[cfg(target_arch = "x86_64")]
    {
        let found = [
            ("AVX-512", is_x86_feature_detected!("avx512f")),
            ("AVX2", is_x86_feature_detected!("avx2")),
            ("FMA", is_x86_feature_detected!("fma")),
        ];
        let names: Vec<_> = found.iter().filter(|(_, there)| *there).map(|(name, _)| *name).collect();
        if names.is_empty() { "SSE2 only: slow".to_owned() } else { names.join(", ") }
    }
    #[cfg(target_arch = "aarch64")]
    {
        "NEON".to_owned()
    }
    #[cfg(not(any(target_arch = "x86_64", target_arch = "aarch64")))]
    {
        "none in use: slow".to_owned()
    }
}

/// Known on Linux only.
fn memory() -> String {
    let text = std::fs::read_to_string("/proc/meminfo").unwrap_or_default();
    let gib = |key: &str| {
        let line = text.lines().find_map(|line| line.strip_prefix(key))?;
        Some(
            line.trim_start_matches(':').split_whitespace().next()?.parse::<f64>().ok()? / f64::from(1 << 20),
        )
    };
    match (gib("MemAvailable"), gib("MemTotal")) {
        (Some(free), Some(all)) => format!("{free:.1} of {all:.1} GiB free"),
        _ => "unknown on this system".to_owned(),
    }
}

/// A closed pipe is no error.
fn print(what: &str, text: &str) {
    let _ = writeln!(io::stdout().lock(), "{}", wrapped(&format!("{what:8} {text}"), columns(), 9));
}
