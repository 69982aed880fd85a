//! Poses of photographs from matches and a monocular depth prior.

mod features;
mod matching;

pub use features::{DESCRIPTOR_LENGTH, FeatureConfig, Features, Keypoint};
pub use matching::{Match, match_features};
