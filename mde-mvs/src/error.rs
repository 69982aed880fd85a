/// What can be wrong with a capture or the settings of a stage.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// A setting out of its range.
    #[error(transparent)]
    Config(#[from] mde_uncertainty::OutOfRange),
    /// An index of a view that does not exist.
    #[error("view {reference} does not exist; there are {views}, counted from 0")]
    Reference {
        /// The index.
        reference: usize,
        /// Number of views.
        views: usize,
    },
    /// Nothing to compare.
    #[error("{views} view(s) given; multi-view stereo needs at least 2 with different positions")]
    TooFewViews {
        /// Number of views.
        views: usize,
    },
    /// A view, a camera or a map that [`mde_warp`] refuses.
    #[error(transparent)]
    View(#[from] mde_warp::Error),
    /// A photograph that could not be read when it was needed.
    #[error("{0}")]
    Photograph(String),
    /// The callback of a stage returned `Break`.
    #[error("interrupted")]
    Interrupted,
    /// A depth map that [`GaussianDepth`](mde_uncertainty::GaussianDepth) refuses.
    #[error(transparent)]
    Depth(#[from] mde_uncertainty::Error),
}

/// Shorthand for this crate's results.
pub type Result<T, E = Error> = std::result::Result<T, E>;
