use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use mde_warp::{PinholeCamera, Pose};
use nalgebra::Point3;
use ndarray::ArrayView3;

use super::error::unsupported;
use super::tum::{lines, number, numbers};
use super::{
    Distortion, Error, Frame, HALF, KnownDepth, Lens, MAX_FRAMES, PosedCapture, Result, SparsePoint,
    check_photograph, content, pose, quaternion, read_bytes, read_text,
};

const SUPPORTED: &str = "SIMPLE_PINHOLE, PINHOLE, SIMPLE_RADIAL, RADIAL, OPENCV";
/// The models in COLMAP's order, with their numbers of parameters; those that are read come first.
const MODELS: [(&str, usize); 5] =
    [("SIMPLE_PINHOLE", 3), ("PINHOLE", 4), ("SIMPLE_RADIAL", 4), ("RADIAL", 5), ("OPENCV", 8)];
/// Names of the models from number 5 on, for the error.
const OTHERS: [&str; 6] =
    ["OPENCV_FISHEYE", "FULL_OPENCV", "FOV", "SIMPLE_RADIAL_FISHEYE", "RADIAL_FISHEYE", "THIN_PRISM_FISHEYE"];

/// Reads a COLMAP model: `cameras`, `images` and `points3D`, as `.bin` where `cameras.bin` exists, else as `.txt`.
///
/// Names of photographs are relative to `photographs`. Frames come in the order of their names. `size` returns the
/// width and height of a photograph, or `None` if it is missing. A model without points is read too.
///
/// # Errors
/// One line that names the file and the line or the byte: what is missing, cut short, not finite, of another size, a camera model that is
/// not supported, a rotation that is none, fewer than two photographs, or all of them taken from one place.
pub fn read_colmap(
    model: &Path,
    photographs: &Path,
    size: &dyn Fn(&Path) -> Option<[usize; 2]>,
) -> Result<PosedCapture> {
    let (images, raw) = Raw::read(model)?;
    raw.capture(&images, photographs, size)
}

/// `(height, width)` of the photograph of that name, or else of that file name, in a COLMAP model (text or binary), and the depths at the
/// points that it shows, in the model's unit. Points behind the camera or beyond its image are left out. No photograph is read.
///
/// # Errors
/// As [`read_colmap`], and [`Error::Content`](super::Error::Content) where the model has no such photograph, or several.
pub fn read_colmap_depths(model: &Path, photograph: &str) -> Result<((usize, usize), Vec<KnownDepth>)> {
    let (path, raw) = Raw::read(model)?;
    let mut found: Vec<&Image> = raw.images.iter().filter(|image| image.name == photograph).collect();
    if found.is_empty() {
        let name = Path::new(photograph).file_name();
        found.extend(raw.images.iter().filter(|image| Path::new(&image.name).file_name() == name));
    }
    let &[image] = found.as_slice() else {
        let problem = format!("{} photographs of that name; give the model one", found.len());
        return Err(content(&path, format!("image {photograph}"), problem));
    };
    let (lens, pose) = raw.camera(image, &path)?;
    let depths = raw.points.iter().filter(|(.., track)| track.contains(&image.id)).filter_map(
        |(position, error, _)| {
            let point = pose.transform_point(&Point3::from(*position));
            let pixel = lens.photograph_pixel(lens.camera.project(&point)?)?;
            let usable = point.z.is_finite() && error.is_finite() && lens.camera.contains(pixel);
            usable.then_some(KnownDepth { x: pixel.x, y: pixel.y, depth: point.z, sigma: 0.0 })
        },
    );
    Ok((lens.camera.dim(), depths.collect()))
}

pub(super) struct Image {
    pub(super) id: u32,
    pub(super) quaternion: [f64; 4],
    pub(super) translation: [f64; 3],
    pub(super) camera: u32,
    pub(super) name: String,
}

/// Position, error, and the images that show the point.
pub(super) type Point = ([f64; 3], f64, Vec<u32>);

pub(super) struct Raw {
    pub(super) cameras: BTreeMap<u32, Lens>,
    pub(super) images: Vec<Image>,
    pub(super) points: Vec<Point>,
}

impl Raw {
    /// The files of a model, and the path of the one with the images.
    fn read(model: &Path) -> Result<(PathBuf, Self)> {
        let binary = model.join("cameras.bin").exists();
        let file = |stem: &str| model.join(format!("{stem}.{}", if binary { "bin" } else { "txt" }));
        let (cameras, images, points) = (file("cameras"), file("images"), file("points3D"));
        let has_points = points.exists();
        let raw = match binary {
            true => Self {
                cameras: binary_cameras(&cameras, &read_bytes(&cameras)?)?,
                images: binary_images(&images, &read_bytes(&images)?)?,
                points: if has_points { binary_points(&points, &read_bytes(&points)?)? } else { Vec::new() },
            },
            false => Self {
                cameras: text_cameras(&cameras, &read_text(&cameras)?)?,
                images: text_images(&images, &read_text(&images)?)?,
                points: if has_points { text_points(&points, &read_text(&points)?)? } else { Vec::new() },
            },
        };
        Ok((images, raw))
    }

