//! Progress of the loop.

use crate::error::{Error, Result};
use std::ops::ControlFlow;
use std::time::Instant;

/// A stage of the loop.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Stage {
    /// The monocular depth (III.B).
    Prior,
    /// The merge of the predictions.
    Merge,
    /// Poses of several photographs.
    Poses,
    /// Plane sweeps of several photographs and their consensus.
    Sweep,
    /// The synthetic views (III.A).
    Warp,
    /// The field's fit (III.C).
    Fit,
    /// The novel views and their reprojection (III.D).
    Render,
    /// The fusion (III.E).
    Fuse,
}

impl Stage {
    /// Its name.
    pub fn name(self) -> &'static str {
        match self {
            Self::Prior => "prior",
            Self::Merge => "merge",
            Self::Poses => "poses",
            Self::Sweep => "sweep",
            Self::Warp => "warp",
            Self::Fit => "fit",
            Self::Render => "render",
            Self::Fuse => "fuse",
        }
    }
}

/// Progress of the loop.
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
pub enum Event {
    /// A stage begins.
    Begin {
        /// The stage.
        stage: Stage,
        /// Iteration, from 0.
        iteration: usize,
        /// Number of iterations.
        iterations: usize,
    },
    /// An event of the field.
    Field {
        /// The event.
        event: mde_nerf::FieldEvent,
        /// View being rendered, from 0; 0 during the fit.
        view: usize,
        /// Number of views to render; 0 during the fit.
        views: usize,
    },
    /// A prediction is finished ([`Stage::Prior`]); of several photographs a pair is matched ([`Stage::Poses`]), or one is swept
    /// ([`Stage::Sweep`]).
    Part {
        /// The stage.
        stage: Stage,
        /// Parts so far.
        done: usize,
        /// Parts in total.
        total: usize,
    },
}

/// Progress callback; `Break` cancels the run ([`Error::Interrupted`]).
pub type Callback<'c> = dyn FnMut(&Event) -> ControlFlow<()> + 'c;

/// Passes on the events of a field, with the number of the view and of all views.
pub(crate) fn of_field(
    callback: &mut Callback<'_>,
    view: usize,
    views: usize,
) -> impl FnMut(&mde_nerf::FieldEvent) -> ControlFlow<()> {
    move |event| callback(&Event::Field { event: *event, view, views })
}

/// Begins a stage of an iteration; the result is its start.
pub(crate) fn begin(
    callback: &mut Callback<'_>,
    stage: Stage,
    iteration: usize,
    iterations: usize,
) -> Result<Instant> {
    match callback(&Event::Begin { stage, iteration, iterations }) {
        ControlFlow::Continue(()) => Ok(Instant::now()),
        ControlFlow::Break(()) => Err(Error::Interrupted),
    }
}
