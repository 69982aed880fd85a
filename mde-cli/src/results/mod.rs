//! What a run makes of a refinement: its unit, its error bar, the record, and with the feature `files` its files.

#[cfg(feature = "files")]
pub mod canvas;
mod doubts;
mod error_bar;
#[cfg(feature = "files")]
pub mod every;
#[cfg(feature = "files")]
pub mod export;
mod finish;
#[cfg(feature = "files")]
mod maps;
#[cfg(feature = "files")]
pub mod names;
mod one_scale;
#[cfg(feature = "files")]
pub mod preview;
mod record;

pub use error_bar::{ErrorBar, Interval, ScaleError, Stated};
pub use finish::{Finish, Finished, SameScale, Unit};
#[cfg(feature = "files")]
pub use maps::{EVIDENCE, Maps};
pub use one_scale::{OneScale, Pair};
pub use record::{About, RunRecord, TrainingCurve, follow, versions};
