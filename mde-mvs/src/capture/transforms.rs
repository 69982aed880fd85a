use std::f64::consts::PI;
use std::path::{Path, PathBuf};

use mde_warp::{PinholeCamera, Pose};
use nalgebra::Matrix3;
use serde_json::{Map, Value, json};

use super::error::unsupported;
use super::{
    Distortion, Error, Frame, HALF, Lens, MAX_FRAMES, PosedCapture, Result, check_photograph, content, pose,
    read_text, rotation,
};

/// Models of a `transforms.json` that are read.
const MODELS: [&str; 6] = ["OPENCV", "PINHOLE", "SIMPLE_PINHOLE", "RADIAL", "SIMPLE_RADIAL", "PERSPECTIVE"];
const SUPPORTED: &str = "OPENCV, PINHOLE, SIMPLE_PINHOLE, RADIAL, SIMPLE_RADIAL";
/// Extensions that are tried for a name without one.
const EXTENSIONS: [&str; 4] = ["png", "jpg", "jpeg", "JPG"];

/// Position of the first pixel's centre: 0, as everywhere in this workspace, or one half.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum PixelCentres {
    /// At integers.
    Integers,
    /// At halves, as COLMAP has it.
    Halves,
}

/// Reads a `transforms.json`: camera-to-world matrices with OpenGL axes, intrinsics for all frames or for each
/// (`fl_x`, `fl_y`, `cx`, `cy`, `w`, `h`, `camera_angle_x`, `camera_angle_y`, `k1`, `k2`, `k3`, `p1`, `p2`).
///
/// `size` returns the width and height of a photograph, or `None` if it is missing; it also replaces `w` and `h` where the file has none.
/// Principal points are taken by `centres` unless the file has a `pixel_centres` of `"integers"` or `"halves"`.
///
/// # Errors
/// One line that names the file, the frame and the field: what is missing, not finite, of another size, a fisheye model,
/// a rotation that is none, fewer than two photographs, or all of them taken from one place.
pub fn read_transforms(
    path: &Path,
    centres: PixelCentres,
    size: &dyn Fn(&Path) -> Option<[usize; 2]>,
) -> Result<PosedCapture> {
    parse(path, &read_text(path)?, centres, size)
}

pub(super) fn parse(
    path: &Path,
    text: &str,
    centres: PixelCentres,
    size: &dyn Fn(&Path) -> Option<[usize; 2]>,
) -> Result<PosedCapture> {
    let root: Value = serde_json::from_str(text).map_err(|e| content(path, "JSON", e.to_string()))?;
    let shared = root.as_object().ok_or_else(|| content(path, "JSON", "not an object"))?;
    let frames = shared.get("frames").and_then(Value::as_array);
    let frames = frames.ok_or_else(|| content(path, "frames", "missing; a list of photographs is needed"))?;
    if frames.len() > MAX_FRAMES {
        return Err(content(path, "frames", format!("{} entries; at most {MAX_FRAMES}", frames.len())));
    }
    let centres = match shared.get("pixel_centres").map(Value::as_str) {
        None => centres,
        Some(Some("integers")) => PixelCentres::Integers,
        Some(Some("halves")) => PixelCentres::Halves,
        Some(_) => return Err(content(path, "pixel_centres", "must be \"integers\" or \"halves\"")),
    };
    let folder = path.parent().unwrap_or(Path::new(""));
    let mut capture = PosedCapture::default();
    for (i, frame) in frames.iter().enumerate() {
        let place = format!("frames[{i}]");
        let own = frame.as_object().ok_or_else(|| content(path, &place, "not an object"))?;
        let fields = Fields { path, place: &place, own, shared };
        let name = own.get("file_path").and_then(Value::as_str);
        let name = name.ok_or_else(|| content(path, &place, "file_path is missing"))?;
        let Some((photograph, found)) = find(folder, name, size) else {
            capture.unreadable.push(folder.join(name));
            continue;
        };
        let lens = fields.lens(found, centres)?;
        check_photograph(path, &photograph, &lens, found)?;
        let pose = fields.pose(name)?;
        capture.frames.push(Frame { photograph, lens, pose });
    }
    capture.checked(path)
}

