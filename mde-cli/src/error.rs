//! Errors: one line that names the value and the remedy.

use std::path::Path;

/// An error of a refinement; the text is one line that names the value and the remedy.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// The prior failed.
    #[error(transparent)]
    Prior(#[from] mde_prior::Error),
    /// A warp or a reprojection failed.
    #[error(transparent)]
    Warp(#[from] mde_warp::Error),
    /// The field failed.
    #[error(transparent)]
    Field(mde_nerf::Error),
    /// A stage of multi-view stereo failed.
    #[error(transparent)]
    MultiView(mde_mvs::Error),
    /// Photographs that are no capture.
    #[error("{reason}; {remedy}")]
    Capture {
        /// What is wrong, with the photograph's name.
        reason: String,
        /// What to do.
        remedy: &'static str,
    },
    /// The fusion failed.
    #[error(transparent)]
    Fusion(#[from] mde_fusion::Error),
    /// A depth map or a statistic of it is not valid.
    #[error(transparent)]
    Depth(#[from] mde_uncertainty::Error),
    /// A prior without a known pixel.
    #[error("the prior has no pixel with a depth; check its kind (metric, depth or disparity) and its scale")]
    EmptyPrior,
    /// A prior of another size than the image.
    #[error(
        "the prior is {}x{} but the image is {}x{} (width x height); make both the same size",
        prior[1], prior[0], image[1], image[0]
    )]
    Size {
        /// `[height, width]` of the prior.
        prior: [usize; 2],
        /// `[height, width]` of the image.
        image: [usize; 2],
    },
    /// An argument or a setting at fault, or what a file that it names holds: known depths, intrinsics, the depths of a prior.
    #[error("{0}")]
    Argument(String),
    /// The error of a stage or a factory that is not part of this workspace.
    #[error(transparent)]
    External(Box<dyn std::error::Error + Send + Sync>),
    /// A callback returned `Break`.
    #[error("interrupted")]
    Interrupted,
}

impl Error {
    /// An error of a part that is not of this workspace.
    pub fn external(error: impl Into<Box<dyn std::error::Error + Send + Sync>>) -> Self {
        Self::External(error.into())
    }

    /// A file that can't be read.
    pub(crate) fn read(path: &Path) -> impl FnOnce(std::io::Error) -> Self {
        |source| Self::Prior(mde_prior::Error::Read { path: path.to_owned(), source })
    }
}

/// Arguments that texts of the library name in braces.
const ARGUMENTS: &str = "alignment calibration depth-range fov interval intrinsics keep-field max-memory max-size model-profile \
                         png-scale predictions prior-kind prior-model same-scale scale-from unit views work-size";

/// A text with the arguments that it names in braces, such as `{max-memory}`, as `name` writes them.
pub fn named(text: &str, name: impl Fn(&str) -> String) -> String {
    ARGUMENTS.split(' ').fold(text.to_owned(), |text, argument| match format!("{{{argument}}}") {
        braced if text.contains(&braced) => text.replace(&braced, &name(argument)),
        _ => text,
    })
}

/// An error and its causes, without those that its text contains already.
pub(crate) fn text(error: &dyn std::error::Error) -> String {
    let causes = std::iter::successors(error.source(), |error| error.source()).map(ToString::to_string);
    causes.fold(
        error.to_string(),
        |text, cause| if text.contains(&cause) { text } else { format!("{text}: {cause}") },
    )
}

impl From<mde_nerf::Error> for Error {
    fn from(error: mde_nerf::Error) -> Self {
        match error {
            mde_nerf::Error::Interrupted => Self::Interrupted,
            other => Self::Field(other),
        }
    }
}

impl From<mde_mvs::Error> for Error {
    fn from(error: mde_mvs::Error) -> Self {
        match error {
            mde_mvs::Error::Interrupted => Self::Interrupted,
            other => Self::MultiView(other),
        }
    }
}

/// Shorthand for this crate's results.
pub type Result<T, E = Error> = std::result::Result<T, E>;
