//! The methods to compare: presets, configuration files, and baselines.

use crate::config::{Config, MultiViewConfig, Preset};
use crate::prior::{OpenPrior, hash_files};
use crate::program::Progress;
use crate::program::evaluation::depth_file;
use crate::program::store::files_in;
use crate::refinement::{FieldFactory, FieldRequest};
use crate::refiner::{MemoryLimit, Prepared, Refiner, Settings, Unit};
use crate::scene::Scene;
use anyhow::{Context, Result, ensure};
use mde_eval::field::{FieldMemory, FilteredField, SharedField};
use mde_eval::{Refined, Task, baseline};
use mde_nerf::RadianceField;
use mde_prior::DisparityRule;
use mde_prior::format::{ReadOptions, read_depth};
use ndarray::Array2;
use serde_json::{Value, json};
use std::path::{Path, PathBuf};

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
    Maps(PathBuf, String),
}

/// The consensus of the plane sweeps of several photographs, without a field.
const CONSENSUS: &str = "consensus";
/// The preset `multi-view`, by what it adds to the consensus.
const FIELD: &str = "field";

impl Method {
    /// Parses the name of a preset or a baseline, `[PRESET:]FILE.toml` over that preset or `default`, or `NAME=FOLDER` of other maps.
    pub(crate) fn parse(text: &str, seed: Option<u64>) -> Result<Self> {
        let named = |name: &str| match name {
            FIELD => Some(Preset::MultiView),
            _ => Preset::ALL.into_iter().find(|preset| preset.name() == name),
        };
        let (name, preset, config) = if Path::new(text)
            .extension()
            .is_some_and(|e| e.eq_ignore_ascii_case("toml"))
        {
            let over = text.split_once(':').and_then(|(name, path)| Some((named(name)?, path)));
            let (preset, path) = over.unwrap_or((Preset::Default, text));
            let path = Path::new(path);
            let config = preset.config().with_file(path)?;
            ensure!(
                preset == Preset::MultiView || config.multi_view == MultiViewConfig::default(),
                "{text}: multi-view counts for several photographs only; give multi-view:{}",
                path.display()
            );
            (path.file_stem().unwrap_or_default().to_string_lossy().into_owned(), preset, config)
        } else if let Some((name, folder)) = text.split_once('=') {
            ensure!(!name.is_empty(), "--methods {text}: give the maps a name, as in sgbm=FOLDER");
            let folder = Path::new(folder);
            let files = files_in(folder).with_context(|| format!("--methods {text}"))?;
            let files: Vec<PathBuf> = files.iter().map(|file| folder.join(file)).collect();
            let kind = Kind::Maps(folder.to_owned(), hash_files(files.iter().map(PathBuf::as_path))?);
            return Ok(Self { name: name.to_owned(), label: name.to_owned(), seed: 0, kind });
        } else if let Some(preset) = named(text) {
            (text.to_owned(), preset, preset.config())
        } else if text == CONSENSUS {
            let mut config = Preset::MultiView.config();
            config.refinement.iterations = 0;
            (text.to_owned(), Preset::MultiView, config)
        } else {
            baseline::named(text).with_context(|| {
                let presets = Preset::ALL.map(Preset::name).join(", ");
                format!("--methods {text}: neither a preset ({presets}) nor consensus, field, a .toml file or a baseline")
            })?;
            let (name, label) = (text.to_owned(), text.to_owned());
            return Ok(Self { name, label, seed: seed.unwrap_or(0), kind: Kind::Baseline });
        };
        let seed = seed.unwrap_or(config.seed);
        let (config, several) = (Box::new(Config { seed, ..config }), preset == Preset::MultiView);
        Ok(Self { label: name.clone(), name, seed, kind: Kind::Loop { config, several, control: None } })
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
        Ok(methods)
    }

    /// The settings of the loop with the method's own seed; `None` for a baseline.
    pub(crate) fn config(&self) -> Option<&Config> {
        match &self.kind {
            Kind::Loop { config, .. } => Some(config),
            Kind::Baseline | Kind::Maps(..) => None,
        }
    }

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

    /// Refines a scene; `task` is that of a baseline.
    pub(crate) fn run(
        &self,
        scene: &MethodScene<'_>,
        task: &Task<'_>,
        fields: Option<&FieldMemory>,
    ) -> Result<Refined> {
        match &self.kind {
            Kind::Baseline => Ok(baseline::named(&self.label)?.refine(&Task { seed: self.seed, ..*task })?),
            Kind::Maps(folder, _) => {
                let file = depth_file(folder, scene.id)?;
                let depth =
                    read_depth(&file, &ReadOptions::default()).with_context(|| file.display().to_string())?;
                Ok(depth.into())
            }
            Kind::Loop { config, several: true, .. } => scene.refined(config, scene.photographs, None),
            Kind::Loop { config, control, .. } => {
                let mut factory =
                    |request: FieldRequest<'_>| -> crate::error::Result<Box<dyn RadianceField>> {
                        let (config, seed) = (request.config.clone(), request.seed);
                        Ok(match (control, fields) {
                            (Some(control), _) => {
                                let filter =
                                    baseline::named(control).map_err(crate::error::Error::external)?;
                                Box::new(FilteredField::new(filter, seed))
                            }
                            (None, Some(memory)) if request.iteration == 0 => {
                                Box::new(SharedField::new(memory, config, seed))
                            }
                            (None, _) => Box::new(request.nerf()?),
                        })
                    };
                scene.refined(config, scene.alone, Some(&mut factory))
            }
        }
    }
}

/// A scene as methods get it.
pub(crate) struct MethodScene<'s> {
    pub(crate) id: &'s str,
    pub(crate) prior: &'s OpenPrior<'s>,
    /// The reference alone.
    pub(crate) alone: &'s Scene,
    /// The reference, and the further photographs where there are some.
    pub(crate) photographs: &'s Scene,
    pub(crate) memory: MemoryLimit,
}

impl MethodScene<'_> {
    /// The prior's depth, of the photograph's size.
    pub(crate) fn prior_depth(&self) -> Result<Array2<f32>> {
        self.prepared(Preset::Default.config(), self.alone, |prepared| prepared.prior_depth())
    }

    /// What `mde refine` makes of the photographs; of posed ones in the unit of their poses.
    fn refined(
        &self,
        config: &Config,
        photographs: &Scene,
        field: Option<&mut FieldFactory<'_>>,
    ) -> Result<Refined> {
        // Every method has the prior's conversion of disparity.
        let config = Config { disparity: DisparityRule::default(), ..config.clone() };
        self.prepared(config, photographs, |prepared| {
            let refined = prepared.refine(0, field, &mut Progress::silent())?;
            let refinement = refined.refinement;
            Ok(Refined {
                depth: refinement.depth.mean().to_owned(),
                sigma: Some(refinement.depth.sigma()),
                report: json!({ "augmentation": refinement.augmentation, "iterations": refinement.iterations, "capture": refinement.capture }),
            })
        })
    }

    fn prepared<T>(
        &self,
        config: Config,
        photographs: &Scene,
        then: impl FnOnce(&mut Prepared<'_>) -> crate::error::Result<T>,
    ) -> Result<T> {
        let unit = if photographs.is_posed() { Unit::Capture } else { Unit::Prior };
        let settings = Settings { config, unit, memory: self.memory, ..Settings::new(Preset::Default) };
        let refiner = Refiner::new(self.prior, settings)?;
        let reference = &photographs.photographs[0];
        let plan = refiner.plan(self.id, reference.original, photographs.photographs.len())?;
        Ok(then(&mut refiner.prepare(photographs, &plan, &mut Progress::silent())?)?)
    }
}
