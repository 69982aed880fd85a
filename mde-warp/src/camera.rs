use crate::{Error, Result};
use nalgebra::{Point2, Point3, Vector3};

/// Diagonal of a 36 mm x 24 mm film frame, in mm: 43.27.
const FILM_DIAGONAL: f64 = 43.266_615_305_567_875;
/// Upper limit on pixels per image, so that sizes of buffers cannot overflow.
const MAX_PIXELS: f64 = 268_435_456.0;

/// A pinhole camera without distortion (OpenCV: x right, y down, z forward; pixel centres at integers, from 0).
///
/// \\[ u = f_x \frac{x}{z} + c_x, \qquad v = f_y \frac{y}{z} + c_y \\]
///
/// Focal lengths and principal point are in pixels. The fields are public, so every function that takes a camera calls
/// [`validate`](Self::validate) first.
#[derive(Debug, Clone, Copy, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "serde", serde(deny_unknown_fields, rename_all = "kebab-case"))]
pub struct PinholeCamera {
    /// Horizontal focal length, pixels.
    pub fx: f64,
    /// Vertical focal length, pixels.
    pub fy: f64,
    /// Column of the principal point, pixels.
    pub cx: f64,
    /// Row of the principal point, pixels.
    pub cy: f64,
    /// Columns of the image.
    pub width: usize,
    /// Rows of the image.
    pub height: usize,
}

impl PinholeCamera {
    /// A camera from its intrinsic parameters, all in pixels.
    ///
    /// # Errors
    /// [`Error::Camera`], see [`validate`](Self::validate).
    pub fn new(fx: f64, fy: f64, cx: f64, cy: f64, width: usize, height: usize) -> Result<Self> {
        let camera = Self { fx, fy, cx, cy, width, height };
        camera.validate()?;
        Ok(camera)
    }

    /// Square pixels, principal point in the middle, \\( f = \frac{w}{2} / \tan\frac{\text{fov}}{2} \\).
    ///
    /// The field of view, in degrees, spans the whole width, from the left edge of the first column to the right edge of the last.
    ///
    /// # Errors
    /// [`Error::Camera`] for a field of view outside (0, 180) degrees or an empty image.
    pub fn from_fov(horizontal_fov_degrees: f64, width: usize, height: usize) -> Result<Self> {
        let sound = horizontal_fov_degrees > 0.0 && horizontal_fov_degrees < 180.0;
        check(sound, "field of view", horizontal_fov_degrees, "more than 0 and less than 180 degrees")?;
        Self::centred(0.5 * width as f64 / (0.5 * horizontal_fov_degrees.to_radians()).tan(), width, height)
    }

    /// Square pixels, principal point in the middle, focal length from EXIF's `FocalLengthIn35mmFilm`:
    /// \\( f = \text{mm} \cdot \sqrt{w^2 + h^2} / 43.27 \\), the equivalence by the diagonal of the frame.
    ///
    /// # Errors
    /// [`Error::Camera`] for a focal length that is not positive or an empty image.
    pub fn from_focal_35mm(mm: f64, width: usize, height: usize) -> Result<Self> {
        let need = "positive and finite (mm; 0 in EXIF means unknown)";
        check(mm > 0.0 && mm.is_finite(), "35 mm focal length", mm, need)?;
        Self::centred(mm * (width as f64).hypot(height as f64) / FILM_DIAGONAL, width, height)
    }

    fn centred(focal: f64, width: usize, height: usize) -> Result<Self> {
        let middle = |size: usize| 0.5 * (size as f64 - 1.0);
        check_size(width, height)?;
        Self::new(focal, focal, middle(width), middle(height), width, height)
    }

    /// Checks that the focal lengths are finite and positive, the principal point finite and the image of at least one
    /// pixel and at most 2^28.
    ///
    /// # Errors
    /// [`Error::Camera`] with the first field at fault.
    pub fn validate(&self) -> Result<()> {
        for (field, value) in [("fx", self.fx), ("fy", self.fy)] {
            check(value.is_finite() && value > 0.0, field, value, "finite and > 0 (pixels)")?;
        }
        for (field, value) in [("cx", self.cx), ("cy", self.cy)] {
            check(value.is_finite(), field, value, "finite (pixels)")?;
        }
        check_size(self.width, self.height)
    }

    /// `(height, width)`, the shape of this camera's maps.
    pub fn dim(&self) -> (usize, usize) {
        (self.height, self.width)
    }

