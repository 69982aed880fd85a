//! Which photographs of a burst or a video are compared, and what they have in common.

use super::{LogFactor, LogRatio, common_scale};
use crate::Result;
use crate::poses::Prepared;
use std::sync::Arc;

/// Photographs before it that each is matched with.
const NEXT: usize = 3;
/// Photographs at most that are all matched with each other: up to so many need no order.
const KEYS: usize = 16;

/// A photograph that is compared with later ones.
type Kept = (usize, Arc<Prepared>);

/// Two photographs that are to be compared.
#[derive(Debug, Clone)]
pub struct MatchPair([Kept; 2]);

/// The ratios between the scales of many photographs, which are added in their order.
///
/// Each is compared with the 3 before it, and up to 16 photographs, evenly spread over all, with each other; no more than these are kept.
/// The factors depend on the photographs, their order, and the seed alone.
#[derive(Debug)]
pub struct ScaleMatches {
    seed: u64,
    photographs: usize,
    /// Photographs from one that is matched with all such to the next.
    stride: usize,
    added: usize,
    /// In their order: the last, and those that are matched with all such.
    kept: Vec<Kept>,
    ratios: Vec<LogRatio>,
}

impl ScaleMatches {
    /// For so many photographs.
    pub fn new(photographs: usize, seed: u64) -> Self {
        let stride = photographs.div_ceil(KEYS).max(1);
        Self { seed, photographs, stride, added: 0, kept: Vec::new(), ratios: Vec::new() }
    }

    /// Adds the next photograph, nothing where it could not be prepared. The result are the pairs to compare.
    pub fn add(&mut self, prepared: Option<Prepared>) -> Vec<MatchPair> {
        let index = self.added;
        self.added += 1;
        let Some(prepared) = prepared else { return Vec::new() };
        let new: Kept = (index, Arc::new(prepared));
        let is_key = |index: usize| index.is_multiple_of(self.stride);
        let last = self.kept.len().saturating_sub(NEXT);
        let others = self.kept.iter().enumerate();
        let others = others.filter(|(place, (old, _))| *place >= last || is_key(index) && is_key(*old));
        let pairs = others.map(|(_, old)| MatchPair([old.clone(), new.clone()])).collect();
        self.kept.push(new);
        if let Some(left) = self.kept.len().checked_sub(NEXT + 1)
            && !is_key(self.kept[left].0)
        {
            self.kept.remove(left);
        }
        pairs
    }

    /// The ratio of a pair's scales; nothing where the two share too little. Pairs may be compared side by side.
    pub fn ratio(&self, MatchPair([(first, a), (second, b)]): &MatchPair) -> Option<LogRatio> {
        let ratio = Prepared::log_ratio(a, b, self.seed);
        ratio.map(|[log, sigma]| LogRatio { first: *first, second: *second, log, sigma })
    }

    /// Adds ratios, in any order.
    pub fn extend(&mut self, ratios: impl IntoIterator<Item = LogRatio>) {
        self.ratios.extend(ratios);
    }

    /// Number of the ratios so far.
    pub fn count(&self) -> usize {
        self.ratios.len()
    }

    /// The factor of each photograph.
    ///
    /// # Errors
    /// As [`common_scale`].
    pub fn factors(&self) -> Result<Vec<LogFactor>> {
        common_scale(self.photographs, &self.ratios)
    }
}
