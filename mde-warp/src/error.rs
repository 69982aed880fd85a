use mde_uncertainty::OutOfRange;
/// Errors of cameras, poses, views and the settings of a warp.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// An intrinsic parameter, or a size, of a [`PinholeCamera`](crate::PinholeCamera).
    #[error("camera {field} is {value}; it must be {need}")]
    Camera {
        /// Name of the parameter.
        field: &'static str,
        /// The value at fault.
        value: f64,
        /// The values that are allowed.
        need: &'static str,
    },
    /// An array whose shape is not that of its camera.
    #[error("{what} has shape {found:?}, its camera has {expected:?}; resize one to the other")]
    Shape {
        /// Name of the array.
        what: &'static str,
        /// Its shape.
        found: Vec<usize>,
        /// The shape of the camera's maps.
        expected: Vec<usize>,
    },
    /// A colour that is NaN or infinite.
    #[error("image at row {row}, column {column}, channel {channel} is {value}; colours must be finite")]
    Colour {
        /// Row of the pixel.
        row: usize,
        /// Column of the pixel.
        column: usize,
        /// 0, 1, 2 for red, green, blue.
        channel: usize,
        /// The value at fault.
        value: f32,
    },
    /// A pose with a NaN or infinite component.
    #[error("the {which} pose is not finite; give a rotation and a translation of finite numbers")]
    Pose {
        /// Which pose of the call.
        which: &'static str,
    },
    /// A setting out of its range.
    #[error(transparent)]
    Config(#[from] OutOfRange),
    /// A depth map that [`GaussianDepth`](mde_uncertainty::GaussianDepth) refuses.
    #[error(transparent)]
    Depth(#[from] mde_uncertainty::Error),
}

/// Shorthand for this crate's results.
pub type Result<T, E = Error> = std::result::Result<T, E>;

/// An [`OutOfRange`] unless `value` is a number in `ends`, both included.
pub(crate) fn in_range(field: &'static str, value: f64, ends: [f64; 2], remedy: &'static str) -> Result<()> {
    Ok(OutOfRange::check((ends[0]..=ends[1]).contains(&value), field, &value, remedy)?)
}
