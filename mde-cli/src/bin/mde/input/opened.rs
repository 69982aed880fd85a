//! What a command begins with: settings, threads, and a photograph in the size that it is worked on.

use crate::args::{RunArgs, SettingsArgs, SizeArgs};
use crate::input::size::{SMALLEST, check_memory, shrink, within};
use crate::run::progress::Progress;
use anyhow::{Context, Result, ensure};
use mde_cli::memory::refine_bytes;
use mde_cli::{Config, Preset};
use mde_prior::photo::{Photo, read_image};
use std::path::Path;

/// Above this many pixels a run takes very long.
const LARGE: usize = 2_000_000;

/// The settings that the command line asks for.
pub(crate) fn settings(args: &SettingsArgs) -> Result<(Preset, Config)> {
    let preset = Preset::from(args.preset);
    let mut config = match &args.config {
        Some(path) => Config::from_file(preset, path)?,
        None => preset.config(),
    };
    if let Some(seed) = args.seed {
        config.seed = seed;
    }
    if args.no_nerf {
        config.refinement.iterations = 0;
    }
    Ok((preset, config))
}

/// Uses as many threads as the command line asks for.
pub(crate) fn use_threads(args: &RunArgs) -> Result<()> {
    let Some(threads) = args.threads else { return Ok(()) };
    rayon::ThreadPoolBuilder::new()
        .num_threads(threads.into())
        .build_global()
        .with_context(|| format!("--threads {threads}: the threads can't be started; give fewer"))
}

/// A photograph in the size that it is worked on.
pub(crate) struct Opened {
    pub(crate) photo: Photo,
    /// `(height, width)` of the file.
    pub(crate) original: (usize, usize),
    /// `(height, width)` of what is worked on.
    pub(crate) size: (usize, usize),
}

/// Reads a photograph that can be worked with, and brings it to the size that is asked for.
pub(crate) fn open_image(
    path: &Path,
    args: &SizeArgs,
    config: &Config,
    progress: &mut Progress,
) -> Result<Opened> {
    let mut photo = read_image(path)?;
    let (height, width, _) = photo.pixels.dim();
    let original = (height, width);
    let size = within(original, args.max_size);
    let (height, width) = size;
    check_memory(&args.memory, &path.display().to_string(), size, |pixels| refine_bytes(pixels, config))?;
    if size != original {
        photo.pixels = shrink(&photo.pixels, size);
        progress.warn(format!("resized from {}x{} to {width}x{height} pixels", original.1, original.0));
    }
    ensure!(
        width.min(height) >= SMALLEST,
        "{}: the image is {width}x{height}; give one of {SMALLEST}x{SMALLEST} pixels or more",
        path.display()
    );
    if width * height > LARGE {
        progress.warn(format!("{width}x{height} pixels will take long; 640x480 is usual (--max-size)"));
    }
    Ok(Opened { photo, original, size })
}
