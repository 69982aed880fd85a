//! The camera of the command line.

use crate::program::args::CameraArgs;
use anyhow::Result;
use crate::naming::Naming;
use crate::scene::camera::GivenCamera;
pub(crate) use crate::scene::camera::{CameraSource, KnownCamera};

/// The camera of an image of that size, `[width, height]`.
pub(crate) fn of_size(args: &CameraArgs, focal_35mm: Option<f64>, size: [usize; 2]) -> Result<KnownCamera> {
    let given = match (&args.intrinsics, args.fx, args.fov) {
        (Some(path), ..) => GivenCamera::File { path: path.clone(), base: args.intrinsics_base },
        (None, Some(fx), _) => GivenCamera::Intrinsics { fx, fy: args.fy, cx: args.cx, cy: args.cy },
        (None, None, Some(fov)) => GivenCamera::FieldOfView(fov),
        (None, None, None) => GivenCamera::Nothing,
    };
    Ok(KnownCamera::new(&given, focal_35mm, size, Naming::Flags)?)
}
