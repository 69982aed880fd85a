//! Scenes with the monocular depth that every method starts from.

use crate::program::args::{DataArgs, EncodingName, EvalPriorArgs, FaultName, PriorArgs, PriorSource, RuntimeArgs};
use crate::program::open::prior::NamedPrior;
use anyhow::{Context, Result, bail};
use mde_eval::data::{self, CaptureGrid, DataSet, DataSetKind, Options, Sample, SunDepth};
use mde_eval::simulated::{SimulatedModel, SimulatedModelConfig, SimulatedPrior, SimulatedPriorConfig};
use mde_prior::{DepthKind, DepthPrior, DisparityRule, PriorDepth};
use ndarray::Array2;
use serde_json::{Value, json};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// A data set with the options that it was opened with.
pub(crate) struct Source {
    pub(crate) data: Box<dyn DataSet>,
    pub(crate) kind: DataSetKind,
    options: Options,
    without_poses: bool,
    /// The assumed field of view, degrees, where the cameras are withheld.
    assumed_fov: Option<f64>,
}

impl Source {
    pub(crate) fn open(root: &Option<PathBuf>, args: &DataArgs) -> Result<Self> {
        let kind = match (args.dataset, root) {
            (Some(kind), _) => kind,
            (None, Some(root)) => DataSetKind::guess(root)?,
            (None, None) => bail!("name a data set's folder, or give --dataset rooms"),
        };
        let places = match &args.places {
            Some(path) => {
                let text = std::fs::read_to_string(path).with_context(|| path.display().to_string())?;
                data::parse_places(&text).with_context(|| path.display().to_string())?
            }
            None => BTreeMap::new(),
        };
        let pose_noise = match args.pose_noise[..] {
            [degrees] => degrees,
            _ if kind == DataSetKind::Captures => 0.0,
            _ => {
                bail!("--pose-noise: several values make procedural captures; give one with --dataset {kind}")
            }
        };
        let options = Options {
            places,
            pose_noise,
            assumed_fov: Some(args.assume_fov),
            sun_depth: if args.filled_depth { SunDepth::Filled } else { SunDepth::Sensor },
            size: args.size,
            stride: usize::from(args.stride),
            captures: CaptureGrid {
                views: args.photographs.clone(),
                baselines: args.baseline.clone(),
                pose_noises: args.pose_noise.clone(),
                gains: args.gain.clone(),
            },
            ..Options::default()
        };
        let data = data::open(kind, root.as_deref(), &options)?;
        let assumed_fov = args.without_intrinsics.then_some(args.assume_fov);
        Ok(Self { data, kind, options, without_poses: args.without_poses, assumed_fov })
    }

    /// The options that determine images and truth of the scenes; not the folder, which may be moved.
    pub(crate) fn describe(&self) -> Value {
        let mut value = json!({ "dataset": self.kind.name(), "size": self.options.size,
                                "depth": self.options.sun_depth, "stride": self.options.stride });
        if self.kind == DataSetKind::Captures {
            let CaptureGrid { views, baselines, pose_noises, gains } = &self.options.captures;
            value["captures"] =
                json!({ "views": views, "baselines": baselines, "pose_noises": pose_noises, "gains": gains });
        }
        if self.kind == DataSetKind::Posed && self.options.pose_noise > 0.0 {
            value["pose_noise"] = json!(self.options.pose_noise);
        }
        if self.without_poses {
            value["poses"] = json!("withheld");
        }
        if let Some(fov) = self.assumed_fov {
            value["assumed_fov"] = json!(fov);
        }
        value
    }

    pub(crate) fn title(&self) -> String {
        let size = self.options.size.map_or_else(String::new, |[w, h]| format!(" at {w}x{h}"));
        let noise = self.options.pose_noise;
        let poses = match (self.without_poses, self.assumed_fov) {
            (_, Some(fov)) => format!(", poses and cameras withheld, {fov} degrees assumed"),
            (true, None) => ", poses withheld".to_owned(),
            (false, None) if self.kind == DataSetKind::Posed && noise > 0.0 => {
                format!(", poses off by {noise} degrees")
            }
            (false, None) => String::new(),
        };
        format!("{}{size}{poses}", self.kind)
    }
}

