//! Settings, threads, and a photograph at the working size.

use crate::args::{RunArgs, SettingsArgs, SizeArgs};
use crate::input::size::{SMALLEST, limit, shrink, within, working};
use crate::run::progress::Progress;
use anyhow::{Context, Result, ensure};
use mde_cli::config::Shorthands;
use mde_cli::memory::PhotographMemory;
use mde_cli::{Capture, Config, Naming, Preset};
use mde_prior::DepthPrior;
use mde_prior::photo::{Photo, read_image};
use std::path::Path;

/// The settings of the command line; `usual` is the preset where none is named.
pub(crate) fn settings(args: &SettingsArgs, usual: Preset) -> Result<(Preset, Config)> {
    let preset = args.preset.map_or(usual, Preset::from);
    let mut config = match &args.config {
        Some(path) => Config::from_file(preset, path)?,
        None => preset.config(),
    };
    let &SettingsArgs { seed, no_nerf, predictions, near, far, .. } = args;
    Shorthands { seed, no_nerf, predictions, near, far }.apply(&mut config, Naming::Flags)?;
    Ok((preset, config))
}

/// Uses the number of threads of the command line, else one per processor.
pub(crate) fn use_threads(args: &RunArgs) -> Result<()> {
    start_threads(args.threads.map(usize::from))
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

/// The prior's predictions at once that the memory limit allows for the photograph `path`, which is refined at the working size.
pub(crate) fn predictions_at_once(
    path: &Path,
    size: (usize, usize),
    args: &SizeArgs,
    config: &Config,
    prior: &dyn DepthPrior,
) -> Result<usize> {
    let (at, threads) = (working(size, args), rayon::current_num_threads());
    let memory = PhotographMemory::new(config, prior, size, at, threads);
    Ok(memory.predictions_at_once(&limit(&args.memory), &path.display().to_string(), at)?)
}

/// The same for the photographs of a capture, which are predicted side by side. A photograph that is refined alone in the end is so with the
/// usual preset.
pub(crate) fn predictions_at_once_of(
    capture: &Capture,
    at: (usize, usize),
    args: &SizeArgs,
    prior: &dyn DepthPrior,
) -> Result<usize> {
    let (config, threads) = (Preset::Default.config(), rayon::current_num_threads());
    let count = capture.photographs.len();
    let memory = PhotographMemory::of_several(&config, prior, at, count, threads);
    Ok(memory.predictions_at_once(&limit(&args.memory), &format!("{count} photographs"), at)?)
}

/// A photograph at the size of the results.
pub(crate) struct Opened {
    pub(crate) photo: Photo,
    /// `(height, width)` of the file.
    pub(crate) original: (usize, usize),
    /// `(height, width)` of the results.
    pub(crate) size: (usize, usize),
}

impl Opened {
    /// The same photograph at the working size, if that is smaller.
    pub(crate) fn working(&self, args: &SizeArgs) -> Option<Self> {
        let size = working(self.size, args);
        (size != self.size).then(|| {
            let mut photo = self.photo.clone();
            photo.pixels = shrink(&self.photo.pixels, size);
            Self { photo, original: self.original, size }
        })
    }

    /// At the working size, for photographs whose results stay at it.
    pub(crate) fn reduced(self, args: &SizeArgs) -> Self {
        self.working(args).unwrap_or(self)
    }
}

/// Reads a photograph and resizes it to the size of the results.
pub(crate) fn open_image(path: &Path, args: &SizeArgs, progress: &mut Progress) -> Result<Opened> {
    opened(read_image(path)?, path, args, progress)
}

/// Resizes a photograph of that name to the size of the results.
pub(crate) fn opened(
    mut photo: Photo,
    path: &Path,
    args: &SizeArgs,
    progress: &mut Progress,
) -> Result<Opened> {
    let (height, width, _) = photo.pixels.dim();
    let original = (height, width);
    let size = within(original, args.max_size);
    let (height, width) = size;
    let at = working(size, args);
    if size != original {
        photo.pixels = shrink(&photo.pixels, size);
        progress.warn(format!("resized from {}x{} to {width}x{height} pixels", original.1, original.0));
    }
    ensure!(
        width.min(height) >= SMALLEST,
        "{}: the image is {width}x{height}; give one of {SMALLEST}x{SMALLEST} pixels or more",
        path.display()
    );
    if at != size {
        progress
            .warn(format!("{width}x{height} pixels: refined at {}x{}; --work-size sets this", at.1, at.0));
    }
    Ok(Opened { photo, original, size })
}
