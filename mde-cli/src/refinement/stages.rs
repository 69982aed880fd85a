//! The implementations that the loop composes.

use crate::config::Config;
use crate::error::Result;
use mde_fusion::Fuser;
use mde_nerf::{Nerf, NerfConfig, RadianceField};
use mde_prior::DepthPrior;
use mde_uncertainty::random::derived_seed;

/// Arguments of a field factory.
#[derive(Debug, Clone, Copy)]
#[non_exhaustive]
pub struct FieldRequest<'c> {
    /// Iteration of the loop, from 0.
    pub iteration: usize,
    /// Seed of the field's random draws: [`Config::seed`] in the first iteration, derived from it in later ones.
    pub seed: u64,
    /// The settings of the field, [`Config::nerf`].
    pub config: &'c NerfConfig,
}

impl FieldRequest<'_> {
    /// The field of the settings, not fitted.
    ///
    /// # Errors
    /// [`Error::Field`](crate::error::Error::Field) for a setting out of range.
    pub fn nerf(&self) -> Result<Nerf> {
        Ok(Nerf::new(self.config.clone(), self.seed)?)
    }
}

/// Makes the field of an iteration. An error of its own is an [`Error::External`](crate::error::Error::External).
pub type FieldFactory<'f> = dyn FnMut(FieldRequest<'_>) -> Result<Box<dyn RadianceField>> + 'f;

/// The stages of a run: a prior, and the field and the fusion that the [`Config`] describes unless others are given.
pub struct Stages<'s> {
    pub(crate) prior: &'s dyn DepthPrior,
    field: Option<Box<FieldFactory<'s>>>,
    pub(crate) fuser: Option<&'s dyn Fuser>,
    pub(crate) at_once: Option<usize>,
    /// Factor on the prior of each of several photographs; 1 where there is none.
    pub(crate) factors: Vec<f32>,
    /// Whether the prior gives one photograph alone a depth.
    pub(crate) serves_one: bool,
}

impl<'s> Stages<'s> {
    /// The depth of `prior`, a [`Nerf`] with [`Config::nerf`], and a [`BayesFuser`](mde_fusion::BayesFuser) with [`Config::fusion`].
    pub fn new(prior: &'s dyn DepthPrior) -> Self {
        Self { prior, field: None, fuser: None, at_once: None, factors: Vec::new(), serves_one: true }
    }

    /// Another field; `factory` is called once per iteration. [`Config::nerf`] is passed to it and not used otherwise.
    #[must_use]
    pub fn with_field(
        mut self,
        factory: impl FnMut(FieldRequest<'_>) -> Result<Box<dyn RadianceField>> + 's,
    ) -> Self {
        self.field = Some(Box::new(factory));
        self
    }

    /// Another fusion, also of the prior with the field of several photographs. Of [`Config::fusion`] only `common-error` is then used, where no field is fitted.
    #[must_use]
    pub fn with_fuser(mut self, fuser: &'s dyn Fuser) -> Self {
        self.fuser = Some(fuser);
        self
    }

    /// At most that many of the prior's predictions at once, 1 or more; see
    /// [`PhotographMemory`](crate::refiner::plan::inference::PhotographMemory). The result does not depend on it.
    #[must_use]
    pub fn with_predictions_at_once(mut self, most: usize) -> Self {
        self.at_once = Some(most);
        self
    }

    pub(crate) fn field(&mut self, config: &Config, iteration: usize) -> Result<Box<dyn RadianceField>> {
        let later = derived_seed(config.seed, "field", iteration as u64);
        let seed = if iteration == 0 { config.seed } else { later };
        let request = FieldRequest { iteration, seed, config: &config.nerf };
        match &mut self.field {
            Some(factory) => factory(request),
            None => Ok(Box::new(request.nerf()?)),
        }
    }
}
