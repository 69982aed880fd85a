//! The files of a result.

use crate::error::{Error, Result};
use crate::output::export::{self, Format, Placed, colmap, subfolder, transforms};
use crate::output::preview::{preview, thumbnail};
use crate::refiner::finish::{Other, PICTURES};
use crate::scene::size::byte;
use mde_mvs::cloud::DepthView;
use mde_mvs::export::{glb, ply};
use mde_prior::CertaintyMeaning;
use mde_prior::format::{
    DepthPng, confidence, confidence_formula, write_confidence_png, write_depth_png, write_exr, write_npy,
    write_npz,
};
use mde_prior::photo::{encode_rgb_png, write_image, write_rgb_png};
use mde_prior::write_atomic;
use mde_uncertainty::GaussianDepth;
use mde_uncertainty::pooled::Tails;
use mde_warp::{PinholeCamera, Pose, WarpConfig, forward_warp};
use ndarray::{Array3, ArrayView2, ArrayView3};
use rayon::prelude::*;
use std::path::Path;

/// `[height, width]` arrays `origin` (0 none, 1 prior, 2 consensus, 3 field), `seen` and `confirmed` (numbers of photographs).
pub const EVIDENCE: &str = "evidence.npz";
/// Photograph, depth and sigma / depth, small.
pub const THUMBNAIL: &str = "thumbnail.png";

/// A map by its name, `[height, width]`.
pub type Named<'r> = (&'r str, ArrayView2<'r, f32>);

/// What the files of a result are made of; maps are `[height, width]`.
pub struct ResultFiles<'r> {
    /// The refined depth.
    pub depth: &'r GaussianDepth,
    /// Its standard deviation.
    pub sigma: ArrayView2<'r, f32>,
    /// The monocular depth; 0 where missing.
    pub prior: ArrayView2<'r, f32>,
    /// The photograph, sRGB in 0 to 1, `[height, width, 3]`.
    pub image: ArrayView3<'r, f32>,
    /// The camera of the maps.
    pub camera: PinholeCamera,
    /// Unit and scale of `depth.png`.
    pub png: DepthPng,
    /// What only some results have.
    pub beside: Beside<'r>,
}

/// What only some results have.
#[derive(Default)]
pub struct Beside<'r> {
    /// Further maps by the names of their files: `lower` and `upper`, `gt`.
    pub more: Vec<Named<'r>>,
    /// The components of sigma.
    pub components: Vec<Named<'r>>,
    /// How sure the network itself is.
    pub certainty: Option<(CertaintyMeaning, ArrayView2<'r, f32>)>,
    /// The arrays of [`EVIDENCE`], of several photographs.
    pub evidence: Vec<Named<'r>>,
    /// Of several photographs, by the names of their files.
    pub pictures: Vec<(String, Array3<u8>)>,
    /// The other photographs of a model of all.
    pub others: Vec<Other>,
    /// The [`strip`](super::preview::strip) of the preview; empty for one photograph.
    pub strip: Vec<Array3<f32>>,
    /// The truth of the preview; shown beside several photographs.
    pub truth: Option<ArrayView2<'r, f32>>,
}