/// Where the priors of an evaluation come from.
#[derive(Debug)]
pub(crate) enum PriorPlan {
    /// A model.
    Model(PriorArgs),
    /// A folder with one depth map per scene, named after it.
    Folder(PathBuf, PriorArgs),
    /// The degraded truth of a procedural room.
    Simulated,
    /// A simulated model of each procedural room, for crops and mirror images too.
    SimulatedModel(SimulatedModelConfig),
}

impl PriorPlan {
    /// The prior of the command line; for procedural rooms the default is the simulated one.
    pub(crate) fn new(args: &EvalPriorArgs, kind: DataSetKind) -> Result<Self> {
        let source = |depth: bool| PriorSource {
            prior_model: args.prior_model.clone(),
            prior_depth: args.prior_depth.clone().filter(|_| depth),
        };
        let prior_args = |depth| PriorArgs {
            source: source(depth),
            model_profile: args.model_profile.clone(),
            input_size: None,
            prior_kind: args.prior_kind,
            png_scale: args.png_scale,
            prior_encoding: EncodingName::Plain,
            runtime: RuntimeArgs::default(),
        };
        let rooms = kind == DataSetKind::Rooms;
        let procedural = rooms || kind == DataSetKind::Captures;
        if let Some(fault) = args.simulated_model {
            if !rooms {
                bail!("--simulated-model: needs exact depth; use it with --dataset rooms");
            }
            return Ok(Self::SimulatedModel(faults(fault)));
        }
        match (&args.prior_model, &args.prior_depth) {
            (Some(_), _) => Ok(Self::Model(prior_args(false))),
            (None, Some(folder)) => Ok(Self::Folder(folder.clone(), prior_args(true))),
            (None, None) if procedural => Ok(Self::Simulated),
            (None, None) if args.simulated_prior => {
                bail!("--simulated-prior: needs exact depth; use it with --dataset rooms or captures")
            }
            (None, None) => bail!("no prior is named; give --prior-model MODEL.onnx or --prior-depth FOLDER"),
        }
    }

    /// Name for the title.
    pub(crate) fn title(&self) -> String {
        match self {
            Self::Model(args) => args.source.prior_model.as_deref().map(file_name).unwrap_or_default(),
            Self::Folder(path, _) => format!("the priors in {}", path.display()),
            Self::Simulated => "simulated priors".to_owned(),
            Self::SimulatedModel(_) => "a simulated model".to_owned(),
        }
    }

    /// Whether it is a model that accepts new images.
    pub(crate) fn accepts_new_images(&self) -> bool {
        matches!(self, Self::Model(_) | Self::SimulatedModel(_))
    }

    /// Whether its maps are in metres, by the command line and the model.
    pub(crate) fn is_metric(&self) -> Result<bool> {
        Ok(match self {
            Self::Model(args) => NamedPrior::open(args)?.origin.kind == DepthKind::Metric,
            Self::Folder(_, args) => {
                args.prior_kind.is_none_or(|kind| DepthKind::from(kind) == DepthKind::Metric)
            }
            Self::Simulated | Self::SimulatedModel(_) => false,
        })
    }

    /// Identifies the model's file, where there is one.
    pub(crate) fn model_hash(&self) -> Result<Option<String>> {
        match self {
            Self::Model(args) => Ok(NamedPrior::open(args)?.origin.model_hash),
            _ => Ok(None),
        }
    }

    /// Description for the record.
    pub(crate) fn describe(&self) -> Result<Value> {
        Ok(match self {
            Self::Model(args) => {
                let Some(path) = &args.source.prior_model else { bail!("no model is named") };
                let origin = NamedPrior::open(args)?.origin;
                json!({ "model": file_name(path), "crc32": origin.model_hash, "kind": origin.kind,
                        "settings": origin.model })
            }
            Self::Folder(path, args) => {
                json!({ "folder": path.display().to_string(), "kind": args.prior_kind.map(DepthKind::from),
                        "png_scale": args.png_scale })
            }
            Self::Simulated => json!("simulated"),
            Self::SimulatedModel(faults) => json!({ "simulated": faults }),
        })
    }

