//! A part of many photographs or scenes, by their names alone.

use anyhow::{bail, ensure};
use serde::{Deserialize, Serialize};
use std::collections::BTreeSet;
use std::fmt;
use std::path::Path;
use std::str::FromStr;

/// Missing shards that a message names.
const NAMED: usize = 10;

/// Part `index` of `count`, from 1.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(try_from = "Stated")]
pub(crate) struct Shard {
    pub(crate) index: u32,
    pub(crate) count: u32,
}

/// What a record states, not checked.
#[derive(Deserialize)]
struct Stated {
    index: u32,
    count: u32,
}

impl TryFrom<Stated> for Shard {
    type Error = String;

    fn try_from(Stated { index, count }: Stated) -> Result<Self, String> {
        Self::new(index, count).ok_or_else(|| format!("there is no shard {index}/{count}"))
    }
}

impl Shard {
    /// The most parts that a run can have.
    const MOST: u32 = 1_000_000;

    fn new(index: u32, count: u32) -> Option<Self> {
        ((1..=count).contains(&index) && count <= Self::MOST).then_some(Self { index, count })
    }

    /// Whether the item of this name belongs to it: the CRC-32 of the name modulo the number of shards.
    pub(crate) fn has(&self, name: &str) -> bool {
        crc32fast::hash(name.as_bytes()) % self.count == self.index - 1
    }
}

/// What the record of a shard states.
pub(crate) struct Claim<'c> {
    /// The folder that it is in.
    pub(crate) folder: &'c Path,
    pub(crate) shard: Shard,
    /// Items of all shards, and what identifies their names.
    pub(crate) all: usize,
    pub(crate) set: &'c str,
    /// Identifies the settings.
    pub(crate) settings: &'c str,
    /// Whether all of its items have been tried.
    pub(crate) complete: bool,
    /// Its items: what identifies each, and how messages name it.
    pub(crate) items: Vec<(&'c str, &'c str)>,
}

/// Checks that shards make one whole, with nothing missing and nothing double. `items` is what they are parts of, `command` makes
/// a shard, `files` are their records.
pub(crate) fn check(claims: &[Claim<'_>], items: &str, command: &str, files: &str) -> anyhow::Result<()> {
    let Some(first) = claims.first() else { bail!("no shard") };
    let (count, shown) = (first.shard.count, first.folder.display());
    let (mut keys, mut names, mut seen) = (BTreeSet::new(), BTreeSet::new(), BTreeSet::new());
    for claim in claims {
        let named = format!("{}: shard {}", claim.folder.display(), claim.shard);
        ensure!(
            claim.shard.count == count,
            "{named} is of {} shards, the first of {count}; remove the files {files} of the run that is not meant",
            claim.shard.count
        );
        ensure!(
            claim.set == first.set && claim.all == first.all,
            "{named} is of other {items} than the first; give the shards of one run"
        );
        ensure!(
            claim.settings == first.settings,
            "{named} has other settings than the first; run it again with those of the first"
        );
        ensure!(claim.complete, "{named} is not finished; run its command again");
        ensure!(seen.insert(claim.shard.index), "{named} is double; give each shard once");
        for (key, shown) in &claim.items {
            let new = keys.insert(*key) & names.insert(*shown);
            ensure!(new, "{named}: {shown} is in two shards; run both again");
        }
    }
    let missing: Vec<String> =
        (1..=count).filter(|index| !seen.contains(index)).map(|i| i.to_string()).collect();
    let more = match missing.len().saturating_sub(NAMED) {
        0 => String::new(),
        more => format!(" and {more} more"),
    };
    ensure!(
        missing.is_empty(),
        "{shown}: shards {}{more} of {count} are missing; run {command} --shard I/{count} for them",
        missing[..missing.len().min(NAMED)].join(", ")
    );
    ensure!(
        keys.len() == first.all,
        "{shown}: {} of {} {items} are in the shards; run them again",
        keys.len(),
        first.all
    );
    Ok(())
}

impl FromStr for Shard {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let shard = text.split_once('/').and_then(|(i, n)| Self::new(i.parse().ok()?, n.parse().ok()?));
        shard.ok_or_else(|| "give I/N with I from 1 to N, such as 2/8".to_owned())
    }
}

impl fmt::Display for Shard {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}/{}", self.index, self.count)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_name_is_in_one_shard() {
        let shards: Vec<Shard> = (1..=4).map(|index| Shard { index, count: 4 }).collect();
        let counts: Vec<usize> = shards
            .iter()
            .map(|shard| (0..1000).filter(|number| shard.has(&format!("IMG_{number:04}"))).count())
            .collect();
        assert_eq!(counts.iter().sum::<usize>(), 1000);
        assert!(counts.iter().all(|count| (150..350).contains(count)), "{counts:?}");
    }

    #[test]
    fn a_shard_is_i_of_n() {
        assert_eq!("2/8".parse(), Ok(Shard { index: 2, count: 8 }));
        for wrong in ["0/8", "9/8", "2", "a/b", "1/0", "-1/3"] {
            assert!(wrong.parse::<Shard>().unwrap_err().contains("2/8"), "{wrong}");
        }
    }
}
