//! What a run is given beside its settings: the camera, the sizes, the origin of the prior, known depths.

mod camera;
mod known;
mod origin;
mod prior;
pub mod size;

pub use camera::{CameraSource, GivenCamera, KnownCamera};
pub use known::{Known, Scaled};
pub use origin::{PriorForm, PriorOrigin};
pub use prior::{MapFile, Resampled, read_options};
#[cfg(feature = "onnx")]
pub use prior::{NetworkFormat, open_network};
