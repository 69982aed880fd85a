//! The files of a result.

use crate::error::Result;
use crate::output::preview::{Preview, preview};
use crate::refiner::depth_png::{DepthPng, write_confidence};
use mde_prior::format::{write_npy, write_npz};
use mde_prior::photo::{write_image, write_rgb_png};
use mde_uncertainty::GaussianDepth;
use ndarray::{Array3, ArrayView2, ArrayView3};
use rayon::prelude::*;
use std::path::Path;

/// `[height, width]` arrays `origin` (0 none, 1 prior, 2 consensus, 3 field), `seen` and `confirmed` (numbers of photographs).
pub const EVIDENCE: &str = "evidence.npz";

/// What the folder of every result has; maps are `[height, width]`.
pub struct Maps<'m> {
    /// The refined depth.
    pub depth: &'m GaussianDepth,
    /// Its standard deviation.
    pub sigma: ArrayView2<'m, f32>,
    /// The monocular depth.
    pub prior: ArrayView2<'m, f32>,
    /// Further maps by the names of their files: `lower` and `upper`, `gt`.
    pub more: &'m [(&'m str, ArrayView2<'m, f32>)],
    /// Of several photographs, by the names of its arrays.
    pub evidence: &'m [(&'m str, ArrayView2<'m, f32>)],
    /// The photograph, sRGB in 0 to 1, `[height, width, 3]`.
    pub image: ArrayView3<'m, f32>,
    /// Of several photographs, by the names of their files.
    pub pictures: &'m [(String, Array3<u8>)],
    /// The [`strip`](super::preview::strip) of the preview.
    pub strip: &'m [Array3<f32>],
    /// The truth of the preview.
    pub truth: Option<ArrayView2<'m, f32>>,
    /// Unit and scale of `depth.png`.
    pub png: &'m DepthPng,
}

impl Maps<'_> {
    /// Writes them into a folder, with that of the pictures.
    ///
    /// # Errors
    /// [`Error::Prior`](crate::error::Error::Prior) for a file that can't be written, [`Error::Io`](crate::error::Error::Io) for the folder of the
    /// pictures.
    pub fn write(&self, folder: &Path) -> Result<()> {
        let Self { depth, sigma, prior, image, .. } = *self;
        let show = Preview {
            image,
            prior,
            refined: depth.mean(),
            sigma,
            unit: self.png.unit,
            strip: self.strip,
            truth: self.truth,
        };
        let mut maps = vec![("depth", depth.mean()), ("sigma", sigma), ("prior", prior)];
        maps.extend(self.more);
        let mut files: Vec<Box<dyn Fn() -> Result<()> + Sync + Send + '_>> = vec![
            Box::new(|| Ok(write_rgb_png(folder.join("preview.png"), preview(&show).pixels())?)),
            Box::new(|| Ok(write_image(folder.join("image.png"), image)?)),
            Box::new(|| self.png.write(&folder.join("depth.png"), depth.mean())),
            Box::new(|| write_confidence(&folder.join("confidence.png"), depth)),
        ];
        for (name, map) in maps {
            files.push(Box::new(move || Ok(write_npy(folder.join(format!("{name}.npy")), map)?)));
        }
        // Side by side: of a photograph of 12 megapixels they take seconds.
        files.par_iter().try_for_each(|write| write())?;
        if !self.pictures.is_empty() {
            let path = folder.join(crate::refiner::finish::PICTURES);
            std::fs::create_dir_all(&path).map_err(|source| crate::error::Error::Io { path, source })?;
        }
        for (name, picture) in self.pictures {
            write_rgb_png(folder.join(name), picture.view())?;
        }
        if !self.evidence.is_empty() {
            write_npz(folder.join(EVIDENCE), self.evidence)?;
        }
        Ok(())
    }
}