    /// Checks that a map, named by `what`, has this shape.
    ///
    /// # Errors
    /// [`Error::Shape`] for another one.
    pub fn check_map(&self, what: &'static str, found: (usize, usize)) -> Result<()> {
        if found == self.dim() {
            return Ok(());
        }
        Err(Error::Shape { what, found: vec![found.0, found.1], expected: vec![self.height, self.width] })
    }

    /// Projection of a point of the camera's frame, in pixels (x: column, y: row), inside the image or not.
    ///
    /// \\[ (u, v) = \left( f_x \frac{x}{z} + c_x,\; f_y \frac{y}{z} + c_y \right) \\]
    ///
    /// `None` for a point that is not in front of the camera (z <= 0), or whose pixel is not finite.
    pub fn project(&self, p: &Point3<f64>) -> Option<Point2<f64>> {
        if p.z <= 0.0 {
            return None;
        }
        let pixel = Point2::new(self.fx * p.x / p.z + self.cx, self.fy * p.y / p.z + self.cy);
        (pixel.x.is_finite() && pixel.y.is_finite()).then_some(pixel)
    }

    /// The point of the camera's frame at a pixel (x: column, y: row) and a z-depth.
    ///
    /// \\[ X = z \, d, \qquad d = \left( \frac{u - c_x}{f_x}, \frac{v - c_y}{f_y}, 1 \right) \\]
    pub fn unproject(&self, pixel: Point2<f64>, depth: f64) -> Point3<f64> {
        Point3::from(self.ray(pixel) * depth)
    }

    /// Direction \\( d \\) of a pixel's ray with z = 1 (not normalised), so that the parameter along it is z-depth.
    pub fn ray(&self, pixel: Point2<f64>) -> Vector3<f64> {
        Vector3::new((pixel.x - self.cx) / self.fx, (pixel.y - self.cy) / self.fy, 1.0)
    }

    /// The camera of the same image resized to `width` x `height`.
    ///
    /// Pixels are areas, \\( u' + \tfrac12 = s_x (u + \tfrac12) \\) with \\( s_x = w'/w \\), so
    /// \\( f_x' = s_x f_x \\) and \\( c_x' = s_x (c_x + \tfrac12) - \tfrac12 \\); the same for y.
    ///
    /// # Errors
    /// [`Error::Camera`] for an empty or far too large image.
    pub fn resized(&self, width: usize, height: usize) -> Result<Self> {
        self.validate()?;
        let (sx, sy) = (width as f64 / self.width as f64, height as f64 / self.height as f64);
        // An empty size is reported as such, not as the focal length 0 that follows from it.
        check_size(width, height)?;
        let (cx, cy) = ((self.cx + 0.5) * sx - 0.5, (self.cy + 0.5) * sy - 0.5);
        Self::new(self.fx * sx, self.fy * sy, cx, cy, width, height)
    }

    /// Whether a pixel position lies on the image, whose pixels are unit squares about their centres.
    pub fn contains(&self, pixel: Point2<f64>) -> bool {
        let inside = |x: f64, size: usize| (-0.5..=size as f64 - 0.5).contains(&x);
        inside(pixel.x, self.width) && inside(pixel.y, self.height)
    }
}

fn check_size(width: usize, height: usize) -> Result<()> {
    for (field, size) in [("width", width), ("height", height)] {
        check(size > 0, field, 0.0, "at least 1 pixel")?;
    }
    let pixels = width as f64 * height as f64;
    check(pixels <= MAX_PIXELS, "number of pixels", pixels, "at most 2^28; resize the image")
}

/// [`Error::Camera`] for a value that is not sound.
fn check(sound: bool, field: &'static str, value: f64, need: &'static str) -> Result<()> {
    if sound { Ok(()) } else { Err(Error::Camera { field, value, need }) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use approx::assert_relative_eq;

    #[test]
    fn the_field_of_view_reaches_both_edges() {
        let camera = PinholeCamera::from_fov(60.0, 640, 480).unwrap();
        let left = camera.ray(Point2::new(-0.5, 0.0));
        let right = camera.ray(Point2::new(639.5, 0.0));
        assert_relative_eq!(left.x, -(30f64.to_radians().tan()), max_relative = 1e-12);
        assert_relative_eq!(right.x, 30f64.to_radians().tan(), max_relative = 1e-12);
    }

    /// 36 mm on a 3:2 sensor is as wide as the film: 2 atan(1/2) of field of view.
    #[test]
    fn film_focal_length_of_36_mm_spans_its_own_width() {
        let film = PinholeCamera::from_focal_35mm(36.0, 3000, 2000).unwrap();
        assert_relative_eq!(film.fx, 3000.0, max_relative = 1e-9);
    }
}
