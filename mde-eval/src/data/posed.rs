use super::files::{Scenes, layout, read_json};
use super::truth::TrueDepth;
use super::{DataSet, Sample};
use crate::Result;
use crate::capture::{Capture, CapturedView, POSE_NOISES, disturbed};
use crate::error::check;
use mde_mvs::capture::{PixelCentres, read_transforms};
use mde_prior::photo::{image_size, read_image};
use mde_uncertainty::random::derived_seed;
use mde_uncertainty::statistics::median;
use serde::Deserialize;
use serde_json::Value;
use std::path::{Path, PathBuf};

/// Photographs of scenes with poses, and the true depth of one of them: `SET/SCENE/` with a `transforms.json` and a `scene.json`.
///
/// `transforms.json` is nerfstudio's ([`read_transforms`]: camera to world, OpenGL axes, metres; pixel centres at integers) with
/// two more fields: `depth_units_per_metre` (1000 without it), and a `depth_file_path` for the reference, a 16-bit PNG of
/// z-depth, 0 = missing, registered to the photograph. The fields of `scene.json` are optional and others are ignored:
///
/// | field | meaning |
/// | --- | --- |
/// | `reference` | index into `frames` of the photograph that is refined; 0 without it |
/// | `extra_views` | indices of the further photographs; all others without it |
/// | `set` | name of the place; the folder of the scene's folder without it |
/// | `max_depth` | largest reliable depth, metres; without it 10 where the median true depth is below 5, else 80 |
///
/// Lens distortion is removed from the photographs, bilinearly, and from the truth, by the nearest pixel. Only the depth of the
/// reference is read, whatever other depths lie there.
#[derive(Debug, Clone)]
pub struct Posed {
    scenes: Scenes,
    places: Vec<String>,
    pose_noise: f64,
}

/// Content of a `scene.json`; see [`Posed`] for its fields.
#[derive(Debug, Clone, PartialEq, Default, Deserialize)]
#[serde(default)]
struct Description {
    reference: usize,
    extra_views: Option<Vec<usize>>,
    set: Option<String>,
    max_depth: Option<f64>,
}

impl Posed {
    const TRANSFORMS: &'static str = "transforms.json";
    const DESCRIPTION: &'static str = "scene.json";

    /// Finds the scenes at or below a folder. The given poses of the further photographs are off by `pose_noise` degrees of rotation
    /// about a random axis, and by 20 mm per degree in a random direction, the same in every run.
    ///
    /// # Errors
    /// [`Error::Io`](crate::Error::Io) for a folder or a `scene.json` that cannot be read, [`Error::Layout`](crate::Error::Layout) where there is no scene or a
    /// `scene.json` is not valid, [`Error::Config`](crate::Error::Config) for degrees below 0 or above 10.
    pub fn open(root: impl AsRef<Path>, pose_noise: f64) -> Result<Self> {
        check([("pose-noise", pose_noise, POSE_NOISES.contains(&pose_noise), "use 0 to 10 degrees")])?;
        let what =
            "folder with a `transforms.json` and a `scene.json`; name the data set's folder or one below it";
        let scenes = Scenes::find(root.as_ref(), Self::is_scene, what)?;
        let place = |(scene, id): (&PathBuf, &String)| {
            let parent =
                || scene.parent().and_then(Path::file_name).map(|name| name.to_string_lossy().into_owned());
            Ok(describe(scene)?.set.or_else(parent).unwrap_or_else(|| id.clone()))
        };
        let places = scenes.sources.iter().zip(&scenes.ids).map(place).collect::<Result<_>>()?;
        Ok(Self { scenes, places, pose_noise })
    }

    pub(super) fn is_scene(folder: &Path) -> bool {
        folder.join(Self::TRANSFORMS).is_file() && folder.join(Self::DESCRIPTION).is_file()
    }

    /// Loads a capture by its index in [`DataSet::ids`], in the frame of its reference's camera.
    ///
    /// # Errors
    /// As [`DataSet::load`]; [`Error::Capture`](crate::Error::Capture) for a `transforms.json` or photographs that cannot be used.
    pub fn capture(&self, index: usize) -> Result<Capture> {
        let (scene, id) = self.scenes.get(index)?;
        let description = describe(scene)?;
        let path = scene.join(Self::TRANSFORMS);
        let fault = |reason: String| layout(&path, reason);
        let read =
            read_transforms(&path, PixelCentres::Integers, &|photograph: &Path| image_size(photograph))?;
        if let Some(photograph) = read.unreadable.first() {
            return Err(fault(format!("photograph {} is missing or no image", photograph.display())));
        }
        let depths: Value = read_json(&path)?;
        let frames = read.frames.len();
        let reference = description.reference;
        let further = description.extra_views.unwrap_or_else(|| (0..frames).collect());
        let order = std::iter::once(reference).chain(further.into_iter().filter(|frame| *frame != reference));
        let view = |index: usize| {
            let frame = read.frames.get(index).ok_or_else(|| {
                fault(format!("has {frames} frames, but scene.json names frame {index}, counted from 0"))
            })?;
            let mut view = frame.view(read_image(&frame.photograph)?.pixels.view())?;
            view.pose *= read.frames[reference].pose.inverse();
            Ok(CapturedView { view, prior: None, true_pose: None })
        };
        let views = order.map(view).collect::<Result<Vec<_>>>()?;
        let frame = &read.frames[reference];
        let truth = TrueDepth::of_frame(&path, &depths, frame)?
            .ok_or_else(|| fault(format!("names no depth_file_path for {}", frame.photograph.display())))?;
        let truth = truth.read()?;
        let middle = median(truth.iter().copied().filter(|z| *z > 0.0));
        let usual = if middle.is_some_and(|z| z < 5.0) { 10.0 } else { 80.0 };
        let trusted_depth = description.max_depth.unwrap_or(usual);
        let mut capture = Capture { id: id.to_owned(), views, truth, trusted_depth };
        let seed = derived_seed(0, id, 0);
        for (index, captured) in capture.views.iter_mut().enumerate().skip(1) {
            captured.view.pose = disturbed(&captured.view.pose, self.pose_noise, seed, index);
        }
        Ok(capture)
    }
}

fn describe(scene: &Path) -> Result<Description> {
    let path = scene.join(Posed::DESCRIPTION);
    let description: Description = read_json(&path)?;
    match description.max_depth.filter(|z| !(*z > 0.0 && z.is_finite())) {
        Some(z) => Err(layout(&path, format!("max_depth is {z}; use a positive finite number of metres"))),
        None => Ok(description),
    }
}

impl DataSet for Posed {
    fn ids(&self) -> &[String] {
        &self.scenes.ids
    }

    fn place(&self, index: usize) -> Option<&str> {
        self.places.get(index).map(String::as_str)
    }

    fn load(&self, index: usize) -> Result<Sample> {
        Sample::of_capture(self.capture(index)?)
    }
}
