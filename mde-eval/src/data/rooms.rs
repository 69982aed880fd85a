use super::{DataSet, Sample, out_of_range};
use crate::Result;
use crate::scene::{self, Room};

/// Every [procedural room](crate::scene) with one seed, at one size.
#[derive(Debug, Clone)]
pub struct Rooms {
    ids: Vec<String>,
    seed: u64,
    width: usize,
    height: usize,
}

impl Rooms {
    /// The rooms with a seed, in images of `width` by `height` pixels.
    pub fn new(seed: u64, width: usize, height: usize) -> Self {
        Self { ids: Room::ALL.iter().map(|room| format!("{room}-{seed}")).collect(), seed, width, height }
    }
}

impl DataSet for Rooms {
    fn ids(&self) -> &[String] {
        &self.ids
    }

    fn load(&self, index: usize) -> Result<Sample> {
        let (Some(&room), Some(id)) = (Room::ALL.get(index), self.ids.get(index)) else {
            return Err(out_of_range(index, self.ids.len()));
        };
        let scene = scene::room(room, self.seed, self.width, self.height)?;
        Ok(Sample::new(id, scene.image, scene.depth, scene.camera))
    }
}
