use mde_warp::PinholeCamera;
use nalgebra::{Point2, Vector3};
use ndarray::{Array2, Array3, ArrayView3};
use rayon::prelude::*;

use crate::capture::{Error, Result};
use crate::raster::bilinear;

/// Brown's distortion as OpenCV writes it; all zero is none.
///
/// With \\( (x, y) \\) the undistorted ray at z = 1 and \\( r^2 = x^2 + y^2 \\),
///
/// \\[ x_d = x (1 + k_1 r^2 + k_2 r^4 + k_3 r^6) + 2 p_1 x y + p_2 (r^2 + 2 x^2), \\]
/// \\[ y_d = y (1 + k_1 r^2 + k_2 r^4 + k_3 r^6) + p_1 (r^2 + 2 y^2) + 2 p_2 x y . \\]
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Distortion {
    /// Radial, of the second power.
    pub k1: f64,
    /// Radial, of the fourth power.
    pub k2: f64,
    /// Radial, of the sixth power.
    pub k3: f64,
    /// Tangential.
    pub p1: f64,
    /// Tangential.
    pub p2: f64,
}

/// A camera with distortion.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Lens {
    /// The pinhole camera of the same centre; pixel centres at integers.
    pub camera: PinholeCamera,
    /// How the photograph departs from it.
    pub distortion: Distortion,
}

impl Distortion {
    /// Whether every coefficient is zero.
    pub fn is_none(&self) -> bool {
        *self == Self::default()
    }

    /// Where the ray \\( (x, y, 1) \\) appears, as such a ray; nothing where the radial polynomial has turned back, so
    /// that two rays would share a pixel.
    pub fn distort(&self, x: f64, y: f64) -> Option<(f64, f64)> {
        let r2 = x * x + y * y;
        let radial = 1.0 + r2 * (self.k1 + r2 * (self.k2 + r2 * self.k3));
        let slope = 1.0 + r2 * (3.0 * self.k1 + r2 * (5.0 * self.k2 + r2 * 7.0 * self.k3));
        if !(slope > 0.0 && radial > 0.0) {
            return None;
        }
        let (p1, p2) = (self.p1, self.p2);
        let xd = x * radial + 2.0 * p1 * x * y + p2 * (r2 + 2.0 * x * x);
        let yd = y * radial + p1 * (r2 + 2.0 * y * y) + 2.0 * p2 * x * y;
        (xd.is_finite() && yd.is_finite()).then_some((xd, yd))
    }
}

/// Focal lengths over the longer side of the image that a camera can have; fields of view of 179 degrees to a minute of arc.
const FOCAL: [f64; 2] = [0.005, 2000.0];
/// Farthest principal point from the image, in longer sides.
const FARTHEST_CENTRE: f64 = 10.0;
/// Largest coefficient of distortion.
const MOST_DISTORTION: f64 = 1e6;

impl Lens {
    /// Whether such a camera can exist.
    ///
    /// # Errors
    /// The first implausible number, with what is expected.
    pub fn check(&self) -> Result<(), String> {
        let (c, d) = (&self.camera, &self.distortion);
        let side = c.width.max(c.height) as f64;
        let [least, most] = FOCAL.map(|share| share * side);
        let check = |values: &[(&str, f64)], [low, high]: [f64; 2], expected: String| {
            let wrong = values.iter().find(|(_, value)| !(low..=high).contains(value));
            wrong.map_or(Ok(()), |(name, value)| Err(format!("{name} is {value:?}; {expected}")))
        };
        let expected = format!("a focal length is {least:?} to {most:?} pixels here");
        check(&[("fx", c.fx), ("fy", c.fy)], [least, most], expected)?;
        let far = FARTHEST_CENTRE * side;
        let expected = format!("a principal point is at most {far:?} pixels away");
        check(&[("cx", c.cx), ("cy", c.cy)], [-far, far], expected)?;
        let coefficients = [("k1", d.k1), ("k2", d.k2), ("k3", d.k3), ("p1", d.p1), ("p2", d.p2)];
        let expected = format!("a coefficient of distortion is at most {MOST_DISTORTION:?}");
        check(&coefficients, [-MOST_DISTORTION, MOST_DISTORTION], expected)
    }

    /// The fault of a photograph of another width and height than the camera.
    pub(super) fn check_size(&self, found: [usize; 2]) -> Result<(), String> {
        let (height, width) = self.camera.dim();
        if found == [width, height] {
            return Ok(());
        }
        Err(format!(
            "the photograph is {}x{} pixels but its camera {width}x{height}; give the photograph that the camera was calibrated for",
            found[0], found[1]
        ))
    }

    /// The pixel of the photograph (x: column, y: row) at which the pinhole camera's pixel appears.
    pub fn photograph_pixel(&self, pixel: Point2<f64>) -> Option<Point2<f64>> {
        let ray: Vector3<f64> = self.camera.ray(pixel);
        let (x, y) = self.distortion.distort(ray.x, ray.y)?;
        Some(Point2::new(self.camera.fx * x + self.camera.cx, self.camera.fy * y + self.camera.cy))
    }

    /// The photograph `[height, width, 3]` as the pinhole camera would have taken it, and where it has colours: false
    /// where the pinhole camera's image extends beyond the photograph. Colours are bilinear.
    ///
    /// # Errors
    /// [`Error::Content`] for a photograph of another size than the camera.
    pub fn undistort(&self, photograph: ArrayView3<'_, f32>) -> Result<(Array3<f32>, Array2<bool>)> {
        let (h, w) = self.camera.dim();
        let (height, width, channels) = photograph.dim();
        self.check_size([width, height]).map_err(Error::Content)?;
        if channels != 3 {
            let (found, expected) = (vec![height, width, channels], vec![h, w, 3]);
            return Err(mde_warp::Error::Shape { what: "photograph", found, expected }.into());
        }
        if self.distortion.is_none() {
            return Ok((photograph.to_owned(), Array2::from_elem((h, w), true)));
        }
        let colour = |at: usize| {
            let pixel = Point2::new((at % w) as f64, (at / w) as f64);
            let at = self.photograph_pixel(pixel).filter(|at| self.camera.contains(*at))?;
            let [x, y] = [at.x.clamp(0.0, (w - 1) as f64), at.y.clamp(0.0, (h - 1) as f64)];
            Some(bilinear(photograph, x, y))
        };
        let colours: Vec<Option<[f32; 3]>> = (0..h * w).into_par_iter().map(colour).collect();
        let mask = Array2::from_shape_fn((h, w), |(y, x)| colours[y * w + x].is_some());
        let image =
            Array3::from_shape_fn((h, w, 3), |(y, x, c)| colours[y * w + x].map_or(0.0, |found| found[c]));
        Ok((image, mask))
    }
}
