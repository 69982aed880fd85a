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
    let several = args.several.clone();
    let request = Request { shard, several, pixels: args.pixels, ..Request::new("eval", &methods) };
    let setup = Setup::open(&args.common, request)?;
    let (entries, failures) = setup.run(&mut progress)?;
    if shard.is_some() {
        return results::finish_part(
            [setup.scenes.len(), setup.all],
            &failures,
            setup.store.root(),
            &mut progress,
        );
    }
    results::finish(setup.results(PRIOR, entries, failures), setup.store.root(), &mut progress)
        .inspect_err(|_| setup.store.discard_if_empty())
}