    /// The lens and pose of an image.
    fn camera(&self, image: &Image, path: &Path) -> Result<(Lens, Pose)> {
        let lens = *self.cameras.get(&image.camera).ok_or_else(|| {
            let problem = format!("camera {} is not among the cameras", image.camera);
            content(path, format!("image {}", image.name), problem)
        })?;
        Ok((lens, pose(path, &image.name, quaternion(image.quaternion), image.translation)?))
    }

    pub(super) fn capture(
        mut self,
        path: &Path,
        photographs: &Path,
        size: &dyn Fn(&Path) -> Option<[usize; 2]>,
    ) -> Result<PosedCapture> {
        self.images.sort_by(|a, b| a.name.cmp(&b.name));
        let mut capture = PosedCapture::default();
        let mut index = BTreeMap::new();
        for image in &self.images {
            let photograph = photographs.join(&image.name);
            let (lens, pose) = self.camera(image, path)?;
            let Some(found) = size(&photograph) else {
                capture.unreadable.push(photograph);
                continue;
            };
            check_photograph(path, &photograph, &lens, found)?;
            index.insert(image.id, capture.frames.len());
            capture.frames.push(Frame { photograph, lens, pose });
        }
        capture.points = self
            .points
            .into_iter()
            .filter(|(position, error, _)| position.iter().all(|x| x.is_finite()) && error.is_finite())
            .map(|(position, error, track)| {
                let mut frames: Vec<usize> = track.iter().filter_map(|id| index.get(id).copied()).collect();
                frames.sort_unstable();
                frames.dedup();
                SparsePoint { position: Point3::from(position), error, frames }
            })
            .collect();
        capture.checked(path)
    }
}

/// The lens of a model's parameters; COLMAP's pixel centres lie at halves.
fn lens(
    path: &Path,
    place: impl Fn() -> String,
    model: usize,
    [width, height]: [u64; 2],
    p: &[f64],
) -> Result<Lens> {
    let (name, _) = MODELS[model];
    if !p.iter().all(|x| x.is_finite()) {
        return Err(content(path, place(), format!("a parameter of {name} is not finite")));
    }
    let at = |i: usize| p.get(i).copied().unwrap_or(0.0);
    let shared = [at(0), at(0), at(1), at(2)];
    let (k, distortion) = match name {
        "SIMPLE_PINHOLE" => (shared, [0.0; 4]),
        "PINHOLE" => ([at(0), at(1), at(2), at(3)], [0.0; 4]),
        "SIMPLE_RADIAL" => (shared, [at(3), 0.0, 0.0, 0.0]),
        "RADIAL" => (shared, [at(3), at(4), 0.0, 0.0]),
        _ => ([at(0), at(1), at(2), at(3)], [at(4), at(5), at(6), at(7)]),
    };
    if width > 65536 || height > 65536 {
        return Err(content(path, place(), format!("{width}x{height} pixels; at most 65536 a side")));
    }
    let camera = PinholeCamera::new(k[0], k[1], k[2] - HALF, k[3] - HALF, width as usize, height as usize)
        .map_err(|e| content(path, place(), e.to_string()))?;
    let [k1, k2, p1, p2] = distortion;
    let lens = Lens { camera, distortion: Distortion { k1, k2, k3: 0.0, p1, p2 } };
    lens.check().map_err(|problem| content(path, place(), problem))?;
    Ok(lens)
}

fn integer<T: std::str::FromStr>(path: &Path, line: usize, word: Option<&str>, what: &str) -> Result<T> {
    let problem = || content(path, format!("line {line}"), format!("{what} is missing or no integer"));
    word.and_then(|w| w.parse().ok()).ok_or_else(problem)
}

pub(super) fn text_cameras(path: &Path, text: &str) -> Result<BTreeMap<u32, Lens>> {
    let mut cameras = BTreeMap::new();
    for (line, text) in lines(text) {
        let mut words = text.split_whitespace();
        let id = integer(path, line, words.next(), "the camera's number")?;
        let name = words.next().unwrap_or_default();
        let model = MODELS.iter().position(|model| model.0 == name);
        let model = model.ok_or_else(|| unsupported(path, name, SUPPORTED))?;
        let size =
            [integer(path, line, words.next(), "width")?, integer(path, line, words.next(), "height")?];
        let parameters = (0..MODELS[model].1)
            .map(|i| number(path, line, words.next(), &format!("parameter {} of {name}", i + 1)))
            .collect::<Result<Vec<_>>>()?;
        cameras.insert(id, lens(path, || format!("line {line}"), model, size, &parameters)?);
    }
    Ok(cameras)
}