    /// Everything that a scene's prior depends on besides the scene: of files the content, not the place. `described` is
    /// [`describe`](Self::describe).
    pub(crate) fn made_from(&self, described: &Value, scene: &str) -> Result<Value> {
        let mut made_from = described.clone();
        let removed = match self {
            Self::Model(_) => "model",
            Self::Folder(folder, _) => {
                let file = depth_file(folder, scene)?;
                let bytes = std::fs::read(&file).with_context(|| file.display().to_string())?;
                // The extension decides how the bytes are read.
                made_from["file"] = json!([extension(&file), crc32fast::hash(&bytes)]);
                "folder"
            }
            Self::Simulated | Self::SimulatedModel(_) => return Ok(made_from),
        };
        if let Some(map) = made_from.as_object_mut() {
            map.remove(removed);
        }
        Ok(made_from)
    }

    /// Opens the prior, once for many scenes.
    pub(crate) fn open(&self) -> Result<Priors<'_>> {
        Ok(match self {
            Self::Model(args) => Priors::Model(NamedPrior::open(args)?.prior),
            Self::Folder(path, args) => Priors::Folder(path, args),
            Self::Simulated => Priors::Simulated,
            Self::SimulatedModel(faults) => Priors::SimulatedModel(faults),
        })
    }
}

/// Opened priors, one per worker.
pub(crate) enum Priors<'p> {
    Model(Box<dyn DepthPrior>),
    Folder(&'p Path, &'p PriorArgs),
    Simulated,
    SimulatedModel(&'p SimulatedModelConfig),
}

impl Priors<'_> {
    /// The model for further predictions on a scene, where there is one.
    pub(crate) fn model(&self, sample: &Sample) -> Result<Option<Box<dyn DepthPrior + '_>>> {
        Ok(match self {
            Self::Model(model) => Some(Box::new(&**model)),
            Self::SimulatedModel(faults) => Some(Box::new(simulated(sample, faults)?)),
            Self::Folder(..) | Self::Simulated => None,
        })
    }

    /// The monocular depth of a scene, `[height, width]`; 0 where missing.
    pub(crate) fn depth(&self, sample: &Sample, rule: &DisparityRule, seed: u64) -> Result<Array2<f32>> {
        let prediction = match self {
            Self::Model(model) => model.predict(sample.image.view())?,
            Self::Folder(folder, args) => {
                let file = depth_file(folder, &sample.id)?;
                let args = PriorArgs {
                    source: PriorSource { prior_model: None, prior_depth: Some(file) },
                    ..(*args).clone()
                };
                NamedPrior::open(&args)?.prior.predict(sample.image.view())?
            }
            Self::Simulated => match &sample.prior {
                Some(prior) => prior.clone(),
                None => {
                    let faults = SimulatedPriorConfig { seed, ..SimulatedPriorConfig::disparity() };
                    SimulatedPrior::new(&sample.depth, &faults)?.predict(sample.image.view())?
                }
            },
            Self::SimulatedModel(faults) => simulated(sample, faults)?.predict(sample.image.view())?,
        };
        Ok(prediction.to_depth(rule)?)
    }
}

fn simulated(sample: &Sample, faults: &SimulatedModelConfig) -> Result<SimulatedModel> {
    Ok(SimulatedModel::new(&sample.image, &sample.depth, faults.clone())?)
}

/// One fault, strong enough to be visible, or all of them.
fn faults(name: FaultName) -> SimulatedModelConfig {
    let all = SimulatedModelConfig::default();
    let small = SimulatedModelConfig::small(all.side);
    let fine = SimulatedModelConfig::small(4096);
    match name {
        FaultName::Resolution => small,
        FaultName::Thin => SimulatedModelConfig { lost_cells: all.lost_cells, ..small },
        FaultName::Missed => SimulatedModelConfig { lost_width: all.lost_width, ..fine },
        FaultName::Shared => SimulatedModelConfig { shared_error: all.shared_error, ..fine },
        FaultName::Own => SimulatedModelConfig { own_error: all.own_error, ..fine },
        FaultName::All => all,
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

fn extension(path: &Path) -> String {
    path.extension().unwrap_or_default().to_string_lossy().into_owned()
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
