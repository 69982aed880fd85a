//! `mde eval`.

use crate::program::args::EvalArgs;
use crate::program::evaluation::method::{Method, PRIOR};
use crate::program::evaluation::results;
use crate::program::evaluation::setup::{Request, Setup};
use crate::program::open::settings::use_threads;
use crate::program::progress::Progress;
use anyhow::Result;

pub(super) fn run(args: &EvalArgs) -> Result<()> {
    let mut progress = Progress::new(&args.common.run);
    use_threads(&args.common.run)?;
    let methods = Method::parse_list(&args.methods, args.seed)?;
    let shard = args.shard;
    let request = Request {
        command: "eval",
        methods: &methods,
        controls: true,
        share_fields: false,
        shard,
        several: args.several.clone(),
        pixels: args.pixels,
    };
    let setup = Setup::open(&args.common, request)?;
    let (entries, failures) = setup.run(&mut progress)?;
    if shard.is_some() {
        return results::finish_part(setup.scenes(), &failures, setup.folder(), &mut progress);
    }
    results::finish(setup.results(PRIOR, entries, failures), setup.folder(), &mut progress)
        .inspect_err(|_| setup.discard_if_empty())
}
