//! Methods on many scenes, for `mde eval`, `mde ablate` and `mde calibrate`.

pub(crate) mod ablation;
mod fields;
mod method;
pub(crate) mod results;
mod runner;
mod scenes;
mod scoring;
mod store;

use fields::{FieldMemory, FilteredField, Remembered};
use method::MethodScene;
pub(crate) use method::{Method, PRIOR};
pub(crate) use runner::{Evaluation, Request};
use scenes::{Form, Priors, Source, choose, depth_file};
pub(crate) use scoring::Scoring;
use store::Kept;
pub(crate) use store::Store;
