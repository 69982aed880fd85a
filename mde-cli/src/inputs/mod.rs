//! What a run is given beside its settings: the camera, the sizes, the origin of the prior, known depths.

mod bound;
mod camera;
mod known;
mod opened;
mod origin;
mod prior;
pub mod size;

pub use bound::BoundPrior;
pub use camera::{CameraSource, GivenCamera, KnownCamera};
pub use known::{Known, Scaled};
pub use opened::{Full, Opened, Sizes};
pub use origin::{PriorForm, PriorOrigin};
pub use prior::{MapFile, Resampled, read_options};
#[cfg(feature = "onnx")]
pub use prior::{NetworkFormat, NetworkSpec, open_network};
