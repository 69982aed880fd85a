//! What turns a point of the unit cube into features.

mod frequency;
mod hash;

pub(crate) use frequency::Frequency;
pub(crate) use hash::{HashGrid, HashLayout};
