//! Scenes with the monocular depth that every method starts from.

use crate::prior::OpenPrior;
use crate::prior::origin::{PriorForm, PriorOrigin};
use crate::program::args::{CaptureArgs, DataArgs, EvalPriorArgs, NetworkArgs, Simulated, Withheld};
use crate::program::open::prior;
use anyhow::{Context, Result, bail};
use mde_eval::data::{self, CaptureGrid, DataSet, DataSetKind, Options, Sample};
use mde_eval::simulated::{SimulatedModel, SimulatedModelConfig, SimulatedPrior, SimulatedPriorConfig};
use mde_prior::{DepthKind, DepthPrior, FileKind, PriorDepth, open};
use ndarray::{Array2, ArrayView3};
use serde_json::{Value, json};
use std::collections::BTreeMap;
use std::ffi::OsStr;
use std::path::{Path, PathBuf};

/// A data set with the options that it was opened with.
pub(crate) struct Source {
    pub(crate) data: Box<dyn DataSet>,
    pub(crate) kind: DataSetKind,
    options: Options,
    pub(crate) withheld: Option<Withheld>,
}

impl Source {
    pub(crate) fn open(root: Option<&Path>, args: &DataArgs, several: &CaptureArgs) -> Result<Self> {
        let kind = match (args.dataset, root) {
            (Some(kind), _) => kind,
            (None, Some(root)) => DataSetKind::guess(root)?,
            (None, None) => bail!("name a data set's folder, or give --dataset rooms"),
        };
        let places = match &args.places {
            Some(path) => {
                let text =
                    open::read_text(path, FileKind::Text).with_context(|| path.display().to_string())?;
                data::parse_places(&text).with_context(|| path.display().to_string())?
            }
            None => BTreeMap::new(),
        };
        let captures = several.grid.clone().unwrap_or_default();
        let pose_noise = match captures.pose_noises[..] {
            _ if kind == DataSetKind::Captures || several.grid.is_none() => 0.0,
            [degrees]
                if kind == DataSetKind::Posed
                    && captures == (CaptureGrid { pose_noises: vec![degrees], ..CaptureGrid::default() }) =>
            {
                degrees
            }
            _ => bail!("--grid: is for --dataset captures; with --dataset posed give one pose-noise"),
        };
        let options =
            Options { places, pose_noise, assumed_fov: Some(args.assume_fov), size: args.size, captures };
        let data = data::open(kind, root, &options)?;
        Ok(Self { data, kind, options, withheld: several.withhold })
    }

    /// The field of view that replaces the cameras, degrees, where these are withheld.
    pub(crate) fn assumed_fov(&self) -> Option<f64> {
        self.options.assumed_fov.filter(|_| self.withheld == Some(Withheld::Cameras))
    }

    /// The options that determine images and truth of the scenes; not the folder, which may be moved.
    pub(crate) fn describe(&self) -> Value {
        let mut value = json!({ "dataset": self.kind, "size": self.options.size });
        if self.kind == DataSetKind::Captures {
            let CaptureGrid { views, baselines, pose_noises, gains } = &self.options.captures;
            value["captures"] =
                json!({ "views": views, "baselines": baselines, "pose_noises": pose_noises, "gains": gains });
        }
        if self.options.pose_noise > 0.0 {
            value["pose_noise"] = json!(self.options.pose_noise);
        }
        if self.withheld.is_some() {
            value["poses"] = json!("withheld");
        }
        if let Some(fov) = self.assumed_fov() {
            value["assumed_fov"] = json!(fov);
        }
        value
    }

    pub(crate) fn title(&self) -> String {
        let size = self.options.size.map_or_else(String::new, |[w, h]| format!(" at {w}x{h}"));
        let noise = self.options.pose_noise;
        let poses = match (self.withheld, self.assumed_fov()) {
            (_, Some(fov)) => format!(", poses and cameras withheld, {fov} degrees assumed"),
            (Some(_), None) => ", poses withheld".to_owned(),
            (None, None) if noise > 0.0 => format!(", poses off by {noise} degrees"),
            (None, None) => String::new(),
        };
        format!("{}{size}{poses}", self.kind)
    }
}

/// Where the priors of an evaluation come from.
pub(crate) enum PriorPlan {
    /// A network, open for all scenes.
    Model(Box<OpenPrior<'static>>),
    /// A folder with one depth map per scene, named after it.
    Folder(PathBuf, NetworkArgs),
    /// The degraded truth of a procedural room.
    Simulated,
    /// A simulated network of each procedural room, for crops and mirror images too.
    SimulatedModel(SimulatedModelConfig),
}

/// The prior of a scene.
pub(crate) enum ScenePrior<'p> {
    Shared(&'p OpenPrior<'static>),
    Own(Box<OpenPrior<'p>>),
}

impl<'p> ScenePrior<'p> {
    pub(crate) fn open(&self) -> &OpenPrior<'p> {
        match self {
            Self::Shared(open) => open,
            Self::Own(open) => open,
        }
    }
}

