//! `mde eval --pred`: depth maps of any program.

use crate::program::args::EvalArgs;
use crate::program::evaluation::results;
use crate::program::evaluation::results::Results;
use crate::program::evaluation::runner::Failure;
use crate::program::evaluation::scoring::Scoring;
use crate::program::evaluation::store::Store;
use crate::program::open::size::check_maps;
use crate::program::interrupt;
use crate::program::progress::Progress;
use anyhow::{Context, Result, bail, ensure};
use crate::refiner::prior::read_options;
use mde_eval::data::{MapPair, MapPairs};
use mde_eval::score::{Subject, score};
use mde_eval::table::Entry;
use mde_prior::format::{Encoding, read_depth};
use ndarray::Array2;
use serde_json::json;
use std::path::Path;

/// The name of the maps in the tables.
const MAPS: &str = "maps";

pub(super) fn run(args: &EvalArgs, progress: &mut Progress) -> Result<()> {
    let (Some(pred), Some(gt)) = (&args.maps.pred, &args.maps.gt) else { bail!("--pred needs --gt") };
    let pairs = MapPairs::open(pred, gt, args.maps.sigma.as_deref())?;
    for id in pairs.unmatched() {
        progress.warn(format!("{id}: no truth of that name in {}; not scored", gt.display()));
    }
    let scoring = Scoring::new(&args.common.score, false);
    let [pred_name, gt_name] = [pred, gt].map(|folder| folder.display().to_string());
    let sigma_name = args.maps.sigma.as_ref().map(|folder| folder.display().to_string());
    let basis = json!({ "command": "eval", "pred": pred_name, "gt": gt_name, "sigma": sigma_name });
    for name in &args.common.data.scenes {
        let known = pairs.pairs().iter().any(|pair| pair.id == *name);
        ensure!(known, "--scenes {name}: none of the {} maps in {}", pairs.pairs().len(), pred.display());
    }
    let wanted =
        |pair: &&MapPair| args.common.data.scenes.is_empty() || args.common.data.scenes.contains(&pair.id);
    let limit = args.common.data.limit.map_or(usize::MAX, |n| n as usize);
    let chosen: Vec<&MapPair> = pairs.pairs().iter().filter(wanted).take(limit).collect();
    let store = Store::open(&args.common.run.output(pred, "-eval"), &basis, args.common.run.force)?;
    let (mut entries, mut failures) = (Vec::new(), Vec::new());
    for (index, pair) in chosen.iter().enumerate() {
        if interrupt::requested() {
            bail!(crate::error::Error::Interrupted);
        }
        match entry(pair, args, &scoring) {
            Ok(entry) => entries.push(entry),
            Err(error) => {
                let error = format!("{error:#}");
                progress.failed(format!("{}: failed: {error}", pair.id));
                failures.push(Failure { scene: pair.id.clone(), method: None, error });
            }
        }
        let value = json!({ "event": "scene", "scene": pair.id });
        progress.piece(index + 1, chosen.len(), &pair.id, None, value);
    }
    let results = Results {
        title: format!("{} against {}", pred.display(), gt.display()),
        alignment: scoring.alignment_note(),
        preface: Vec::new(),
        reference: None,
        entries,
        failures,
        record: json!({ "pred": pred_name, "gt": gt_name, "sigma": sigma_name, "score": scoring.config }),
    };
    results::finish(results, store.root(), progress).inspect_err(|_| store.discard_if_empty())
}

fn entry(pair: &MapPair, args: &EvalArgs, scoring: &Scoring) -> Result<Entry> {
    let predicted = read(&pair.prediction, "--pred-scale", args.maps.pred_scale, Encoding::Linear)?;
    check_maps(&args.common.memory, &pair.prediction.display().to_string(), predicted.dim())?;
    let truth = read(&pair.truth, "--gt-scale", args.maps.gt_scale, args.maps.gt_encoding.into())?;
    let sigma = match &pair.sigma {
        Some(path) => Some(read(path, "--pred-scale", args.maps.pred_scale, Encoding::Linear)?),
        None => None,
    };
    let mut subject = Subject::new(predicted.view(), truth.view());
    subject.sigma = sigma.as_ref().map(|sigma| sigma.view());
    let files = || format!("{} against {}", pair.prediction.display(), pair.truth.display());
    let scores = score(&subject, &scoring.config).with_context(files)?;
    Ok(Entry::new(&pair.id, MAPS, scores))
}

fn read(path: &Path, flag: &str, scale: Option<f64>, encoding: Encoding) -> Result<Array2<f32>> {
    Ok(read_depth(path, &read_options(flag, scale, encoding)?)?)
}
