//! The methods to compare: presets, configuration files, and baselines.

use crate::config::{Config, MultiViewConfig, Preset};
use crate::prior::OpenPrior;
use crate::program::evaluation::fields::{FieldMemory, FilteredField};
use crate::program::evaluation::scenes::depth_file;
use crate::program::interrupt;
use crate::program::store::folder::files_in;
use crate::refinement::event::Event;
use crate::refinement::stages::{FieldFactory, FieldRequest};
use crate::refiner::plan::limit::MemoryLimit;
use crate::refiner::{Observer, Refiner, Settings, Unit};
use crate::scene::Scene;
use anyhow::{Context, Result, bail, ensure};
use mde_eval::baseline;
use mde_eval::{Method as Baseline, Refined, Task};
use mde_nerf::RadianceField;
use mde_prior::format::{ReadOptions, read_depth};
use serde_json::{Value, json};
use std::ops::ControlFlow;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// The prior without refinement, the reference of the comparisons.
pub(crate) const PRIOR: &str = "prior";

/// A way of refining depth, with its settings and seed.
#[derive(Clone)]
pub(crate) struct Method {
    /// Unique among the methods of a run.
    pub(crate) name: String,
    /// Name in the tables, the same for all seeds.
    pub(crate) label: String,
    pub(crate) seed: u64,
    kind: Kind,
}

#[derive(Clone)]
enum Kind {
    /// A baseline of `mde-eval`, by its name there.
    Baseline,
    /// What `mde refine` does, of one photograph or of `several`, with a baseline in place of the field where one is named.
    Loop { config: Box<Config>, several: bool, control: Option<&'static str> },
    /// Depth maps of another program, `FOLDER/SCENE.npy`, and the checksum of their files.
    Maps(PathBuf, u32),
}

/// The consensus of the plane sweeps of several photographs, without a field.
const CONSENSUS: &str = "consensus";
/// The preset `multi-view`, by what it adds to the consensus.
const FIELD: &str = "field";

impl Method {
    /// Parses the name of a preset or a baseline, or the path of a TOML file over `default` or the preset before a colon.
    pub(crate) fn parse(text: &str, seed: Option<u64>) -> Result<Self> {
        let named = |name: &str| match name {
            FIELD => Some(Preset::MultiView),
            _ => Preset::ALL.into_iter().find(|preset| preset.name() == name),
        };
        if Path::new(text).extension().is_some_and(|e| e.eq_ignore_ascii_case("toml")) {
            let over = text.split_once(':').and_then(|(name, path)| Some((named(name)?, path)));
            let (preset, path) = over.unwrap_or((Preset::Default, text));
            let path = Path::new(path);
            let name = path.file_stem().map(|stem| stem.to_string_lossy().into_owned());
            let config = preset.config().with_file(path)?;
            ensure!(
                preset == Preset::MultiView || config.multi_view == MultiViewConfig::default(),
                "{text}: multi-view counts for several photographs only; give multi-view:{}",
                path.display()
            );
            return Ok(Self::of_preset(name.unwrap_or_default(), preset, config, seed));
        }
        if let Some((name, folder)) = text.split_once('=') {
            return Self::of_maps(name, Path::new(folder));
        }
        if let Some(preset) = named(text) {
            return Ok(Self::of_preset(text.to_owned(), preset, preset.config(), seed));
        }
        if text == CONSENSUS {
            let mut config = Preset::MultiView.config();
            config.refinement.iterations = 0;
            return Ok(Self::of_preset(text.to_owned(), Preset::MultiView, config, seed));
        }
        baseline::named(text).with_context(|| {
            format!("--methods {text}: neither a preset (paper, default, fast, multi-view) nor consensus, field, a .toml file or a baseline")
        })?;
        let (name, label) = (text.to_owned(), text.to_owned());
        Ok(Self { name, label, seed: seed.unwrap_or(0), kind: Kind::Baseline })
    }

    /// The maps of another program.
    fn of_maps(name: &str, folder: &Path) -> Result<Self> {
        let named = || format!("--methods {name}={}", folder.display());
        ensure!(!name.is_empty(), "{}: give the maps a name, as in sgbm=FOLDER", named());
        let mut hasher = crc32fast::Hasher::new();
        for name in files_in(folder).with_context(named)? {
            let path = folder.join(&name);
            hasher.update(name.as_os_str().as_encoded_bytes());
            hasher.update(&std::fs::read(&path).with_context(|| path.display().to_string())?);
        }
        let kind = Kind::Maps(folder.to_owned(), hasher.finalize());
        Ok(Self { name: name.to_owned(), label: name.to_owned(), seed: 0, kind })
    }

    /// The loop with settings over a preset.
    fn of_preset(name: String, preset: Preset, config: Config, seed: Option<u64>) -> Self {
        let (label, seed) = (name.clone(), seed.unwrap_or(config.seed));
        let (config, several) = (Box::new(Config { seed, ..config }), preset == Preset::MultiView);
        Self { name, label, seed, kind: Kind::Loop { config, several, control: None } }
    }

    /// One variant of an ablation with one seed.
    pub(crate) fn variant(label: &str, config: Config, control: Option<&'static str>, seed: u64) -> Self {
        let (name, config) = (format!("{label}.seed{seed}"), Box::new(Config { seed, ..config }));
        Self { name, label: label.to_owned(), seed, kind: Kind::Loop { config, several: false, control } }
    }