pub(super) fn text_images(path: &Path, text: &str) -> Result<Vec<Image>> {
    let mut images = Vec::new();
    let mut lines = text.lines().enumerate();
    while let Some((i, text)) = lines.next() {
        let (line, text) = (i + 1, text.trim());
        if text.is_empty() || text.starts_with('#') {
            continue;
        }
        let mut words = text.split_whitespace();
        let id = integer(path, line, words.next(), "the image's number")?;
        let quaternion = numbers(path, line, &mut words, ["qw", "qx", "qy", "qz"])?;
        let translation = numbers(path, line, &mut words, ["tx", "ty", "tz"])?;
        let camera = integer(path, line, words.next(), "the camera's number")?;
        let name = words.collect::<Vec<_>>().join(" ");
        if name.is_empty() {
            return Err(content(path, format!("line {line}"), "the photograph's name is missing"));
        }
        images.push(Image { id, quaternion, translation, camera, name });
        if images.len() > MAX_FRAMES {
            return Err(content(path, format!("line {line}"), format!("more than {MAX_FRAMES} photographs")));
        }
        // Its points in the image, possibly none: an empty line.
        lines.next();
    }
    Ok(images)
}

pub(super) fn text_points(path: &Path, text: &str) -> Result<Vec<Point>> {
    let mut points = Vec::new();
    for (line, text) in lines(text) {
        let mut words = text.split_whitespace();
        words.next();
        let position = numbers(path, line, &mut words, ["x", "y", "z"])?;
        let mut words = words.skip(3);
        let error = number(path, line, words.next(), "error")?;
        let mut track = Vec::new();
        while let (Some(image), Some(_)) = (words.next(), words.next()) {
            track.push(integer(path, line, Some(image), "an image of the track")?);
        }
        points.push((position, error, track));
    }
    Ok(points)
}

/// Little-endian values from bytes, none past their end.
struct Bytes<'a> {
    path: &'a Path,
    all: usize,
    rest: &'a [u8],
}

impl<'a> Bytes<'a> {
    fn new(path: &'a Path, bytes: &'a [u8]) -> Self {
        Self { path, all: bytes.len(), rest: bytes }
    }

    fn place(&self) -> String {
        format!("byte {}", self.all - self.rest.len())
    }

    fn fault(&self, problem: &str) -> Error {
        content(self.path, self.place(), problem)
    }

    fn take<const N: usize>(&mut self) -> Result<[u8; N]> {
        let early = || self.fault("the file ends too early; export the model again");
        let (head, rest) = self.rest.split_first_chunk::<N>().ok_or_else(early)?;
        self.rest = rest;
        Ok(*head)
    }

    fn u32(&mut self) -> Result<u32> {
        Ok(u32::from_le_bytes(self.take()?))
    }

    fn u64(&mut self) -> Result<u64> {
        Ok(u64::from_le_bytes(self.take()?))
    }

    fn f64(&mut self) -> Result<f64> {
        Ok(f64::from_le_bytes(self.take()?))
    }

    fn floats<const N: usize>(&mut self) -> Result<[f64; N]> {
        let mut values = [0.0; N];
        for value in &mut values {
            *value = self.f64()?;
        }
        Ok(values)
    }

    /// A count of entries of at least `size` bytes, which must fit in what is left.
    fn count(&mut self, size: usize) -> Result<usize> {
        let place = self.place();
        let n = self.u64()?;
        let more = || content(self.path, place, format!("{n} entries do not fit in the file"));
        usize::try_from(n).ok().filter(|n| *n <= self.rest.len() / size).ok_or_else(more)
    }

    fn name(&mut self) -> Result<String> {
        let end = self.rest.iter().position(|b| *b == 0);
        let parts = end.and_then(|n| Some((self.rest.get(..n)?, self.rest.get(n + 1..)?)));
        let (name, rest) = parts.ok_or_else(|| self.fault("a name does not end"))?;
        self.rest = rest;
        std::str::from_utf8(name).map(str::to_owned).map_err(|_| self.fault("a name is not UTF-8"))
    }
}

pub(super) fn binary_cameras(path: &Path, bytes: &[u8]) -> Result<BTreeMap<u32, Lens>> {
    let mut bytes = Bytes::new(path, bytes);
    let mut cameras = BTreeMap::new();
    for _ in 0..bytes.count(24)? {
        let place = bytes.place();
        let (id, model) = (bytes.u32()?, bytes.u32()? as usize);
        let size = [bytes.u64()?, bytes.u64()?];
        let Some((_, number)) = MODELS.get(model) else {
            let other = model.checked_sub(MODELS.len()).and_then(|i| OTHERS.get(i));
            let number = model.to_string();
            return Err(unsupported(path, other.unwrap_or(&&*number), SUPPORTED));
        };
        let parameters = (0..*number).map(|_| bytes.f64()).collect::<Result<Vec<_>>>()?;
        cameras.insert(id, lens(path, || place.clone(), model, size, &parameters)?);
    }
    Ok(cameras)
}

