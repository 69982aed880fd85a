//! Settings, threads, and photographs at their sizes.

use crate::program::args::{CameraArgs, RunArgs, SettingsArgs, SizeArgs};
use crate::program::open::camera;
use crate::program::open::size::sizes;
use crate::program::progress::Progress;
use anyhow::{Context, Result};
use crate::config::{Shorthands, Config, Preset};
use crate::scene::photograph::Opened;
use crate::naming::Naming;
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

/// How a photograph is opened.
pub(crate) struct Opening<'a> {
    pub(crate) size: &'a SizeArgs,
    pub(crate) camera: &'a CameraArgs,
    /// Whether its results stay at the size of the refinement.
    pub(crate) several: bool,
}

impl Opening<'_> {
    /// Reads a photograph and brings it to its size.
    pub(crate) fn open(&self, path: &Path, progress: &mut Progress) -> Result<Opened> {
        self.of(read_image(path)?, path, progress)
    }

    /// Brings a photograph of that name to its size.
    pub(crate) fn of(&self, photo: Photo, path: &Path, progress: &mut Progress) -> Result<Opened> {
        let (height, width, _) = photo.pixels.dim();
        let camera = camera::of_size(self.camera, photo.focal_35mm, [width, height])?;
        let (name, mut warn) = (path.display().to_string(), |warning| progress.warn(warning));
        let opened = Opened::new(photo.pixels, camera);
        Ok(opened.resized(&name, &sizes(self.size), self.several, Naming::Flags, &mut warn)?)
    }
}
