//! Files for other programs.

mod colmap;
mod glb;
mod layers;
pub(crate) mod ply;
pub(crate) mod transforms;

use crate::args::ExportName;
use anyhow::{Context, Result};
use mde_cli::Component;
use mde_prior::format::write_npy;
use mde_prior::photo::write_image;
use mde_uncertainty::GaussianDepth;
use mde_warp::{PinholeCamera, Pose};
use nalgebra::Point3;
use ndarray::{ArrayView2, ArrayView3};
use std::fs;
use std::path::{Path, PathBuf};

/// The photograph in a folder of results.
const IMAGE: &str = "image.png";

/// The exported scene; the world is the camera's frame (x right, y down, z forward).
pub(crate) struct Exported<'e> {
    /// Unit of depths and points.
    pub(crate) unit: &'e str,
    /// sRGB in 0 to 1, `[height, width, 3]`.
    pub(crate) image: ArrayView3<'e, f32>,
    pub(crate) camera: &'e PinholeCamera,
    pub(crate) depth: &'e GaussianDepth,
    /// `[height, width]`; 0 where missing.
    pub(crate) prior: ArrayView2<'e, f32>,
    /// The components of sigma.
    pub(crate) components: &'e [Component],
    /// The network's own confidence.
    pub(crate) confidence: Option<ArrayView2<'e, f32>>,
    /// Whether the points of PLY have y up.
    pub(crate) y_up: bool,
    /// Steps per unit of depth.png.
    pub(crate) png_scale: f64,
}

impl Exported<'_> {
    /// Writes one format's files into a folder.
    pub(crate) fn write(&self, format: ExportName, folder: &Path) -> Result<()> {
        match format {
            ExportName::Ply => {
                Ok(mde_prior::write_atomic(&folder.join("cloud.ply"), &ply::encode(self, self.y_up))?)
            }
            ExportName::Exr => {
                Ok(mde_prior::write_atomic(&folder.join("depth.exr"), &layers::encode(self)?)?)
            }
            ExportName::Colmap => {
                let model = subfolder(folder, "colmap/sparse/0")?;
                for (name, text) in colmap::files(self) {
                    mde_prior::write_atomic(&model.join(name), text.as_bytes())?;
                }
                Ok(write_image(subfolder(folder, "colmap/images")?.join(IMAGE), self.image)?)
            }
            ExportName::Glb => Ok(mde_prior::write_atomic(&folder.join("mesh.glb"), &glb::encode(self)?)?),
            ExportName::Transforms => transforms::write(
                &folder.join(transforms::FILE),
                &[transforms::Exposed {
                    folder: "",
                    camera: *self.camera,
                    pose: Pose::identity(),
                    png_scale: self.png_scale,
                }],
            ),
            ExportName::Sigma => {
                let parts = subfolder(folder, "sigma")?;
                for part in self.components {
                    write_npy(parts.join(format!("{}.npy", part.name)), part.sigma.view())?;
                }
                if let Some(confidence) = self.confidence {
                    write_npy(parts.join("network-confidence.npy"), confidence)?;
                }
                Ok(())
            }
        }
    }

    /// The pixel's point, where its depth is known.
    pub(crate) fn point(&self, row: usize, column: usize) -> Option<Point3<f64>> {
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

    pub(crate) fn colour(&self, row: usize, column: usize) -> [u8; 3] {
        [0, 1, 2].map(|c| (self.image[(row, column, c)].clamp(0.0, 1.0) * 255.0).round() as u8)
    }
}

fn subfolder(folder: &Path, name: &str) -> Result<PathBuf> {
    let path = folder.join(name);
    fs::create_dir_all(&path).with_context(|| format!("{}: can't make this folder", path.display()))?;
    Ok(path)
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
            components: &[],
            confidence: None,
            y_up: false,
            png_scale: 1000.0,
        });
    }
}
