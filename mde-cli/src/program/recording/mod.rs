//! A run as a recording for rerun's viewer: `--rerun FILE.rrd`, with the feature `rerun`.

#[cfg(not(feature = "rerun"))]
mod absent;
#[cfg(feature = "rerun")]
mod rrd;
#[cfg(feature = "rerun")]
mod watched;

#[cfg(not(feature = "rerun"))]
pub(crate) use absent::Recording;
#[cfg(feature = "rerun")]
pub(crate) use rrd::Recording;

use crate::program::args::ExportArgs;
use anyhow::Result;

/// The recording of `--rerun`, if it is given; checks that its file can be written at the end.
pub(crate) fn open(args: &ExportArgs, force: bool) -> Result<Option<Recording>> {
    args.rerun.as_deref().map(|path| Recording::new(path, force)).transpose()
}
