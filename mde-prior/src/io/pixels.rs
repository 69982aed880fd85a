//! The pixels of a photograph: in memory, or read from its file when they are needed.

use crate::{Error, Result};
use ndarray::{ArcArray, Ix3};
use std::collections::VecDeque;
use std::fmt::{Debug, Formatter};
use std::sync::{Arc, Mutex, PoisonError};

/// Images that [`Recent`] keeps: all of a short capture.
pub const RECENT: usize = 32;

/// sRGB in 0 to 1, `[height, width, 3]`; clones share it.
pub type Image = ArcArray<f32, Ix3>;

/// The pixels of a photograph, wherever they are.
#[derive(Clone)]
pub struct Pixels {
    size: (usize, usize),
    content: Option<u32>,
    read: Arc<dyn Fn() -> Result<Image> + Send + Sync>,
}

impl Pixels {
    /// Those of an image that `read` gives again, unless it is among the `recent` by its file's name.
    pub fn in_file(
        image: Image,
        (recent, name): (&Recent, String),
        read: impl Fn() -> Result<Image> + Send + Sync + 'static,
    ) -> Self {
        let (recent, (height, width, _), content) = (recent.clone(), image.dim(), checksum(&image));
        _ = recent.image(&name, || Ok(image));
        let read = move || {
            let image = recent.image(&name, &read)?;
            let changed = || Error::Input(format!("{name}: has changed since the run began; start again"));
            (image.dim() == (height, width, 3)).then_some(image).ok_or_else(changed)
        };
        Self { size: (height, width), content: Some(content), read: Arc::new(read) }
    }

    /// `(height, width)`.
    pub fn size(&self) -> (usize, usize) {
        self.size
    }

    /// Whether they are in a file, whose decoder gives no colour that is not finite.
    pub fn are_in_file(&self) -> bool {
        self.content.is_some()
    }

    /// The image.
    ///
    /// # Errors
    /// That of a file that can't be read any more, and [`Error::Input`] where its size has changed.
    pub fn read(&self) -> Result<Image> {
        (self.read)()
    }

    /// CRC-32 of the pixels; of a file when it was opened.
    ///
    /// # Errors
    /// Those of [`read`](Self::read).
    pub fn content(&self) -> Result<u32> {
        self.content.map_or_else(|| Ok(checksum(&self.read()?)), Ok)
    }
}

fn checksum(image: &Image) -> u32 {
    let mut hasher = crc32fast::Hasher::new();
    image.iter().for_each(|value| hasher.update(&value.to_le_bytes()));
    hasher.finalize()
}

impl<I: Into<Image>> From<I> for Pixels {
    fn from(image: I) -> Self {
        let image = image.into();
        let (height, width, _) = image.dim();
        Self { size: (height, width), content: None, read: Arc::new(move || Ok(image.clone())) }
    }
}

impl Debug for Pixels {
    fn fmt(&self, f: &mut Formatter<'_>) -> std::fmt::Result {
        write!(f, "Pixels({:?})", self.size)
    }
}

/// The images of a capture that were used last, by the names of their files; clones share them.
#[derive(Debug, Clone, Default)]
pub struct Recent(Arc<Mutex<VecDeque<(String, Image)>>>);

impl Recent {
    /// The image of that name, read if it is not kept.
    fn image(&self, name: &str, read: impl FnOnce() -> Result<Image>) -> Result<Image> {
        let lock = || self.0.lock().unwrap_or_else(PoisonError::into_inner);
        let kept = lock().iter().find(|(other, _)| other == name).map(|(_, image)| image.clone());
        // Not under the lock: a thread that waits for it may have to decode.
        let image = kept.map_or_else(read, Ok)?;
        let mut kept = lock();
        kept.retain(|(other, _)| other != name);
        kept.push_back((name.to_owned(), image.clone()));
        if kept.len() > RECENT {
            kept.pop_front();
        }
        Ok(image)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use ndarray::Array3;
    use std::sync::atomic::{AtomicUsize, Ordering::Relaxed};

    #[test]
    fn the_last_images_are_kept_and_others_read_again() {
        static READS: AtomicUsize = AtomicUsize::new(0);
        static WIDTH: AtomicUsize = AtomicUsize::new(3);
        let recent = Recent::default();
        let pixels = |index: usize| {
            let read = move || Array3::from_elem((2, WIDTH.load(Relaxed), 3), index as f32).into_shared();
            Pixels::in_file(read(), (&recent, format!("{index}.jpg")), move || {
                READS.fetch_add(1, Relaxed);
                Ok(read())
            })
        };
        let all: Vec<Pixels> = (0..RECENT + 2).map(pixels).collect();
        for (index, reads) in [(2, 0), (RECENT + 1, 0), (0, 1), (0, 1), (3, 2)] {
            assert!(all[index].read().unwrap().iter().all(|value| *value == index as f32));
            assert_eq!(READS.load(Relaxed), reads, "{index}");
        }
        WIDTH.store(4, Relaxed);
        assert!(all[4].read().unwrap_err().to_string().starts_with("4.jpg: has changed"));
        let held = Pixels::from(Array3::from_elem((2, 3, 3), 5.0));
        assert_eq!((held.size(), held.content().unwrap()), ((2, 3), all[5].content().unwrap()));
    }
}