impl PriorPlan {
    /// The prior of the command line; for procedural rooms the default is the simulated one.
    pub(crate) fn new(args: &EvalPriorArgs, kind: DataSetKind) -> Result<Self> {
        let rooms = kind == DataSetKind::Rooms;
        let exact = rooms || kind == DataSetKind::Captures;
        Ok(match (&args.prior_model, &args.prior_depth, args.simulated) {
            (Some(model), ..) => Self::Model(Box::new(prior::network(model, &args.network)?)),
            (None, Some(folder), _) => Self::Folder(folder.clone(), args.network.clone()),
            (None, None, Some(Simulated::Model)) if rooms => {
                Self::SimulatedModel(SimulatedModelConfig::default())
            }
            (None, None, Some(Simulated::Model)) => {
                bail!("--simulated model: needs a room's exact depth; use it with --dataset rooms")
            }
            (None, None, _) if exact => Self::Simulated,
            (None, None, Some(Simulated::Prior)) => {
                bail!("--simulated prior: needs exact depth; use it with --dataset rooms or captures")
            }
            (None, None, None) => {
                bail!("no prior is named; give --prior-model MODEL.onnx or --prior-depth FOLDER")
            }
        })
    }

    /// Name for the title.
    pub(crate) fn title(&self) -> String {
        match self {
            Self::Model(open) => file_name(Path::new(&open.origin().source)),
            Self::Folder(path, _) => format!("the priors in {}", path.display()),
            Self::Simulated => "simulated priors".to_owned(),
            Self::SimulatedModel(_) => "a simulated model".to_owned(),
        }
    }

    /// Whether it is a model that accepts new images.
    pub(crate) fn accepts_new_images(&self) -> bool {
        matches!(self, Self::Model(_) | Self::SimulatedModel(_))
    }

    /// Whether its maps are in metres where the cameras are known.
    pub(crate) fn is_metric(&self) -> bool {
        match self {
            // The cameras of data sets are known, whatever the focal length.
            Self::Model(open) => open.origin().at_focal(Some(1.0)).kind == DepthKind::Metric,
            Self::Folder(_, args) => args.prior_kind.is_none_or(|kind| kind == DepthKind::Metric),
            Self::Simulated | Self::SimulatedModel(_) => false,
        }
    }

    /// Identifies the model's file, where there is one.
    pub(crate) fn model_hash(&self) -> Option<String> {
        match self {
            Self::Model(open) => open.origin().model_hash.clone(),
            _ => None,
        }
    }

    /// Description for the record.
    pub(crate) fn describe(&self) -> Value {
        match self {
            Self::Model(open) => {
                let origin = open.origin();
                json!({ "model": self.title(), "crc32": origin.model_hash, "kind": origin.kind, "settings": origin.model,
                        "runtime": origin.runtime })
            }
            Self::Folder(path, NetworkArgs { prior_kind, png_scale, .. }) => {
                json!({ "folder": path.display().to_string(), "kind": prior_kind, "png_scale": png_scale })
            }
            Self::Simulated => json!("simulated"),
            Self::SimulatedModel(faults) => json!({ "simulated": faults }),
        }
    }

    /// Everything that a scene's prior depends on besides the scene: of files the content, not the place. `described` is
    /// [`describe`](Self::describe).
    pub(crate) fn made_from(&self, described: &Value, scene: &str) -> Result<Value> {
        let mut made_from = described.clone();
        let removed = match self {
            Self::Model(_) => "model",
            Self::Folder(path, _) => {
                let file = depth_file(path, scene)?;
                let bytes =
                    open::read(&file, FileKind::DepthMap).with_context(|| file.display().to_string())?;
                // The extension decides how the bytes are read.
                made_from["file"] =
                    json!([file.extension().map(OsStr::to_string_lossy), crc32fast::hash(&bytes)]);
                "folder"
            }
            Self::Simulated | Self::SimulatedModel(_) => return Ok(made_from),
        };
        if let Some(map) = made_from.as_object_mut() {
            map.remove(removed);
        }
        Ok(made_from)
    }

