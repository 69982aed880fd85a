use std::ops::ControlFlow;

/// A part of the loop.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Stage {
    /// The monocular depth (III.B).
    Prior,
    /// The synthetic views (III.A).
    Warp,
    /// The field's fit (III.C).
    Fit,
    /// The novel views and their way back (III.D).
    Render,
    /// The fusion (III.E).
    Fuse,
}

impl Stage {
    /// A word for it.
    pub fn name(self) -> &'static str {
        match self {
            Self::Prior => "prior",
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
        /// Which.
        stage: Stage,
        /// Iteration, from 0.
        iteration: usize,
        /// Iterations in all.
        iterations: usize,
    },
    /// The field's own events; `view` counts the rendered views.
    Field {
        /// The event.
        event: mde_nerf::FieldEvent,
        /// View being rendered, from 0; 0 in the fit.
        view: usize,
        /// Views to be rendered.
        views: usize,
    },
    /// The model finished a prediction.
    Predicted {
        /// Predictions so far.
        done: usize,
        /// Predictions in total.
        total: usize,
    },
}

/// Progress callback; `Break` cancels the run ([`Error::Interrupted`](crate::Error::Interrupted)).
pub type Callback<'c> = dyn FnMut(&Event) -> ControlFlow<()> + 'c;
