//! `mde merge`: the shards' indices as one, with nothing missing and nothing double.

use crate::program::many::finish;
use crate::program::many::index::{Index, RECORD, Row, is_record};
use crate::program::many::item::read_marker;
use crate::program::many::shard::{Claim, check};
use crate::program::args::MergeArgs;
use crate::program::store::lock::Lock;
use crate::program::store::folder::{OutputFolder, check_place, remove_unfinished};
use crate::program::progress::Progress;
use anyhow::{Context, Result, bail, ensure};
use std::fs;
use std::path::{Path, PathBuf};
use std::time::Instant;

/// A shard's index and the folder that it is in.
type Found = (PathBuf, Index);

/// A photograph with the folder and the settings of its shard.
#[derive(Debug)]
struct Part {
    folder: PathBuf,
    settings: String,
    row: Row,
}

pub(crate) fn run(args: &MergeArgs) -> Result<()> {
    let start = Instant::now();
    let mut progress = Progress::new(&args.run);
    let mut shards = Vec::new();
    for folder in &args.folders {
        shards.extend(read(folder)?);
    }
    let parts = joined(&shards)?;
    parts.iter().try_for_each(check_finished)?;
    let output = match (&args.run.output, &args.folders[..]) {
        (Some(output), _) => output,
        (None, [one]) => one,
        (None, _) => bail!("-o: give a folder for the photographs of all {} folders", args.folders.len()),
    };
    check_place("-o", output)?;
    super::index::check_folder(output)?;
    fs::create_dir_all(output).with_context(|| format!("{}: can't make this folder", output.display()))?;
    let _lock = Lock::take(output)?;
    // All shards have ended, so that what is unfinished is of killed ones.
    args.folders.iter().chain([output]).for_each(|folder| remove_unfinished(folder));
    for Part { folder, row, .. } in &parts {
        bring(&folder.join(&row.folder), &output.join(&row.folder), row)?;
    }
    let Some((_, first)) = shards.into_iter().next() else { bail!("no shard") };
    let mut index = first.whole(parts.into_iter().map(|part| Row { position: None, ..part.row }).collect());
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

/// All photographs in the order of the arguments.
fn joined(shards: &[Found]) -> Result<Vec<Part>> {
    let mut claims = Vec::new();
    for (folder, index) in shards {
        let Some(shard) = index.shard else { bail!("{}: is no shard", folder.display()) };
        let items = index.rows.iter().map(|row| (&*row.folder, &*row.photograph)).collect();
        let Index { all, set, settings, complete, .. } = index;
        claims.push(Claim { folder, shard, all: *all, set, settings, complete: *complete, items });
    }
    check(&claims, "photographs", "mde refine", "shard-*.json")?;
    let part = |folder: &PathBuf, index: &Index, row: &Row| Part {
        folder: folder.clone(),
        settings: index.settings.clone(),
        row: row.clone(),
    };
    let mut parts: Vec<Part> = shards
        .iter()
        .flat_map(|(folder, index)| index.rows.iter().map(move |row| part(folder, index, row)))
        .collect();
    // Shards may have got their arguments in another order.
    parts.sort_by(|a, b| (a.row.position, &a.row.folder).cmp(&(b.row.position, &b.row.folder)));
    Ok(parts)
}

/// Checks that a photograph's folder lies in that of its shard, and is finished, with the shard's settings.
fn check_finished(part: &Part) -> Result<()> {
    let Part { folder, settings, row } = part;
    let plain = Path::new(&row.folder).file_name().is_some_and(|name| name == &*row.folder);
    let shown = folder.display();
    ensure!(
        plain,
        "{shown}: {:?} in a file shard-*.json is no name of a folder; run its shard again",
        row.folder
    );
    if row.error.is_some() {
        return Ok(());
    }
    let from = folder.join(&row.folder);
    let Some(marker) = read_marker::<Row>(&from) else {
        bail!("{}: is missing or not finished; run its shard again", from.display())
    };
    ensure!(
        marker.settings().as_ref() == Some(settings),
        "{}: was made with other settings than its shard states; run its shard again",
        from.display()
    );
    Ok(())
}

/// Copies a finished folder to the output where it is elsewhere, in the place of one that was made otherwise.
fn bring(from: &Path, to: &Path, row: &Row) -> Result<()> {
    if row.error.is_some() {
        return Ok(());
    }
    if from == to {
        return Ok(());
    }
    let made_from = |place: &Path| read_marker::<Row>(place).map(|marker| marker.made_from);
    if to.exists() {
        let earlier = made_from(to);
        ensure!(earlier.is_some(), "{}: exists and is not finished; remove it", to.display());
        if earlier == made_from(from) {
            return Ok(());
        }
    }
    let fault = || format!("{}: can't be copied to {}", from.display(), to.display());
    OutputFolder::new(to, true)?.write(|place| copy(from, place).with_context(fault))
}

/// A folder with all that is in it.
fn copy(from: &Path, to: &Path) -> std::io::Result<()> {
    fs::create_dir_all(to)?;
    for entry in fs::read_dir(from)? {
        let entry = entry?;
        let target = to.join(entry.file_name());
        if entry.file_type()?.is_dir() {
            copy(&entry.path(), &target)?;
        } else {
            fs::copy(entry.path(), target)?;
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use crate::program::many::index::set_of;
    use crate::program::many::shard::Shard;
    use super::*;

    fn shards() -> Vec<Found> {
        let names: Vec<String> = ["a", "b", "c", "d", "e"].map(str::to_owned).to_vec();
        let shard = |index: u32| {
            let shard = Shard { index, count: 2 };
            let mut found = Index::new(Some(shard), names.len(), set_of(&names), "");
            let mine = names.iter().filter(|name| shard.has(name));
            let row = |name: &String| Row {
                photograph: format!("{name}.png"),
                folder: name.clone(),
                position: names.iter().rev().position(|other| other == name),
                ..Row::default()
            };
            found.rows = mine.map(row).collect();
            found.complete = true;
            (PathBuf::from(index.to_string()), found)
        };
        vec![shard(1), shard(2)]
    }

    type Change<'c> = &'c dyn Fn(&mut Vec<Found>);

    #[test]
    fn shards_join_in_any_order_and_nothing_may_be_missing_or_double() {
        let names = |found: &[Found]| -> Vec<String> {
            joined(found).unwrap().into_iter().map(|part| part.row.folder).collect()
        };
        let mut reversed = shards();
        reversed.reverse();
        // That of the arguments, here e first.
        assert_eq!(names(&shards()), ["e", "d", "c", "b", "a"]);
        assert_eq!(names(&reversed), names(&shards()));
        let refused = |change: Change<'_>| {
            let mut found = shards();
            change(&mut found);
            joined(&found).unwrap_err().to_string()
        };
        let cases: [(Change<'_>, &str); 7] = [
            (
                &|found| found[0].1.rows[0].photograph = found[1].1.rows[0].photograph.clone(),
                "in two shards; run both again",
            ),
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
