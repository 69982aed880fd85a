//! Files for other programs.

mod colmap;
mod glb;
mod layers;
pub mod ply;
pub mod transforms;

use crate::error::{Error, Result};
use mde_prior::CertaintyMeaning;
use mde_prior::format::write_npy;
use mde_prior::photo::write_image;
use mde_uncertainty::GaussianDepth;
use mde_warp::{PinholeCamera, Pose};
use nalgebra::Point3;
use ndarray::{ArrayView2, ArrayView3};
use std::fs;
use std::path::{Path, PathBuf};
use std::str::FromStr;

/// A kind of files.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Format {
    /// `cloud.ply`: points with colour, normal and sigma (binary).
    Ply,
    /// `mesh.glb`: textured mesh, torn at depth edges, y up.
    Glb,
    /// `depth.exr`: channels Y and Z (refined), sigma and prior.
    Exr,
    /// `colmap/`: `images/` and `sparse/0/`.
    Colmap,
    /// `transforms.json`: camera, depth and sigma for nerfstudio.
    Transforms,
    /// `sigma/`: the components of sigma (NPY).
    Sigma,
    /// `field.safetensors`: the field of the last iteration.
    Field,
}

impl Format {
    /// All formats.
    pub const ALL: [Self; 7] =
        [Self::Ply, Self::Glb, Self::Exr, Self::Colmap, Self::Transforms, Self::Sigma, Self::Field];

    /// Its name as an argument.
    pub fn name(self) -> &'static str {
        match self {
            Self::Ply => "ply",
            Self::Glb => "glb",
            Self::Exr => "exr",
            Self::Colmap => "colmap",
            Self::Transforms => "transforms",
            Self::Sigma => "sigma",
            Self::Field => "field",
        }
    }

    /// Its files and what is in them.
    pub fn about(self) -> &'static str {
        match self {
            Self::Ply => "cloud.ply: points with colour, normal and sigma (binary)",
            Self::Glb => "mesh.glb: textured mesh, torn at depth edges, y up",
            Self::Exr => "depth.exr: channels Y and Z (refined), sigma and prior",
            Self::Colmap => "colmap/: images/ and sparse/0/",
            Self::Transforms => "transforms.json: camera, depth and sigma for nerfstudio",
            Self::Sigma => "sigma/: the components of sigma (NPY)",
            Self::Field => "field.safetensors: the fitted field, for mde render",
        }
    }
}

impl FromStr for Format {
    type Err = Error;

    fn from_str(name: &str) -> Result<Self> {
        Self::ALL.into_iter().find(|format| format.name() == name).ok_or_else(|| {
            let names = Self::ALL.map(Self::name).join(", ");
            Error::Argument(format!("export: {name:?} is no format; give some of {names}"))
        })
    }
}

/// The photograph in a folder of results.
const IMAGE: &str = "image.png";

/// The exported scene; the world is the camera's frame (x right, y down, z forward).
pub struct Exported<'e> {
    /// Unit of depths and points.
    pub unit: &'e str,
    /// sRGB in 0 to 1, `[height, width, 3]`.
    pub image: ArrayView3<'e, f32>,
    /// The camera of the maps.
    pub camera: &'e PinholeCamera,
    /// The refined depth, `[height, width]`.
    pub depth: &'e GaussianDepth,
    /// `[height, width]`; 0 where missing.
    pub prior: ArrayView2<'e, f32>,
    /// The components of sigma by their names.
    pub components: Vec<(&'e str, ArrayView2<'e, f32>)>,
    /// How sure the network itself is.
    pub certainty: Option<(CertaintyMeaning, ArrayView2<'e, f32>)>,
    /// Steps per unit of depth.png.
    pub png_scale: f64,
}

