//! `mde merge`: the shards' indices as one, with nothing missing and nothing double.

use super::finish;
use super::index::{Index, RECORD, Row, is_record};
use super::item::read_marker;
use super::shard::{Claim, check};
use crate::args::MergeArgs;
use crate::output::folder::check_place;
use crate::run::every::copy;
use crate::run::progress::Progress;
use anyhow::{Context, Result, bail, ensure};
use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};
use std::time::Instant;

/// A shard's index and the folder that it is in.
type Found = (PathBuf, Index);

pub(crate) fn run(args: &MergeArgs) -> Result<()> {
    let start = Instant::now();
    let mut progress = Progress::new(&args.run);
    let mut shards = Vec::new();
    for folder in &args.folders {
        shards.extend(read(folder)?);
    }
    let rows = joined(&shards)?;
    for (folder, row) in &rows {
        check_finished(folder, row)?;
    }
    let output = match (&args.run.output, &args.folders[..]) {
        (Some(output), _) => output,
        (None, [one]) => one,
        (None, _) => bail!("-o: give a folder for the photographs of all {} folders", args.folders.len()),
    };
    check_place("-o", output)?;
    super::index::check_folder(output)?;
    fs::create_dir_all(output).with_context(|| format!("{}: can't make this folder", output.display()))?;
    for (folder, row) in &rows {
        bring(&folder.join(&row.folder), &output.join(&row.folder), row)?;
    }
    let Some((_, first)) = shards.into_iter().next() else { bail!("no shard") };
    let mut index = first.whole(rows.into_iter().map(|(_, row)| row).collect());
    index.write(output)?;
    finish(&index, output, "", start.elapsed().as_secs_f64(), &mut progress)
}

fn read(folder: &Path) -> Result<Vec<Found>> {
    let shown = folder.display();
    let fault = || format!("{shown}: the folder can't be read; check the path");
    let mut names: Vec<String> = Vec::new();
    for entry in fs::read_dir(folder).with_context(fault)? {
        names.push(entry.with_context(fault)?.file_name().to_string_lossy().into_owned());
    }
    names.retain(|name| is_record(name) && name != RECORD);
    names.sort();
    ensure!(!names.is_empty(), "{shown}: holds no shard; give the output of mde refine --shard I/N");
    names.iter().map(|name| Ok((folder.to_owned(), Index::read(&folder.join(name))?))).collect()
}

/// All photographs by the names of their folders, each with the folder of its shard.
fn joined(shards: &[Found]) -> Result<Vec<(PathBuf, Row)>> {
    let mut claims = Vec::new();
    for (folder, index) in shards {
        let Some(shard) = index.shard else { bail!("{}: is no shard", folder.display()) };
        let items = index.rows.iter().map(|row| (&*row.folder, &*row.photograph)).collect();
        let Index { all, set, settings, complete, .. } = index;
        claims.push(Claim { folder, shard, all: *all, set, settings, complete: *complete, items });
    }
    check(&claims, "photographs", "mde refine", "shard-*.json")?;
    let rows = shards.iter().flat_map(|(folder, index)| index.rows.iter().map(move |row| (folder, row)));
    let rows: BTreeMap<&str, (&PathBuf, &Row)> =
        rows.map(|(folder, row)| (&*row.folder, (folder, row))).collect();
    Ok(rows.into_values().map(|(folder, row)| (folder.clone(), row.clone())).collect())
}

/// Checks that a photograph's folder lies in that of its shard, and is finished.
fn check_finished(folder: &Path, row: &Row) -> Result<()> {
    let plain = Path::new(&row.folder).file_name().is_some_and(|name| name == &*row.folder);
    let shown = folder.display();
    ensure!(
        plain,
        "{shown}: {:?} in a file shard-*.json is no name of a folder; run its shard again",
        row.folder
    );
    let from = folder.join(&row.folder);
    ensure!(
        row.error.is_some() || read_marker(&from).is_some(),
        "{}: is missing or not finished; run its shard again",
        from.display()
    );
    Ok(())
}

/// Copies a finished folder to the output where it is elsewhere.
fn bring(from: &Path, to: &Path, row: &Row) -> Result<()> {
    if row.error.is_some() {
        return Ok(());
    }
    let shown = from.display();
    if from == to || to.exists() {
        ensure!(read_marker(to).is_some(), "{}: exists and is not finished; remove it", to.display());
        return Ok(());
    }
    let parent = to.parent().unwrap_or(Path::new("."));
    let temporary = crate::output::folder::temporary_folder(parent)?;
    let whole = temporary.path().join("whole");
    copy(from, &whole).with_context(|| format!("{shown}: can't be copied to {}", to.display()))?;
    fs::rename(&whole, to).with_context(|| format!("{}: can't be put there", to.display()))
}

#[cfg(test)]
mod tests {
    use super::super::index::set_of;
    use super::super::shard::Shard;
    use super::*;

    fn shards() -> Vec<Found> {
        let names: Vec<String> = ["a", "b", "c", "d", "e"].map(str::to_owned).to_vec();
        let shard = |index: u32| {
            let shard = Shard { index, count: 2 };
            let mut found = Index::new(Some(shard), names.len(), set_of(&names), "");
            let mine = names.iter().filter(|name| shard.has(name));
            found.rows = mine.map(|name| Row { folder: name.clone(), ..Row::default() }).collect();
            found.complete = true;
            (PathBuf::from(index.to_string()), found)
        };
        vec![shard(1), shard(2)]
    }

    type Change<'c> = &'c dyn Fn(&mut Vec<Found>);

    #[test]
    fn shards_join_in_any_order_and_nothing_may_be_missing_or_double() {
        let names = |found: &[Found]| -> Vec<String> {
            joined(found).unwrap().into_iter().map(|(_, row)| row.folder).collect()
        };
        let mut reversed = shards();
        reversed.reverse();
        assert_eq!(names(&shards()), ["a", "b", "c", "d", "e"]);
        assert_eq!(names(&reversed), names(&shards()));
        let refused = |change: Change<'_>| {
            let mut found = shards();
            change(&mut found);
            joined(&found).unwrap_err().to_string()
        };
        let cases: [(Change<'_>, &str); 6] = [
            (&|found| drop(found.pop()), "shards 2 of 2 are missing"),
            (&|found| found[1].1.shard = Some(Shard { index: 1, count: 2 }), "double"),
            (&|found| found[1].1.complete = false, "not finished"),
            (&|found| found[1].1.settings.push('x'), "other settings"),
            (&|found| found[1].1.set.push('x'), "other photographs"),
            (&|found| drop(found[1].1.rows.pop()), "4 of 5 photographs"),
        ];
        for (change, word) in cases {
            let refused = refused(change);
            assert!(refused.contains(word), "{refused}");
        }
    }
}