impl ResultFiles<'_> {
    /// Writes what every folder of a result has, and the folder of the pictures.
    ///
    /// # Errors
    /// [`Error::Prior`] for a file or folder that can't be written.
    pub fn write(&self, folder: &Path) -> Result<()> {
        let Self { depth, sigma, prior, image, ref beside, .. } = *self;
        let mut maps = vec![("depth", depth.mean()), ("sigma", sigma), ("prior", prior)];
        maps.extend(&beside.more);
        let mut files: Vec<Box<dyn Fn() -> mde_prior::Result<()> + Sync + Send + '_>> = vec![
            Box::new(|| write_rgb_png(folder.join("preview.png"), preview(self).view())),
            Box::new(|| write_rgb_png(folder.join(THUMBNAIL), thumbnail(self).view())),
            Box::new(|| write_image(folder.join(export::IMAGE), image)),
            Box::new(|| {
                let (path, DepthPng { unit, scale, .. }) = (folder.join("depth.png"), self.png);
                write_depth_png(path, depth.mean(), unit, scale).map(drop)
            }),
            Box::new(|| self.write_confidence(folder, depth)),
        ];
        for (name, map) in maps {
            files.push(Box::new(move || write_npy(folder.join(format!("{name}.npy")), map)));
        }
        // Side by side: of a photograph of 12 megapixels they take seconds.
        files.par_iter().try_for_each(|write| write())?;
        if !beside.pictures.is_empty() {
            subfolder(folder, PICTURES)?;
        }
        for (name, picture) in &beside.pictures {
            write_rgb_png(folder.join(name), picture.view())?;
        }
        if !beside.evidence.is_empty() {
            write_npz(folder.join(EVIDENCE), &beside.evidence)?;
        }
        Ok(())
    }

    /// Writes the files of a format for other programs; their world is the frame of the camera.
    ///
    /// # Errors
    /// [`Error::Prior`] or [`Error::External`] for a file that can't be written.
    pub fn export(&self, format: Format, folder: &Path) -> Result<()> {
        let (view, unit) = (self.view(), self.png.unit);
        let surest = matches!(format, Format::Ply | Format::Glb).then(|| view.surest());
        let sure = DepthView { depth: surest.as_ref().map_or(view.depth, |depth| depth.view()), ..view };
        match format {
            Format::Ply => {
                let confirmed = self.beside.evidence.iter().find(|(name, _)| *name == "confirmed");
                let points = ply::encode(&sure, confirmed.map(|(_, map)| *map), unit);
                write_atomic(&folder.join("cloud.ply"), &points)?;
            }
            Format::Exr => {
                // OpenCV reads a luminance or colours alone; Nuke and Blender look for Z.
                let (depth, sigma) = (view.depth, view.sigma);
                let channels = [("Y", depth), ("Z", depth), ("sigma", sigma), ("prior", self.prior)];
                write_exr(folder.join("depth.exr"), &channels)?;
            }
            Format::Colmap => colmap::write(folder, &view, &self.beside.others)?,
            Format::ColmapDense | Format::Mesh => {
                let text = "export: colmap-dense and mesh are of a whole capture; refine all of its photographs, or give colmap or glb";
                return Err(Error::Argument(text.to_owned()));
            }
            Format::Glb => {
                let png = encode_rgb_png(view.image.mapv(byte).view())?;
                write_atomic(&folder.join("mesh.glb"), &glb::encode(&sure, png, unit))?;
            }
            Format::Transforms => {
                let place = |other: &Other| format!("transforms/{}", other.name.trim_end_matches(".png"));
                let places: Vec<String> = self.beside.others.iter().map(place).collect();
                let placed =
                    |camera, pose, folder| Placed { camera, pose, folder, png_scale: self.png.scale };
                let mut views = vec![placed(view.camera, view.pose, "")];
                for (other, place) in self.beside.others.iter().zip(&places) {
                    self.write_warped(&subfolder(folder, place)?, other)?;
                    views.push(placed(other.camera, other.pose, place));
                }
                transforms::write(&folder.join(transforms::FILE), &views)?;
            }
            Format::Sigma => {
                let parts = subfolder(folder, "sigma")?;
                for (name, sigma) in &self.beside.components {
                    write_npy(parts.join(format!("{name}.npy")), *sigma)?;
                }
                if let Some((meaning, map)) = self.beside.certainty {
                    write_npy(parts.join(format!("network-{}.npy", meaning.name())), map)?;
                }
            }
            // Whoever has the field writes it.
            Format::Field => {}
        }
        Ok(())
    }

    /// The picture of another photograph, and the depth and its sigma warped into it; missing where this photograph does not show it.
    fn write_warped(&self, folder: &Path, other: &Other) -> Result<()> {
        let view = self.view();
        let (from, to) = ((&view.camera, &view.pose), (&other.camera, &other.pose));
        let warped =
            forward_warp(view.image, self.depth, from.0, from.1, to.0, to.1, &WarpConfig::default())?;
        let [depth] = warped.view.hypotheses.as_slice() else { return Ok(()) };
        write_rgb_png(folder.join(export::IMAGE), other.picture.view())?;
        write_depth_png(folder.join("depth.png"), depth.mean(), self.png.unit, self.png.scale)?;
        write_npy(folder.join("depth.npy"), depth.mean())?;
        write_npy(folder.join("sigma.npy"), depth.sigma().view())?;
        Ok(self.write_confidence(folder, depth)?)
    }

    fn write_confidence(&self, folder: &Path, depth: &GaussianDepth) -> mde_prior::Result<()> {
        let tails = if self.beside.evidence.is_empty() { Tails::Normal } else { Tails::Heavy };
        let (path, map) = (folder.join("confidence.png"), confidence(depth, tails));
        write_confidence_png(path, map.view(), confidence_formula(tails))
    }

    /// The photograph in the frame of its camera.
    pub(super) fn view(&self) -> DepthView<'_> {
        DepthView {
            image: self.image,
            camera: self.camera,
            pose: Pose::identity(),
            depth: self.depth.mean(),
            sigma: self.sigma,
        }
    }
}
