//! `mde eval`.

use crate::program::args::EvalArgs;
use crate::program::evaluation::method::{Method, PRIOR};
use crate::program::evaluation::results;
use crate::program::evaluation::runner::{Evaluation, Request};
use crate::program::progress::Progress;
use anyhow::Result;

pub(super) fn run(args: &EvalArgs) -> Result<()> {
    let mut progress = Progress::start(&args.common.run)?;
    let methods = Method::parse_list(&args.methods, args.seed)?;
    let shard = args.shard;
    let several = args.several.clone();
    let request = Request {
        command: "eval",
        methods: &methods,
        shard,
        several,
        pixels: args.pixels,
        share_fields: false,
    };
    let evaluation = Evaluation::open(&args.common, request)?;
    let (entries, failures) = evaluation.run(&mut progress)?;
    if shard.is_some() {
        return results::finish_part(
            [evaluation.scenes.len(), evaluation.all],
            &failures,
            &evaluation.store.root,
            &mut progress,
        );
    }
    results::finish(evaluation.results(PRIOR, entries, failures), &evaluation.store, &mut progress)
}