impl Exported<'_> {
    /// Writes one format's files into a folder.
    ///
    /// # Errors
    /// [`Error::Prior`] or [`Error::External`] for a file that can't be written.
    pub fn write(&self, format: Format, folder: &Path) -> Result<()> {
        match format {
            Format::Ply => Ok(mde_prior::write_atomic(&folder.join("cloud.ply"), &ply::encode(self))?),
            Format::Exr => Ok(mde_prior::write_atomic(&folder.join("depth.exr"), &layers::encode(self)?)?),
            Format::Colmap => {
                let model = subfolder(folder, "colmap/sparse/0")?;
                for (name, text) in colmap::files(self) {
                    mde_prior::write_atomic(&model.join(name), text.as_bytes())?;
                }
                Ok(write_image(subfolder(folder, "colmap/images")?.join(IMAGE), self.image)?)
            }
            Format::Glb => Ok(mde_prior::write_atomic(&folder.join("mesh.glb"), &glb::encode(self)?)?),
            Format::Transforms => transforms::write(
                &folder.join(transforms::FILE),
                &[transforms::Exposed {
                    folder: "",
                    camera: *self.camera,
                    pose: Pose::identity(),
                    png_scale: self.png_scale,
                }],
            ),
            Format::Sigma => {
                let parts = subfolder(folder, "sigma")?;
                for (name, sigma) in &self.components {
                    write_npy(parts.join(format!("{name}.npy")), *sigma)?;
                }
                if let Some((meaning, map)) = self.certainty {
                    write_npy(parts.join(format!("network-{}.npy", meaning.name())), map)?;
                }
                Ok(())
            }
            // Whoever has the field writes it.
            Format::Field => Ok(()),
        }
    }

    /// The pixel's point, where its depth is known.
    pub fn point(&self, row: usize, column: usize) -> Option<Point3<f64>> {
        let z = f64::from(*self.depth.mean().get((row, column))?);
        let camera = self.camera;
        let known = z > 0.0 && self.depth.variance()[(row, column)].is_finite();
        known.then(|| {
            Point3::new(
                (column as f64 - camera.cx) / camera.fx * z,
                (row as f64 - camera.cy) / camera.fy * z,
                z,
            )
        })
    }

    /// The pixel's colour.
    pub fn colour(&self, row: usize, column: usize) -> [u8; 3] {
        [0, 1, 2].map(|c| (self.image[(row, column, c)].clamp(0.0, 1.0) * 255.0).round() as u8)
    }
}

fn subfolder(folder: &Path, name: &str) -> Result<PathBuf> {
    let path = folder.join(name);
    match fs::create_dir_all(&path) {
        Ok(()) => Ok(path),
        Err(error) => Err(Error::external(format!("{}: can't make this folder: {error}", path.display()))),
    }
}

/// A slanted plane with a hole, for the tests of the formats.
#[cfg(test)]
pub(crate) mod tests {
    use super::*;
    use ndarray::{Array2, Array3};

    pub(crate) const SIZE: (usize, usize) = (6, 8);

    pub(crate) fn with_plane(test: impl FnOnce(&Exported<'_>)) {
        let camera = PinholeCamera::new(10.0, 12.0, 3.5, 2.5, SIZE.1, SIZE.0).unwrap();
        // z = 2 + 0.5 x, with x = (u - cx) / fx * z.
        let mut depth = Array2::from_shape_fn(SIZE, |(_, u)| {
            (2.0 / (1.0 - 0.5 * (u as f64 - camera.cx) / camera.fx)) as f32
        });
        let mut variance = depth.mapv(|d| 0.01 * d * d);
        (depth[(2, 3)], variance[(2, 3)]) = (0.0, f32::INFINITY);
        let prior = &depth * 1.5;
        let depth = GaussianDepth::new(depth, variance).unwrap();
        let image = Array3::from_shape_fn((SIZE.0, SIZE.1, 3), |(v, u, c)| (v * 8 + u + c) as f32 / 50.0);
        test(&Exported {
            unit: "m",
            image: image.view(),
            camera: &camera,
            depth: &depth,
            prior: prior.view(),
            components: Vec::new(),
            certainty: None,
            png_scale: 1000.0,
        });
    }
}
