use super::files::Scenes;
use super::{DataSet, Sample};
use crate::Result;
use crate::scene::{CaptureConfig, Room, World, room};

/// Every [procedural room](crate::scene) with one seed, at one size.
#[derive(Debug, Clone)]
pub struct Rooms {
    scenes: Scenes<Room>,
    seed: u64,
    width: usize,
    height: usize,
}

impl Rooms {
    /// The rooms with a seed, in images of `width` by `height` pixels.
    pub fn new(seed: u64, width: usize, height: usize) -> Self {
        let scenes = Room::ALL.into_iter().map(|room| (format!("{room}-{seed}"), room)).collect();
        Self { scenes, seed, width, height }
    }
}

impl DataSet for Rooms {
    fn ids(&self) -> &[String] {
        &self.scenes.ids
    }

    fn load(&self, index: usize) -> Result<Sample> {
        let (kind, id) = self.scenes.get(index)?;
        let scene = room(*kind, self.seed, self.width, self.height)?;
        Ok(Sample::new(id, scene.image, scene.depth, scene.camera))
    }
}

/// Every [procedural room](crate::scene), photographed several times under every combination of some conditions.
#[derive(Debug, Clone)]
pub struct Captures {
    scenes: Scenes<(Room, CaptureConfig)>,
    width: usize,
    height: usize,
}

/// The conditions of [`Captures`]: every combination of the lists, in every room.
#[derive(Debug, Clone, PartialEq)]
pub struct CaptureGrid {
    /// [`CaptureConfig::views`].
    pub views: Vec<usize>,
    /// [`CaptureConfig::baseline`].
    pub baselines: Vec<f64>,
    /// [`CaptureConfig::pose_noise`], degrees.
    pub pose_noises: Vec<f64>,
    /// [`CaptureConfig::gain`].
    pub gains: Vec<f64>,
}

impl Default for CaptureGrid {
    /// The one condition of [`CaptureConfig::default`].
    fn default() -> Self {
        let CaptureConfig { views, baseline, pose_noise, gain, .. } = CaptureConfig::default();
        Self {
            views: vec![views],
            baselines: vec![baseline],
            pose_noises: vec![pose_noise],
            gains: vec![gain],
        }
    }
}

impl Captures {
    /// The rooms with a seed under the conditions of a grid, in photographs of `width` by `height` pixels.
    ///
    /// # Errors
    /// [`Error::Config`](crate::Error::Config) for a condition out of range.
    pub fn new(grid: &CaptureGrid, seed: u64, width: usize, height: usize) -> Result<Self> {
        let mut scenes = Vec::new();
        for room in Room::ALL {
            for (&views, &baseline) in product(&grid.views, &grid.baselines) {
                for (&pose_noise, &gain) in product(&grid.pose_noises, &grid.gains) {
                    let config = CaptureConfig { views, baseline, pose_noise, gain, seed };
                    config.validate()?;
                    let id = format!("{room}-{seed}/{views}-views-b{baseline}-noise{pose_noise}-gain{gain}");
                    scenes.push((id, (room, config)));
                }
            }
        }
        Ok(Self { scenes: scenes.into_iter().collect(), width, height })
    }
}

fn product<'l, A, B>(first: &'l [A], second: &'l [B]) -> impl Iterator<Item = (&'l A, &'l B)> {
    first.iter().flat_map(move |a| second.iter().map(move |b| (a, b)))
}

impl DataSet for Captures {
    fn ids(&self) -> &[String] {
        &self.scenes.ids
    }

    fn place(&self, index: usize) -> Option<&str> {
        self.scenes.ids.get(index)?.split('/').next()
    }

    fn load(&self, index: usize) -> Result<Sample> {
        let ((room, config), id) = self.scenes.get(index)?;
        Sample::of_capture(World::new(*room, config.seed)?.capture(id, config, self.width, self.height)?)
    }
}
