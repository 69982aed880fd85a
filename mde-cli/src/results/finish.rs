//! From a refinement to a result: its unit, its error bar, its scale by known depths, and warnings.

use super::doubts::doubts;
use super::{ErrorBar, Stated};
use crate::error::text;
use crate::inputs::{Known, KnownCamera, PriorOrigin, Scaled};
use crate::pictures16::{DepthPng, METRES};
use crate::{Component, Config, Error, Naming, Refinement, Result};
use mde_prior::DepthKind;

/// Unit of a result with several photographs.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Unit {
    /// That of the prior.
    #[default]
    Prior,
    /// That of the poses that the photographs came with.
    Capture,
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
    /// [`Error::Argument`] for known depths that give no scale, and those of [`ErrorBar::apply`] and [`Refinement::in_capture_unit`].
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
        if let Some(scale) = &stated.scale {
            let relative = scale.relative as f32;
            let map = refinement.depth.mean().mapv(|z| if z > 0.0 { relative * z } else { f32::INFINITY });
            refinement.components.push(Component { name: "scale", sigma: map });
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
        Ok(Finished { refinement, unit, stated, scaled, png })
    }
}
