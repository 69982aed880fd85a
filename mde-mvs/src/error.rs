/// What can be wrong with a capture or the settings of a stage.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// A setting out of its range.
    #[error("{field} is {value}; {remedy}")]
    Config {
        /// Name of the setting.
        field: &'static str,
        /// The value at fault.
        value: String,
        /// What to give instead.
        remedy: &'static str,
    },
    /// A view, a camera or a map that [`mde_warp`] refuses.
    #[error(transparent)]
    View(#[from] mde_warp::Error),
    /// A depth map that [`GaussianDepth`](mde_uncertainty::GaussianDepth) refuses.
    #[error(transparent)]
    Depth(#[from] mde_uncertainty::Error),
}

/// Shorthand for this crate's results.
pub type Result<T, E = Error> = std::result::Result<T, E>;