/// The photograph and its size; a name without extension is tried with each of [`EXTENSIONS`].
fn find(
    folder: &Path,
    name: &str,
    size: &dyn Fn(&Path) -> Option<[usize; 2]>,
) -> Option<(PathBuf, [usize; 2])> {
    let plain = folder.join(name);
    let extensions = if plain.extension().is_some() { &[][..] } else { &EXTENSIONS };
    let others = extensions.iter().map(|extension| folder.join(format!("{name}.{extension}")));
    std::iter::once(plain).chain(others).find_map(|path| size(&path).map(|found| (path, found)))
}

struct Fields<'a> {
    path: &'a Path,
    place: &'a str,
    own: &'a Map<String, Value>,
    shared: &'a Map<String, Value>,
}

impl Fields<'_> {
    fn get(&self, key: &str) -> Option<&Value> {
        self.own.get(key).or_else(|| self.shared.get(key))
    }

    /// A fault of the field of that key.
    fn fault(&self, key: &str, problem: &str) -> Error {
        content(self.path, format!("{}.{key}", self.place), problem)
    }

    fn number(&self, key: &str) -> Result<Option<f64>> {
        let finite = |value: &Value| value.as_f64().filter(|x| x.is_finite());
        let number = |value| finite(value).ok_or_else(|| self.fault(key, "not a finite number"));
        self.get(key).map(number).transpose()
    }

    fn lens(&self, found: [usize; 2], centres: PixelCentres) -> Result<Lens> {
        let fisheye = self.get("is_fisheye").and_then(Value::as_bool).unwrap_or(false);
        let model = self.get("camera_model").map_or(Some("OPENCV"), Value::as_str).unwrap_or("?");
        let k4 = self.number("k4")?.unwrap_or(0.0);
        let faults = [(fisheye, "is_fisheye"), (k4 != 0.0, "with k4"), (!MODELS.contains(&model), model)];
        if let Some((_, model)) = faults.into_iter().find(|(is_so, _)| *is_so) {
            return Err(unsupported(self.path, model, SUPPORTED));
        }
        let pixels = |key: &str, found: usize| -> Result<usize> {
            let Some(x) = self.number(key)? else { return Ok(found) };
            if (1.0..=65536.0).contains(&x) && x.fract() == 0.0 {
                return Ok(x as usize);
            }
            Err(self.fault(key, &format!("{x} is no number of pixels from 1 to 65536")))
        };
        let (width, height) = (pixels("w", found[0])?, pixels("h", found[1])?);
        let focal = |key: &str, by_angle: &str, n: usize| -> Result<Option<f64>> {
            if let Some(pixels) = self.number(key)? {
                return Ok(Some(pixels));
            }
            let Some(angle) = self.number(by_angle)? else { return Ok(None) };
            if angle > 0.0 && angle < PI {
                return Ok(Some(0.5 * n as f64 / (0.5 * angle).tan()));
            }
            let problem = format!("{angle:?} is no field of view; give radians above 0 and below {PI:.4}");
            Err(self.fault(by_angle, &problem))
        };
        let missing = || content(self.path, self.place, "no focal length; give fl_x or camera_angle_x");
        let fx = focal("fl_x", "camera_angle_x", width)?.ok_or_else(missing)?;
        let fy = focal("fl_y", "camera_angle_y", height)?.unwrap_or(fx);
        let shift = if centres == PixelCentres::Halves { HALF } else { 0.0 };
        let middle = |key: &str, n: usize| -> Result<f64> {
            Ok(self.number(key)?.map_or(0.5 * (n as f64 - 1.0), |c| c - shift))
        };
        let camera = PinholeCamera::new(fx, fy, middle("cx", width)?, middle("cy", height)?, width, height)
            .map_err(|e| content(self.path, self.place, e.to_string()))?;
        let k = |key: &str| Ok::<f64, Error>(self.number(key)?.unwrap_or(0.0));
        let distortion = Distortion { k1: k("k1")?, k2: k("k2")?, k3: k("k3")?, p1: k("p1")?, p2: k("p2")? };
        let lens = Lens { camera, distortion };
        lens.check().map_err(|problem| content(self.path, self.place, problem))?;
        Ok(lens)
    }

    fn pose(&self, photograph: &str) -> Result<Pose> {
        let bad = || self.fault("transform_matrix", "not 4x4 (or 3x4) finite numbers");
        let rows = self.own.get("transform_matrix").and_then(Value::as_array).ok_or_else(bad)?;
        if !(3..=4).contains(&rows.len()) {
            return Err(bad());
        }
        let mut m = [[0.0; 4]; 3];
        for (row, values) in m.iter_mut().zip(rows) {
            let values = values.as_array().filter(|v| v.len() == 4).ok_or_else(bad)?;
            for (entry, value) in row.iter_mut().zip(values) {
                *entry = value.as_f64().filter(|x| x.is_finite()).ok_or_else(bad)?;
            }
        }
        // OpenGL's y and z axes point against OpenCV's.
        let turned = Matrix3::from_fn(|r, c| if c == 0 { m[r][c] } else { -m[r][c] });
        let centre = [m[0][3], m[1][3], m[2][3]];
        Ok(pose(self.path, photograph, rotation(&turned), centre)?.inverse())
    }
}

