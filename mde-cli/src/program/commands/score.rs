//! `mde score`: depth maps of any program.

use crate::prior::read_options;
use crate::program::evaluation::results::Results;
use crate::program::evaluation::{Scoring, Store, results};
use crate::program::open::limit;
use crate::program::{Progress, ScoreMapsArgs, interrupt};
use crate::refiner::{Observer, SceneMemory};
use anyhow::{Context, Result, ensure};
use mde_eval::data::{DenseResults, MapPair, map_pairs};
use mde_eval::metrics::cloud::CloudScore;
use mde_eval::score::{Subject, score};
use mde_eval::table::{Block, Entry, Failure};
use mde_prior::format::read_depth;
use serde_json::json;

const MAPS: &str = "maps";

pub(super) fn run(args: &ScoreMapsArgs) -> Result<()> {
    let mut progress = Progress::start(&args.run)?;
    let (pred, gt) = (&args.pred, &args.gt);
    let dense = gt.is_file().then(|| DenseResults::open(pred, gt)).transpose()?;
    ensure!(
        dense.is_none() || args.sigma.is_none(),
        "--sigma: the folder of mde dense has its own; leave it out"
    );
    let (pairs, unmatched) = match &dense {
        Some(dense) => (dense.pairs.clone(), dense.unmatched.clone()),
        None => map_pairs(pred, gt, args.sigma.as_deref())?,
    };
    for id in unmatched {
        progress.warn(format!("{id}: no truth of that name in {}; not scored", gt.display()));
    }
    ensure!(!args.alignment.1, "--alignment prior: mde score has no prior; give another alignment");
    let scoring = Scoring::new(args.alignment, args.pixels, false);
    let [pred_name, gt_name] = [pred, gt].map(|folder| folder.display().to_string());
    let sigma_name = args.sigma.as_ref().map(|folder| folder.display().to_string());
    let mut record = json!({ "command": "score", "pred": pred_name, "gt": gt_name, "sigma": sigma_name });
    for name in &args.scenes {
        let known = pairs.iter().any(|pair| pair.id == *name);
        ensure!(known, "--scenes {name}: none of the {} maps in {}", pairs.len(), pred.display());
    }
    let wanted = |pair: &&MapPair| args.scenes.is_empty() || args.scenes.contains(&pair.id);
    let chosen: Vec<&MapPair> = pairs.iter().filter(wanted).collect();
    let store = Store::open(&args.run.output(pred, "-score"), &record, args.run.force, false)?;
    let (mut entries, mut failures) = (Vec::new(), Vec::new());
    for (index, pair) in chosen.iter().enumerate() {
        ensure!(!interrupt::requested(), crate::error::Error::Interrupted);
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
    record["score"] = json!(scoring.config);
    let mut preface = Vec::new();
    if let Some(dense) = &dense {
        let clouds = dense.cloud()?;
        record["cloud"] = json!(clouds);
        let shares = |score: &CloudScore| {
            let CloudScore { tolerance, accuracy, completeness, f } = *score;
            let [accuracy, completeness, f] = [accuracy, completeness, f].map(|share| 100.0 * share);
            format!(
                "cloud.ply within {tolerance:.4}: accuracy {accuracy:.1} %, completeness {completeness:.1} %, F {f:.1} %"
            )
        };
        let notes: Vec<String> = std::iter::once(dense.summary()).chain(clouds.iter().map(shares)).collect();
        notes.iter().for_each(|note| progress.step(note));
        preface.push(Block::List(notes));
    }
    let results = Results {
        title: format!("{pred_name} against {gt_name}"),
        alignment: scoring.alignment_note(),
        preface,
        reference: None,
        entries,
        failures,
        record,
    };
    results::finish(results, &store, &mut progress)
}

fn entry(pair: &MapPair, args: &ScoreMapsArgs, scoring: &Scoring) -> Result<Entry> {
    let scaled = read_options("--png-scale", args.png_scale)?;
    let predicted = read_depth(&pair.prediction, &scaled)?;
    let remedy = |_| "give smaller maps".to_owned();
    let bytes = |pixels| SceneMemory::new(&[], false).bytes(pixels, 1);
    let what = pair.prediction.display().to_string();
    limit(&args.memory).check_with(&what, predicted.dim(), "to be scored", bytes, remedy)?;
    let truth = pair.truth.read_for(predicted.dim())?;
    let sigma = pair.sigma.as_ref().map(|path| read_depth(path, &scaled)).transpose()?;
    let mut subject = Subject::new(predicted.view(), truth.view());
    subject.sigma = sigma.as_ref().map(|sigma| sigma.view());
    let files = || format!("{} against {}", pair.prediction.display(), pair.truth.path().display());
    let scores = score(&subject, &scoring.config).with_context(files)?;
    Ok(Entry::new(&pair.id, MAPS, scores))
}
