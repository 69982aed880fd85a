//! `mde eval`.

use crate::program::commands::score_maps;
use crate::program::args::EvalArgs;
use crate::program::evaluation::method::{Method, PRIOR};
use crate::program::evaluation::setup::{Request, Setup};
use crate::program::evaluation::{results, shards};
use crate::program::open::opened::use_threads;
use crate::program::progress::Progress;
use anyhow::Result;

pub(super) fn run(args: &EvalArgs) -> Result<()> {
    let mut progress = Progress::new(&args.common.run);
    use_threads(&args.common.run)?;
    if args.maps.pred.is_some() {
        return score_maps::run(args, &mut progress);
    }
    let methods = Method::parse_list(&args.methods, args.preset.into(), args.seed)?;
    let shard = args.shard;
    let request = Request { command: "eval", methods: &methods, controls: true, share_fields: false, shard };
    let setup = Setup::open(&args.common, request)?;
    if let Some(shard) = shard {
        return shards::run(&setup, shard, PRIOR, &mut progress);
    }
    let (entries, failures) = setup.run(&mut progress)?;
    results::finish(setup.results(PRIOR, entries, failures), setup.folder(), &mut progress)
        .inspect_err(|_| setup.discard_if_empty())
}
