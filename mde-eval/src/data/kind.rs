use super::files::{find_scenes, layout};
use super::{CaptureGrid, Captures, DataSet, Nyu, PlainFolders, Posed, Resized, Rooms, SunRgbd};
use crate::{Error, Result};
use mde_uncertainty::OutOfRange;
use serde::Serialize;
use std::fmt;
use std::path::Path;
use std::str::FromStr;

/// The data sets that are known by name: `sunrgbd`, `nyu`, `plain`, `rooms`, `captures` and `posed`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum DataSetKind {
    /// [`SunRgbd`].
    SunRgbd,
    /// [`Nyu`].
    Nyu,
    /// [`PlainFolders`].
    Plain,
    /// [`Rooms`].
    Rooms,
    /// [`Captures`].
    Captures,
    /// [`Posed`].
    Posed,
}

impl DataSetKind {
    /// All of them.
    pub const ALL: [Self; 6] =
        [Self::SunRgbd, Self::Nyu, Self::Plain, Self::Rooms, Self::Captures, Self::Posed];

    /// The data set whose layout a folder has.
    ///
    /// # Errors
    /// [`Error::Io`] for a folder that cannot be read, [`Error::Layout`] where no layout or more than one fits.
    pub fn guess(root: &Path) -> Result<Self> {
        let has = |is: fn(&Path) -> bool| find_scenes(root, is).map(|found| !found.is_empty());
        if has(Posed::is_scene)? {
            return Ok(Self::Posed);
        }
        if has(|folder| folder.join("scene.json").is_file())? {
            return Ok(Self::Plain);
        }
        if has(|folder| SunRgbd::is_scene(folder) && folder.join("intrinsics.txt").is_file())? {
            return Ok(Self::SunRgbd);
        }
        if has(Nyu::is_recording)? {
            return Ok(Self::Nyu);
        }
        let reason = if has(Nyu::is_side_by_side)? {
            "could be one of several data sets; name it (`sunrgbd` or `nyu`)"
        } else {
            "has the layout of no known data set; write a `scene.json` beside `color.png` and `depth.png`"
        };
        Err(layout(root, reason))
    }
}

impl fmt::Display for DataSetKind {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.serialize(f)
    }
}

impl FromStr for DataSetKind {
    type Err = Error;

    fn from_str(name: &str) -> Result<Self> {
        Self::ALL.into_iter().find(|kind| kind.to_string() == name).ok_or_else(|| Error::Unknown {
            what: "data set",
            name: name.to_owned(),
            known: Self::ALL.map(|kind| kind.to_string()).join(", "),
        })
    }
}

/// How a data set is opened by [`open`].
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Options {
    /// Horizontal field of view of scenes without a camera, degrees; they are refused without it.
    pub assumed_fov: Option<f64>,
    /// Width and height to resize to; their own without. Rooms are made in this size, 640 x 480 without.
    pub size: Option<[usize; 2]>,
    /// The conditions of [`Captures`].
    pub captures: CaptureGrid,
    /// Error of the given poses of [`Posed`], degrees.
    pub pose_noise: f64,
}

/// Opens a data set by its name; rooms have the seed 0.
///
/// # Errors
/// As the data set's own `open`; [`Error::Config`] where a folder is missing or, for rooms, named.
pub fn open(kind: DataSetKind, root: Option<&Path>, options: &Options) -> Result<Box<dyn DataSet>> {
    let fault = |value: String, remedy| Err(OutOfRange::new("the data set's folder", value, remedy).into());
    let fov = options.assumed_fov;
    let [width, height] = options.size.unwrap_or([640, 480]);
    let data: Box<dyn DataSet> = match (kind, root) {
        (DataSetKind::Rooms, None) => Box::new(Rooms::new(0, width, height)),
        (DataSetKind::Captures, None) => Box::new(Captures::new(&options.captures, 0, width, height)?),
        (DataSetKind::Rooms | DataSetKind::Captures, Some(root)) => {
            return fault(root.display().to_string(), "leave it out: rooms are rendered, not read");
        }
        (_, None) => return fault("missing".to_owned(), "name it"),
        (DataSetKind::SunRgbd, Some(root)) => Box::new(SunRgbd::open(root, fov)?),
        (DataSetKind::Posed, Some(root)) => Box::new(Posed::open(root, options.pose_noise)?),
        (DataSetKind::Nyu, Some(root)) => Box::new(Nyu::open(root)?),
        (DataSetKind::Plain, Some(root)) => Box::new(PlainFolders::open(root, fov)?),
    };
    Ok(match options.size {
        // Rooms are made in the size.
        Some(_) if root.is_some() => Box::new(Resized::new(data, width, height)?),
        _ => data,
    })
}
