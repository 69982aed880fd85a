//! Scenes with the monocular depth that every method starts from.

use crate::prior::{OpenPrior, PriorForm, PriorOrigin};
use crate::program::open::prior;
use crate::program::{CaptureArgs, DataArgs, EvalPriorArgs, NetworkArgs, Simulated, Withheld};
use anyhow::{Context, Result, bail, ensure};
use mde_eval::data::{self, CaptureGrid, DataSet, DataSetKind, Options, OwnPriors, Sample};
use mde_eval::simulated::{SimulatedModel, SimulatedModelConfig, SimulatedPriorConfig, simulated_prior};
use mde_prior::{DepthKind, DepthPrior, FileKind, FilePrior, open};
use serde_json::{Value, json};
use std::ffi::OsStr;
use std::path::{Path, PathBuf};

/// An open data set.
pub(crate) struct Source {
    pub(crate) data: Box<dyn DataSet>,
    pub(crate) kind: DataSetKind,
    pub(crate) title: String,
    /// What determines images and truth of the scenes; not the folder, which may be moved.
    pub(crate) settings: Value,
    /// Whether the methods are given poses.
    pub(crate) posed: bool,
    /// The field of view that replaces the cameras, degrees.
    pub(crate) assumed_fov: Option<f64>,
}

impl Source {
    pub(crate) fn open(root: Option<&Path>, args: &DataArgs, several: &CaptureArgs) -> Result<Self> {
        let kind = match (args.dataset, root) {
            (Some(kind), _) => kind,
            (None, Some(root)) => DataSetKind::guess(root)?,
            (None, None) => bail!("name a data set's folder, or give --dataset rooms"),
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
        let withheld = several.withhold;
        let assumed_fov = (withheld == Some(Withheld::Cameras)).then_some(args.assume_fov);
        let mut settings = json!({ "dataset": kind, "size": args.size, "pose_noise": pose_noise,
            "poses_withheld": withheld.is_some(), "assumed_fov": assumed_fov });
        if kind == DataSetKind::Captures {
            let CaptureGrid { views, baselines, pose_noises, gains } = &captures;
            settings["captures"] =
                json!({ "views": views, "baselines": baselines, "pose_noises": pose_noises, "gains": gains });
        }
        let size = args.size.map_or_else(String::new, |[w, h]| format!(" at {w}x{h}"));
        let poses = match (withheld, assumed_fov) {
            (_, Some(fov)) => format!(", poses and cameras withheld, {fov} degrees assumed"),
            (Some(_), None) => ", poses withheld".to_owned(),
            (None, None) if pose_noise > 0.0 => format!(", poses off by {pose_noise} degrees"),
            (None, None) => String::new(),
        };
        let options = Options { pose_noise, assumed_fov: Some(args.assume_fov), size: args.size, captures };
        let data = data::open(kind, root, &options)?;
        let title = format!("{kind}{size}{poses}");
        Ok(Self { data, kind, title, settings, posed: withheld.is_none(), assumed_fov })
    }
}

pub(crate) struct Priors {
    pub(crate) form: Form,
    pub(crate) title: String,
    /// For the record.
    pub(crate) settings: Value,
}

/// Where the priors come from.
pub(crate) enum Form {
    /// A network, open for all scenes.
    Network(Box<OpenPrior<'static>>),
    /// A folder with one depth map per scene, named after it.
    Folder(PathBuf, NetworkArgs),
    /// The degraded truth of a procedural room.
    Simulated,
    /// A simulated network of each procedural room, for crops and mirror images too.
    SimulatedModel(SimulatedModelConfig),
}

impl Priors {
    /// The prior of the command line; for procedural rooms the default is the simulated one.
    pub(crate) fn open(args: &EvalPriorArgs, kind: DataSetKind) -> Result<Self> {
        let rooms = kind == DataSetKind::Rooms;
        let exact = rooms || kind == DataSetKind::Captures;
        let (form, title, settings) = match (&args.prior_model, &args.prior_depth, args.simulated) {
            (Some(model), ..) => {
                let open = prior::network(model, &args.network)?;
                let origin = open.origin();
                let title = model.file_name().unwrap_or_default().to_string_lossy().into_owned();
                let settings = json!({ "model": title, "crc32": origin.model_hash, "kind": origin.kind, "settings": origin.model,
                                       "runtime": origin.runtime });
                (Form::Network(Box::new(open)), title, settings)
            }
            (None, Some(folder), _) => {
                let (args, shown) = (args.network.clone(), folder.display());
                let settings = json!({ "folder": shown.to_string(), "kind": args.prior_kind, "png_scale": args.png_scale });
                (Form::Folder(folder.clone(), args), format!("the priors in {shown}"), settings)
            }
            (None, None, Some(Simulated::Model)) => {
                ensure!(rooms, "--simulated model: needs a room's exact depth; use it with --dataset rooms");
                let faults = SimulatedModelConfig::default();
                let settings = json!({ "simulated": faults });
                (Form::SimulatedModel(faults), "a simulated model".to_owned(), settings)
            }
            (None, None, _) if exact => (Form::Simulated, "simulated priors".to_owned(), json!("simulated")),
            (None, None, Some(Simulated::Prior)) => {
                bail!("--simulated prior: needs exact depth; use it with --dataset rooms or captures")
            }
            (None, None, None) => {
                bail!("no prior is named; give --prior-model MODEL.onnx or --prior-depth FOLDER")
            }
        };
        Ok(Self { form, title, settings })
    }