    /// Parses a list of methods. The prior comes first and need not be named.
    pub(crate) fn parse_list(texts: &[String], seed: Option<u64>) -> Result<Vec<Self>> {
        let mut methods = vec![Self::parse(PRIOR, seed)?];
        for text in texts.iter().map(|text| text.trim()).filter(|text| *text != PRIOR) {
            let method = Self::parse(text, seed)?;
            ensure!(
                methods.iter().all(|other| other.name != method.name),
                "--methods: {} is named twice; give each method once",
                method.name
            );
            methods.push(method);
        }
        if texts.is_empty() {
            bail!("--methods: no method; give one or more, such as paper,default,guided");
        }
        Ok(methods)
    }

    /// The settings of the loop with the method's own seed; `None` for a baseline.
    pub(crate) fn config(&self) -> Option<&Config> {
        match &self.kind {
            Kind::Loop { config, .. } => Some(config),
            Kind::Baseline | Kind::Maps(..) => None,
        }
    }

    /// Whether it refines several photographs.
    pub(crate) fn is_of_photographs(&self) -> bool {
        matches!(self.kind, Kind::Loop { several: true, .. })
    }

    /// Everything besides the scene that the result depends on.
    pub(crate) fn settings(&self) -> Value {
        let what = match &self.kind {
            Kind::Baseline => json!({ "baseline": self.label }),
            Kind::Maps(_, checksum) => json!({ "maps": checksum }),
            Kind::Loop { config, several, control } => {
                json!({ "config": config, "photographs": several, "control": control })
            }
        };
        json!({ "method": what, "seed": self.seed, "version": env!("CARGO_PKG_VERSION") })
    }

    /// Refines a scene.
    pub(crate) fn run(&self, scene: &MethodScene<'_>, fields: Option<&FieldMemory>) -> Result<Refined> {
        let task = Task { seed: self.seed, ..scene.task };
        match &self.kind {
            Kind::Baseline => Ok(baseline::named(&self.label)?.refine(&task)?),
            Kind::Maps(folder, _) => {
                let file = depth_file(folder, scene.id)?;
                let depth =
                    read_depth(&file, &ReadOptions::default()).with_context(|| file.display().to_string())?;
                Ok(depth.into())
            }
            Kind::Loop { config, several: true, .. } => refine(config, scene, scene.photographs, None),
            Kind::Loop { config, control, .. } => {
                let control: Option<Arc<dyn Baseline + Send + Sync>> = match control {
                    Some(control) => Some(baseline::named(control)?.into()),
                    None => None,
                };
                let mut factory =
                    |request: FieldRequest<'_>| -> crate::error::Result<Box<dyn RadianceField>> {
                        Ok(match (&control, fields) {
                            (Some(control), _) => Box::new(FilteredField::new(control.clone(), request.seed)),
                            (None, Some(fields)) if request.iteration == 0 => {
                                Box::new(fields.field(request.config.clone(), request.seed))
                            }
                            (None, _) => Box::new(request.nerf()?),
                        })
                    };
                refine(config, scene, scene.alone, Some(&mut factory))
            }
        }
    }
}

/// What `mde refine` makes of the photographs; of posed ones in the unit of their poses.
fn refine(
    config: &Config,
    scene: &MethodScene<'_>,
    photographs: &Scene,
    field: Option<&mut FieldFactory<'_>>,
) -> Result<Refined> {
    let config = Config { disparity: scene.task.rule.clone(), ..config.clone() };
    let unit = if photographs.is_posed() { Unit::Capture } else { Unit::Prior };
    let settings = Settings { config, unit, memory: scene.memory, ..Settings::new(Preset::Default) };
    let refiner = Refiner::new(scene.prior, settings)?;
    let reference = &photographs.photographs[photographs.reference];
    let plan = refiner.plan(scene.id, reference.original, photographs.photographs.len())?;
    let mut prepared = refiner.prepare(photographs, &plan, &mut Interruptible)?;
    let refined = prepared.refine(photographs.reference, field, &mut Interruptible)?;
    let refinement = refined.refinement;
    Ok(Refined {
        depth: refinement.depth.mean().to_owned(),
        sigma: Some(refinement.depth.sigma()),
        report: json!({ "augmentation": refinement.augmentation, "iterations": refinement.iterations, "capture": refinement.capture }),
    })
}

/// A scene as methods get it.
pub(crate) struct MethodScene<'s> {
    pub(crate) id: &'s str,
    /// For baselines.
    pub(crate) task: Task<'s>,
    pub(crate) prior: &'s OpenPrior<'s>,
    /// The reference alone.
    pub(crate) alone: &'s Scene,
    /// The reference, and the further photographs where there are some.
    pub(crate) photographs: &'s Scene,
    pub(crate) memory: MemoryLimit,
}

/// An observer that ends a refinement by a signal, and keeps nothing.
pub(crate) struct Interruptible;

impl Observer for Interruptible {
    fn event(&mut self, _: &Event) -> ControlFlow<()> {
        interrupt::flow()
    }

    fn warn(&mut self, _: String) {}
}
