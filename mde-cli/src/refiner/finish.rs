//! From a refinement to a result: its unit, its error bar, its scale by known depths, and warnings.

use crate::refiner::plausibility::doubts;
use crate::refiner::error_bar::{ErrorBar, Stated};
use crate::error::{text, Error, Result};
use crate::refiner::known::{Known, Scaled};
use crate::refiner::camera::KnownCamera;
use crate::refiner::prior::origin::PriorOrigin;
use crate::refiner::depth_png::{DepthPng, METRES};
use crate::reports::prediction::Component;
use crate::config::Config;
use crate::naming::Naming;
use crate::reports::Refinement;
use mde_mvs::poses::LogFactor;
use mde_prior::DepthKind;
use mde_uncertainty::statistics::median;
use serde::Serialize;

/// Unit of a result with several photographs.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Unit {
    /// That of the prior.
    #[default]
    Prior,
    /// That of the poses that the photographs came with.
    Capture,
}

/// Error of a whole photograph's factor over that by what it has in common with others: the median of two networks on 13 captures
/// (docs/many.md).
const WHOLE: f64 = 2.2;

/// The factor of a photograph's prediction that brings it to one scale with others; in the record, of the refined map.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct SameScale {
    /// The factor.
    pub factor: f64,
    /// Standard deviation of its logarithm, relative to the mean over the group.
    pub log_sigma: f64,
    /// Number of the photographs that share a scale, from 0; not in the record, as it changes with other photographs.
    #[serde(skip)]
    pub group: usize,
    /// Photographs in the group.
    pub photographs: usize,
}

impl From<LogFactor> for SameScale {
    fn from(found: LogFactor) -> Self {
        let LogFactor { log, sigma, component, photographs } = found;
        Self { factor: log.exp(), log_sigma: WHOLE * sigma, group: component, photographs }
    }
}

impl SameScale {
    /// What a photograph's results depend on.
    pub fn key(&self) -> String {
        // Bits, as texts of numbers may differ.
        format!("{:016x} {:016x} {}", self.factor.to_bits(), self.log_sigma.to_bits(), self.photographs)
    }

    /// Whether no other photograph has this scale.
    pub fn is_alone(&self) -> bool {
        self.photographs < 2
    }

    /// A warning where no other photograph has this scale.
    pub fn warning(&self, naming: Naming) -> Option<String> {
        let name = naming.of("same-scale");
        self.is_alone().then(|| format!("{name}: matches no other photograph, and keeps its own scale"))
    }

    /// A warning where the factors of photographs are of several groups; `place` has the group of each.
    pub fn groups_warning(factors: &[Self], naming: Naming, place: &str) -> Option<String> {
        let alone = factors.iter().filter(|factor| factor.is_alone()).count();
        let groups = factors.iter().map(|factor| factor.group + 1).max().unwrap_or(0) - alone;
        let name = naming.of("same-scale");
        (groups > 1).then(|| {
            format!(
                "{name}: the photographs are {groups} groups without a match between them, each on a scale of its own; {place} has the group \
                 of each"
            )
        })
    }
}

/// What a refinement becomes a result by.
#[derive(Debug, Clone, Copy)]
pub struct Finish<'f> {
    /// The settings of the run.
    pub config: &'f Config,
    /// Where the prior comes from.
    pub origin: &'f PriorOrigin,
    /// The requested error bar.
    pub error_bar: &'f ErrorBar,
    /// Depths that give the scale.
    pub known: Option<&'f Known>,
    /// The scale in common with other photographs.
    pub same_scale: Option<SameScale>,
    /// The requested unit.
    pub unit: Unit,
    /// How warnings name arguments.
    pub naming: Naming,
}

/// A refinement in its unit and with its error bar.
pub struct Finished {
    /// The maps.
    pub refinement: Refinement,
    /// Their unit.
    pub unit: &'static str,
    /// The error bar.
    pub stated: Stated,
    /// How known depths gave the scale.
    pub scaled: Option<Scaled>,
    /// The factor to the scale in common with other photographs, of the refined map.
    pub same_scale: Option<SameScale>,
    /// Unit and scale of `depth.png`.
    pub png: DepthPng,
}

