//! Working size and memory limit.

use crate::program::args::{MemoryArgs, SizeArgs};
use anyhow::Result;
use crate::naming::Naming;
use crate::scene::photograph::Sizes;
use crate::refiner::plan::limit::MemoryLimit;
use crate::refiner::plan::SceneMemory;

/// The sizes of the command line.
pub(crate) fn sizes(args: &SizeArgs) -> Sizes {
    Sizes { longest: args.max_size.map(|n| n as usize), megapixels: args.work_size }
}

pub(crate) fn limit(args: &MemoryArgs) -> MemoryLimit {
    MemoryLimit { gib: args.max_memory, naming: Naming::Flags }
}

/// Refuses a run above the memory limit; `what` names its image, `bytes` estimates its memory by the number of pixels.
pub(crate) fn check_memory(
    args: &MemoryArgs,
    what: &str,
    size: (usize, usize),
    bytes: impl Fn(u64) -> u64,
) -> Result<()> {
    Ok(limit(args).check(what, size, bytes)?)
}

/// The memory limit of an evaluation's scenes.
pub(crate) struct SceneLimit<'a> {
    pub(crate) args: &'a MemoryArgs,
    pub(crate) memory: SceneMemory,
    /// Scenes at once.
    pub(crate) jobs: usize,
}

impl SceneLimit<'_> {
    /// Refuses scenes of that size where those that run at once exceed the limit.
    pub(crate) fn check(&self, what: &str, size: (usize, usize)) -> Result<()> {
        let (with, jobs) = match self.jobs {
            1 => ("with these methods".to_owned(), ""),
            jobs => (format!("with these methods, {jobs} scenes at once,"), ", fewer --jobs"),
        };
        let bytes = |pixels| self.memory.bytes(pixels, self.jobs as u64);
        let remedy = |fits| match fits {
            Some((height, width)) => format!("give --size {width}x{height}, fewer views{jobs}"),
            None => format!("give fewer methods, fewer views or a smaller field{jobs}"),
        };
        Ok(limit(self.args).check_with(what, size, &with, bytes, remedy)?)
    }
}

/// Refuses maps whose scoring exceeds the limit.
pub(crate) fn check_maps(args: &MemoryArgs, what: &str, size: (usize, usize)) -> Result<()> {
    let bytes = |pixels| SceneMemory::new(&[], false).bytes(pixels, 1);
    let remedy = |_| "give smaller maps".to_owned();
    Ok(limit(args).check_with(what, size, "to be scored", bytes, remedy)?)
}