    /// Whether it is a model that accepts new images.
    pub(crate) fn accepts_new_images(&self) -> bool {
        matches!(self.form, Form::Network(_) | Form::SimulatedModel(_))
    }

    /// Whether its maps are in metres where the cameras are known.
    pub(crate) fn is_metric(&self) -> bool {
        match &self.form {
            // The cameras of data sets are known, whatever the focal length.
            Form::Network(open) => open.origin().at_focal(Some(1.0)).kind == DepthKind::Metric,
            Form::Folder(_, args) => args.prior_kind.is_none_or(|kind| kind == DepthKind::Metric),
            Form::Simulated | Form::SimulatedModel(_) => false,
        }
    }

    /// Identifies the network's files, where there is one.
    pub(crate) fn model_hash(&self) -> Option<String> {
        let Form::Network(open) = &self.form else { return None };
        open.origin().model_hash.clone()
    }

    /// Everything that a scene's prior depends on besides the scene: of files the content, not the place.
    pub(crate) fn made_from(&self, scene: &str) -> Result<Value> {
        let mut made_from = self.settings.clone();
        if let Form::Folder(path, _) = &self.form {
            let file = depth_file(path, scene)?;
            let bytes = open::read(&file, FileKind::DepthMap).with_context(|| file.display().to_string())?;
            // The extension decides how the bytes are read.
            made_from["file"] =
                json!([file.extension().map(OsStr::to_string_lossy), crc32fast::hash(&bytes)]);
        }
        if let Some(fields) = made_from.as_object_mut() {
            fields.retain(|key, _| !["model", "folder"].contains(&key.as_str()));
        }
        Ok(made_from)
    }

    /// The prior of a scene, in `own` where the scenes share none; what is simulated here has that seed.
    pub(crate) fn of_scene<'o, 'p>(
        &'o self,
        sample: &'p Sample,
        seed: u64,
        own: &'o mut Option<OpenPrior<'p>>,
    ) -> Result<&'o OpenPrior<'p>> {
        let (prior, kind): (Box<dyn DepthPrior + Send + 'p>, _) = match &self.form {
            Form::Network(open) => return Ok(open),
            Form::Folder(path, args) => {
                return Ok(own.insert(prior::map(&depth_file(path, &sample.id)?, args)?));
            }
            Form::Simulated => match &sample.prior {
                Some(prior) => (Box::new(OwnPriors(sample)), prior.kind),
                None => {
                    let faults = SimulatedPriorConfig { seed, ..SimulatedPriorConfig::disparity() };
                    let prior = FilePrior::of_map("simulated", simulated_prior(&sample.depth, &faults)?);
                    (Box::new(prior), faults.kind)
                }
            },
            Form::SimulatedModel(faults) => {
                let model = SimulatedModel::new(&sample.image, &sample.depth, faults.clone())?;
                (Box::new(model), DepthKind::AffineDisparity)
            }
        };
        let origin = PriorOrigin::new(PriorForm::Simulated, kind, "simulated");
        Ok(own.insert(OpenPrior::given(prior, origin)))
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

/// Indices of the scenes that `wanted` names, whole or by the last part (all if it is empty), at most `limit`.
pub(crate) fn choose(ids: &[String], wanted: &[String], limit: Option<u32>) -> Result<Vec<usize>> {
    let fits = |id: &str, name: &str| id == name || id.rsplit('/').next() == Some(name);
    for name in wanted {
        let some = || ids.iter().take(5).cloned().collect::<Vec<_>>().join(", ");
        ensure!(
            ids.iter().any(|id| fits(id, name)),
            "--scenes {name}: no such scene among the {} of the data set ({}, ...)",
            ids.len(),
            some()
        );
    }
    let is_wanted = |index: &usize| wanted.is_empty() || wanted.iter().any(|name| fits(&ids[*index], name));
    Ok((0..ids.len()).filter(is_wanted).take(limit.map_or(usize::MAX, |n| n as usize)).collect())
}
