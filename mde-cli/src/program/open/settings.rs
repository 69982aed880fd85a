//! Settings and threads.

use crate::config::{Config, Preset};
use crate::output::export::Format;
use crate::program::args::{
    CameraArgs, DenseArgs, ErrorBarArgs, ExportArgs, MemoryArgs, PresetArgs, RefineArgs, SettingsArgs,
    SizeArgs, ViewArgs,
};
use crate::refiner::Settings;
use crate::refiner::error_bar::ErrorBar;
use crate::refiner::plan::limit::MemoryLimit;
use crate::scene::camera::{GivenCamera, KnownCamera};
use crate::scene::size::Sizes;
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
                config.with_value(key.trim(), value.trim(), &format!("--config {}", path.display()))?
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

/// The same with flags for single settings and the error bar.
pub(crate) fn all_settings(
    args: &SettingsArgs,
    error_bar: &ErrorBarArgs,
    memory: &MemoryArgs,
    usual: Preset,
) -> Result<Settings> {
    let mut settings = settings(&args.preset, memory, usual)?;
    let &SettingsArgs { seed, no_nerf, predictions, depth_range, .. } = args;
    settings.config = settings.config.with(seed, no_nerf, predictions, depth_range)?;
    settings.error_bar = ErrorBar::open(error_bar.interval, error_bar.calibration.as_deref())?;
    Ok(settings)
}

/// What `mde refine` sets a refiner to.
pub(crate) fn of_refine(args: &RefineArgs) -> Result<Settings> {
    let usual = if args.several.views.is_empty() { Preset::Default } else { Preset::MultiView };
    let settings = all_settings(&args.settings, &args.error_bar, &args.size.memory, usual)?;
    Ok(with_views(settings, &args.several.views_used, &args.size, &args.export))
}

/// What `mde dense` sets a refiner to.
pub(crate) fn of_dense(args: &DenseArgs) -> Result<Settings> {
    let settings = all_settings(&args.settings, &args.error_bar, &args.size.memory, Preset::MultiView)?;
    Ok(with_views(settings, &args.views, &args.size, &args.export))
}

fn with_views(mut settings: Settings, views: &ViewArgs, size: &SizeArgs, export: &ExportArgs) -> Settings {
    settings.sizes = sizes(size);
    if let Some(most) = views.max_views {
        settings.config.multi_view.max_views = most.into();
    }
    settings.unit = views.unit;
    settings.keep_field = export.export.contains(&Format::Field);
    settings.exports = !export.export.is_empty();
    settings
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

/// What is given of a camera.
pub(crate) fn given_camera(args: &CameraArgs) -> GivenCamera {
    match (&args.intrinsics, args.fx, args.fov) {
        (Some(path), ..) => GivenCamera::File(path.clone()),
        (None, Some((fx, fy)), _) => GivenCamera::Intrinsics { fx, fy, cx: args.cx, cy: args.cy },
        (None, None, Some(fov)) => GivenCamera::FieldOfView(fov),
        (None, None, None) => GivenCamera::Nothing,
    }
}

/// Uses that number of threads, else one per processor, and fewer where the system has fewer left.
pub(crate) fn start_threads(wanted: Option<usize>) -> Result<()> {
    let usual = || std::thread::available_parallelism().map_or(1, usize::from);
    let builder = match available(wanted.unwrap_or_else(usual)) {
        0 => rayon::ThreadPoolBuilder::new().num_threads(1).use_current_thread(),
        threads => rayon::ThreadPoolBuilder::new().num_threads(threads),
    };
    builder
        .build_global()
        .context("the threads can't be started; close other programs, or give fewer to --threads")
}

/// The number of threads that can be started at once, at most `wanted`. A pool that fails cannot be made again.
fn available(wanted: usize) -> usize {
    let (open, wait) = std::sync::mpsc::channel::<()>();
    let wait = std::sync::Arc::new(std::sync::Mutex::new(wait));
    let start = || {
        let wait = std::sync::Arc::clone(&wait);
        // Until the channel closes.
        std::thread::Builder::new().spawn(move || drop(wait.lock().map(|wait| wait.recv())))
    };
    let started: Vec<_> = (0..wanted).map_while(|_| start().ok()).collect();
    drop(open);
    let count = started.len();
    started.into_iter().for_each(|thread| drop(thread.join()));
    count
}
