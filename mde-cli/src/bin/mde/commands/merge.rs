use crate::args::MergeArgs;
use crate::run::batch;
use anyhow::Result;

pub(super) fn run(args: &MergeArgs) -> Result<()> {
    batch::merge::run(args)
}