/// The text of a `transforms.json` of `frames`, with intrinsics for each; photographs are named relative to `folder`
/// where they lie below it; `more` gives further text fields of each frame by its index, `depth_file_path` for example. Principal points have pixel centres at halves, as in nerfstudio; `pixel_centres` has that convention.
///
/// ```
/// use mde_mvs::capture::{Distortion, Frame, Lens, transforms_json};
/// use mde_warp::{PinholeCamera, Pose};
///
/// let lens = Lens { camera: PinholeCamera::from_fov(60.0, 640, 480)?, distortion: Distortion::default() };
/// let frame = Frame { photograph: "shots/a.jpg".into(), lens, pose: Pose::identity() };
/// let text = transforms_json(&[frame], "shots".as_ref(), |_| Vec::new());
/// assert!(text.contains("\"file_path\": \"a.jpg\""));
/// # Ok::<(), mde_warp::Error>(())
/// ```
pub fn transforms_json(
    frames: &[Frame],
    folder: &Path,
    more: impl Fn(usize) -> Vec<(&'static str, String)>,
) -> String {
    let entries: Vec<Value> = frames
        .iter()
        .enumerate()
        .map(|(index, frame)| {
            let camera = &frame.lens.camera;
            let d = &frame.lens.distortion;
            let m = frame.pose.inverse().to_homogeneous();
            let row = |r| [0, 1, 2, 3].map(|c| if c == 1 || c == 2 { -m[(r, c)] } else { m[(r, c)] });
            let name = frame.photograph.strip_prefix(folder).unwrap_or(&frame.photograph);
            let mut entry = json!({
                "file_path": name.to_string_lossy().replace('\\', "/"),
                "fl_x": camera.fx, "fl_y": camera.fy, "cx": camera.cx + HALF, "cy": camera.cy + HALF,
                "w": camera.width, "h": camera.height,
                "k1": d.k1, "k2": d.k2, "k3": d.k3, "p1": d.p1, "p2": d.p2,
                "transform_matrix": [row(0), row(1), row(2), row(3)],
            });
            for (key, value) in more(index) {
                entry[key] = json!(value);
            }
            entry
        })
        .collect();
    // Without it, nerfstudio takes a folder colmap/ beside the file for the origin of the poses, with axes of its own.
    let unmoved = [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0]];
    let root = json!({
        "camera_model": "OPENCV", "pixel_centres": "halves", "applied_transform": unmoved, "frames": entries,
    });
    format!("{root:#}\n")
}
