use crate::args::MergeArgs;
use crate::evaluation::shards;
use crate::run::batch;
use anyhow::Result;

pub(super) fn run(args: &MergeArgs) -> Result<()> {
    match args.folders.iter().any(|folder| shards::are_in(folder)) {
        true => shards::merge(args),
        false => batch::merge::run(args),
    }
}