    /// The prior of a scene; what is simulated here has that seed.
    pub(crate) fn open<'p>(&'p self, sample: &'p Sample, seed: u64) -> Result<ScenePrior<'p>> {
        let own = |prior: Box<dyn DepthPrior + Send + 'p>, kind| {
            let origin = PriorOrigin::new(PriorForm::Simulated, kind, "simulated");
            ScenePrior::Own(Box::new(OpenPrior::given(prior, origin)))
        };
        Ok(match self {
            Self::Model(open) => ScenePrior::Shared(open),
            Self::Folder(path, args) => {
                let file = depth_file(path, &sample.id)?;
                ScenePrior::Own(Box::new(prior::map(&file, args)?))
            }
            Self::Simulated => match &sample.prior {
                Some(prior) => own(Box::new(OfSample(sample)), prior.kind),
                None => {
                    let faults = SimulatedPriorConfig { seed, ..SimulatedPriorConfig::disparity() };
                    own(Box::new(SimulatedPrior::new(&sample.depth, &faults)?), faults.kind)
                }
            },
            Self::SimulatedModel(faults) => {
                let model = SimulatedModel::new(&sample.image, &sample.depth, faults.clone())?;
                own(Box::new(model), DepthKind::AffineDisparity)
            }
        })
    }
}

/// The monocular depths that a data set brings for its photographs.
struct OfSample<'s>(&'s Sample);

impl DepthPrior for OfSample<'_> {
    fn predict(&self, image: ArrayView3<'_, f32>) -> mde_prior::Result<PriorDepth> {
        let Self(sample) = self;
        let own = (image == sample.image).then_some(sample.prior.as_ref());
        let known = || sample.views.iter().find(|one| one.view.image == image).map(|one| one.prior.as_ref());
        let unknown = || mde_prior::Error::Input("no depth of this image; name a model".to_owned());
        own.or_else(known).flatten().cloned().ok_or_else(unknown)
    }

    fn accepts_new_images(&self) -> bool {
        !self.0.views.is_empty() && self.0.views.iter().all(|view| view.prior.is_some())
    }
}

/// The file `FOLDER/ID` with the extension of a depth map.
pub(super) fn depth_file(folder: &Path, id: &str) -> Result<PathBuf> {
    const EXTENSIONS: [&str; 5] = ["npy", "npz", "pfm", "png", "exr"];
    let found = EXTENSIONS.iter().map(|e| folder.join(format!("{id}.{e}"))).find(|path| path.is_file());
    found.with_context(|| {
        format!("{}: no depth map {id}.npy (or .npz, .pfm, .png, .exr) for this scene", folder.display())
    })
}

fn file_name(path: &Path) -> String {
    path.file_name().unwrap_or_default().to_string_lossy().into_owned()
}

/// Checksum of the image, its camera, its own prior, the further photographs with theirs and, where given, the prior.
pub(crate) fn fingerprint(sample: &Sample, prior: Option<&Array2<f32>>) -> u32 {
    let mut hasher = crc32fast::Hasher::new();
    let camera = &sample.camera;
    for number in [camera.fx, camera.fy, camera.cx, camera.cy, camera.width as f64, camera.height as f64] {
        hasher.update(&number.to_le_bytes());
    }
    for value in sample.image.iter().chain(prior.into_iter().flatten()) {
        hasher.update(&value.to_le_bytes());
    }
    let brought = |prior: Option<&PriorDepth>, hasher: &mut crc32fast::Hasher| {
        if let Some(prior) = prior {
            hasher.update(prior.kind.to_string().as_bytes());
            let known = prior.map.iter().zip(&prior.valid);
            known.for_each(|(value, valid)| hasher.update(&if *valid { *value } else { 0.0 }.to_le_bytes()));
        }
    };
    brought(sample.prior.as_ref(), &mut hasher);
    for captured in &sample.views {
        brought(captured.prior.as_ref(), &mut hasher);
        let camera = &captured.view.camera;
        let pose = captured.view.pose.to_homogeneous();
        for number in [camera.fx, camera.fy, camera.cx, camera.cy].iter().chain(pose.iter()) {
            hasher.update(&number.to_le_bytes());
        }
        captured.view.image.iter().for_each(|value| hasher.update(&value.to_le_bytes()));
    }
    hasher.finalize()
}

/// Indices of the scenes that `wanted` names (all if it is empty), at most `limit`.
pub(crate) fn choose(data: &dyn DataSet, wanted: &[String], limit: Option<u32>) -> Result<Vec<usize>> {
    let ids = data.ids();
    let mut chosen = Vec::new();
    if wanted.is_empty() {
        chosen.extend(0..ids.len());
    }
    for name in wanted {
        let before = chosen.len();
        let fits = |id: &String| id == name || id.rsplit('/').next() == Some(name);
        chosen.extend((0..ids.len()).filter(|&index| fits(&ids[index])));
        if chosen.len() == before {
            let some = ids.iter().take(5).cloned().collect::<Vec<_>>().join(", ");
            bail!("--scenes {name}: no such scene among the {} of the data set ({some}, ...)", ids.len());
        }
    }
    chosen.sort_unstable();
    chosen.dedup();
    chosen.truncate(limit.map_or(usize::MAX, |n| n as usize));
    Ok(chosen)
}