impl Finish<'_> {
    /// Name of the unit of the results: `m`, `capture` or `unscaled`.
    pub fn unit(&self) -> &'static str {
        match (self.known, self.unit, self.origin.kind) {
            (Some(known), ..) if known.of_model => "capture",
            (Some(_), ..) => METRES,
            (None, Unit::Capture, _) => "capture",
            (None, Unit::Prior, DepthKind::Metric) => METRES,
            (None, Unit::Prior, _) => "unscaled",
        }
    }

    /// The result. `photograph` is the index of the refined photograph within the capture; `camera` becomes the one that was estimated
    /// for it. Warnings go to `warn`, but for that of [`DepthPng`].
    ///
    /// # Errors
    /// [`Error::Argument`] for known depths that give no scale, [`Error::Scale`] for a factor that is none, and those of [`ErrorBar::apply`] and [`Refinement::in_capture_unit`].
    pub fn apply(
        &self,
        mut refinement: Refinement,
        photograph: usize,
        camera: &mut KnownCamera,
        warn: &mut dyn FnMut(String),
    ) -> Result<Finished> {
        let Self { config, origin, naming, .. } = *self;
        if let Some(capture) = &refinement.capture {
            match &capture.fallback {
                Some(reason) => {
                    let views = naming.of("views");
                    warn(format!("{views}: {reason}; only the reference photograph was used"));
                }
                None => camera.take_estimated(capture, photograph),
            }
        }
        if self.unit == Unit::Capture && refinement.capture.is_some() {
            refinement = refinement.in_capture_unit()?;
        }
        let scaled = self.known.is_some();
        doubts(&refinement.prior, origin, config, scaled, naming).into_iter().for_each(&mut *warn);
        if let Some(reason) = refinement.augmentation.skipped {
            let model = naming.choose("--prior-model", "a model");
            warn(format!("no test-time augmentation: {reason}; give {model} to use it"));
        }
        for (index, iteration) in refinement.iterations.iter().enumerate() {
            for warning in &iteration.fusion.warnings {
                warn(format!("iteration {}: {warning}", index + 1));
            }
        }
        let stated = self.error_bar.apply(&mut refinement, config, origin, scaled, naming)?;
        // Errors of the whole map, which sigma does not contain.
        let of_poses = refinement.capture.as_ref().and_then(|capture| capture.scale);
        let gauge = of_poses.filter(|_| self.unit == Unit::Prior && !scaled).map(|[_, relative]| relative);
        let scale = stated.scale.as_ref().map(|scale| scale.relative);
        for (name, relative) in [("gauge", gauge), ("scale", scale)] {
            let Some(relative) = relative.filter(|relative| relative.is_finite()) else { continue };
            let of = |z: &f32| if *z > 0.0 { relative as f32 * z } else { f32::INFINITY };
            let sigma = refinement.depth.mean().map(of);
            refinement.components.push(Component { name, sigma });
        }
        let mut same_scale = self.same_scale;
        if let Some(found) = same_scale.as_mut().filter(|found| !found.is_alone()) {
            // The factor is that of the plain prediction; the merged one differs by another.
            let both = refinement.prior.iter().zip(refinement.depth.mean());
            let both = both.filter(|(prior, z)| **prior > 0.0 && **z > 0.0);
            found.factor *= median(both.map(|(prior, z)| f64::from(*prior) / f64::from(*z))).unwrap_or(1.0);
            refinement = refinement.scaled(found.factor, found.log_sigma)?;
        }
        let mut scaled = None;
        if let Some(known) = self.known {
            let of_disparity = !origin.kind.is_depth();
            let at = known.at(refinement.depth.dim());
            let (refined, report) = refinement.scaled_to(&at, of_disparity).map_err(|error| {
                let argument = naming.of("scale-from");
                Error::Argument(format!("{argument} {}: {}", known.source, text(&error)))
            })?;
            refinement = refined;
            scaled = Some(Scaled { from: known.source.clone(), report });
        }
        stated.warnings.iter().cloned().for_each(&mut *warn);
        let unit = self.unit();
        let png = DepthPng::new(unit, refinement.depth.mean().iter().copied());
        Ok(Finished { refinement, unit, stated, scaled, same_scale, png })
    }
}
