use crate::program::args::MergeArgs;
use crate::program::evaluation::shards;
use crate::program::many;
use anyhow::Result;

pub(super) fn run(args: &MergeArgs) -> Result<()> {
    match args.folders.iter().any(|folder| shards::are_in(folder)) {
        true => shards::merge(args),
        false => batch::merge::run(args),
    }
}
