//! Encodings of points of the unit cube as features.

mod frequency;
mod hash;

pub(crate) use frequency::Frequency;
pub(crate) use hash::{HashGrid, HashLayout};
