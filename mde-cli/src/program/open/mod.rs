//! From the command line to a prior, settings, threads and scenes.

pub(crate) mod photographs;
pub(crate) mod prior;
pub(crate) mod scene;

pub(crate) use photographs::{content, existing};
pub(crate) use scene::Opener;

use crate::config::{Config, Preset};
use crate::output::export::Format;
use crate::program::{
    CameraArgs, MemoryArgs, PresetArgs, RefinementArgs, ResultArgs, SettingsArgs, SizeArgs,
};
use crate::refiner::{ErrorBar, MemoryLimit, Settings};
use crate::scene::{GivenCamera, KnownCamera, Sizes};
use anyhow::{Context, Result};
use std::ffi::OsString;
use std::path::Path;

/// A preset with files and `KEY=VALUE` pairs over it, in their order.
pub(crate) fn overridden(preset: Preset, over: &[OsString]) -> Result<Config> {
    let mut config = preset.config();
    for one in over {
        let path = Path::new(one);
        config = match one.to_str().and_then(|text| text.split_once('=')) {
            Some((key, value)) if !path.exists() => {
                let pair = |value: &str| format!("{} = {value}", key.trim());
                let text = Some(pair(value)).filter(|text| text.parse::<toml::Table>().is_ok());
                // Text needs no quotes.
                let text = text.unwrap_or_else(|| pair(&toml::Value::from(value.trim()).to_string()));
                config.with_text(&text, &format!("--config {}", path.display()))?
            }
            _ => config.with_file(path)?,
        };
    }
    Ok(config)
}

/// What a refiner is set to by a preset and settings over it; `usual` is the preset where none is named.
pub(crate) fn settings(args: &PresetArgs, memory: &MemoryArgs, usual: Preset) -> Result<Settings> {
    let preset = args.preset.unwrap_or(usual);
    let config = overridden(preset, &args.config)?;
    Ok(Settings { config, memory: limit(memory), ..Settings::new(preset) })
}

/// The same with flags for single settings and the results.
pub(crate) fn all_settings(
    args: &SettingsArgs,
    results: &ResultArgs,
    memory: &MemoryArgs,
    usual: Preset,
) -> Result<Settings> {
    let mut settings = settings(&args.preset, memory, usual)?;
    let &SettingsArgs { seed, no_nerf, predictions, depth_range, .. } = args;
    settings.config = settings.config.with(seed, no_nerf, predictions, depth_range)?;
    settings.error_bar = ErrorBar::open(results.interval, results.calibration.as_deref())?;
    settings.keep_field = results.export.contains(&Format::Field);
    settings.exports = !results.export.is_empty();
    Ok(settings)
}

/// The same of photographs and captures.
pub(crate) fn refinement_settings(args: &RefinementArgs, usual: Preset) -> Result<Settings> {
    let mut settings = all_settings(&args.settings, &args.results, &args.size.memory, usual)?;
    settings.sizes = sizes(&args.size);
    if let Some(most) = args.max_views {
        settings.config.multi_view.max_views = most.into();
    }
    settings.unit = args.unit;
    Ok(settings)
}

pub(crate) fn sizes(args: &SizeArgs) -> Sizes {
    Sizes { longest: args.max_size.map(|pixels| pixels as usize), megapixels: args.work_size }
}

pub(crate) fn limit(args: &MemoryArgs) -> MemoryLimit {
    MemoryLimit { gib: args.max_memory }
}

/// The camera of an image of that size, `[width, height]`.
pub(crate) fn camera(args: &CameraArgs, focal_35mm: Option<f64>, size: [usize; 2]) -> Result<KnownCamera> {
    Ok(KnownCamera::new(&given_camera(args), focal_35mm, size)?)
}

pub(crate) fn given_camera(args: &CameraArgs) -> GivenCamera {
    match (&args.intrinsics, args.fx, args.fov) {
        (Some(path), ..) => GivenCamera::File(path.clone()),
        (None, Some((fx, fy)), _) => GivenCamera::Intrinsics { fx, fy, cx: args.cx, cy: args.cy },
        (None, None, Some(fov)) => GivenCamera::FieldOfView(fov),
        (None, None, None) => GivenCamera::Nothing,
    }
}

/// Rayon's number for a thread per processor.
const PER_PROCESSOR: usize = 0;

/// Uses that number of threads, else one per processor; this one alone where the system has none left. This thread is one of them,
/// since each keeps memory that it has freed; not one that `waits` for threads that need the others.
pub(crate) fn start_threads(wanted: Option<usize>, waits: bool) -> Result<()> {
    // Tried before: a pool that fails cannot be made again.
    let is_alone = std::thread::Builder::new().spawn(|| ()).is_err();
    let builder = rayon::ThreadPoolBuilder::new();
    let builder = builder.num_threads(if is_alone { 1 } else { wanted.unwrap_or(PER_PROCESSOR) });
    let builder = if waits && !is_alone { builder } else { builder.use_current_thread() };
    builder
        .build_global()
        .context("the threads can't be started; close other programs, or give fewer to --threads")
}