pub(super) fn binary_images(path: &Path, bytes: &[u8]) -> Result<Vec<Image>> {
    let mut bytes = Bytes::new(path, bytes);
    let mut images = Vec::new();
    let number = bytes.count(73)?;
    if number > MAX_FRAMES {
        return Err(content(path, "byte 0", format!("{number} photographs; at most {MAX_FRAMES}")));
    }
    for _ in 0..number {
        let id = bytes.u32()?;
        let (quaternion, translation) = (bytes.floats()?, bytes.floats()?);
        let camera = bytes.u32()?;
        let name = bytes.name()?;
        let points = bytes.count(24)?;
        bytes.rest = &bytes.rest[24 * points..];
        images.push(Image { id, quaternion, translation, camera, name });
    }
    Ok(images)
}

pub(super) fn binary_points(path: &Path, bytes: &[u8]) -> Result<Vec<Point>> {
    let mut bytes = Bytes::new(path, bytes);
    let mut points = Vec::new();
    for _ in 0..bytes.count(51)? {
        bytes.u64()?;
        let position = bytes.floats()?;
        bytes.take::<3>()?;
        let error = bytes.f64()?;
        let length = bytes.count(8)?;
        let mut track = Vec::with_capacity(length);
        for _ in 0..length {
            track.push(bytes.u32()?);
            bytes.u32()?;
        }
        points.push((position, error, track));
    }
    Ok(points)
}

/// A point of a model that is written.
#[derive(Debug, Clone, PartialEq)]
pub struct ColmapPoint {
    /// Position in the world.
    pub position: Point3<f64>,
    /// Red, green, blue.
    pub colour: [u8; 3],
    /// Indices of the frames that show it, each with row and column.
    pub seen: Vec<(usize, [usize; 2])>,
}

/// Names and texts of the files of a model, as [`read_colmap`] reads them; the frames have no distortion.
pub fn colmap_text(frames: &[Frame], points: &[ColmapPoint]) -> [(&'static str, String); 3] {
    let mut cameras = String::from("# CAMERA_ID, MODEL, WIDTH, HEIGHT, fx, fy, cx, cy\n");
    let mut images =
        String::from("# IMAGE_ID, QW, QX, QY, QZ, TX, TY, TZ, CAMERA_ID, NAME; then (X, Y, POINT3D_ID)\n");
    let mut cloud = String::from("# POINT3D_ID, X, Y, Z, R, G, B, ERROR, (IMAGE_ID, POINT2D_IDX)\n");
    let mut seen = vec![Vec::new(); frames.len()];
    for (id, point) in (1..).zip(points) {
        let ([x, y, z], [r, g, b]) = (point.position.coords.into(), point.colour);
        cloud += &format!("{id} {x:.6} {y:.6} {z:.6} {r} {g} {b} 0");
        for &(frame, [row, column]) in &point.seen {
            let Some(seen) = seen.get_mut(frame) else { continue };
            cloud += &format!(" {} {}", frame + 1, seen.len());
            seen.push(format!("{} {} {id}", column as f64 + HALF, row as f64 + HALF));
        }
        cloud.push('\n');
    }
    for (id, (frame, seen)) in (1..).zip(frames.iter().zip(seen)) {
        let PinholeCamera { fx, fy, cx, cy, width, height } = frame.lens.camera;
        cameras += &format!("{id} PINHOLE {width} {height} {fx} {fy} {} {}\n", cx + HALF, cy + HALF);
        let (q, t) = (frame.pose.rotation, frame.pose.translation);
        images += &format!("{id} {} {} {} {} {} {} {} {id} ", q.w, q.i, q.j, q.k, t.x, t.y, t.z);
        images += &format!("{}\n{}\n", frame.photograph.display(), seen.join(" "));
    }
    [("cameras.txt", cameras), ("images.txt", images), ("points3D.txt", cloud)]
}

/// A map of a dense workspace, `[channels, height, width]`, as COLMAP's `Mat<float>`: sizes as text, then the values.
pub fn colmap_map(map: ArrayView3<'_, f32>) -> Vec<u8> {
    let (channels, height, width) = map.dim();
    let mut bytes = format!("{width}&{height}&{channels}&").into_bytes();
    bytes.extend(map.iter().flat_map(|value| value.to_le_bytes()));
    bytes
}
