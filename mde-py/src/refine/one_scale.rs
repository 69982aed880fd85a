//! One scale for many photographs.

use super::inputs::{Arguments, Inputs};
use super::{Object, Watched, server};
use crate::error::{keywords, message, raise};
use crate::prior::Prior;
use crate::settings::Settings;
use crate::worker::{self, Link, lock};
use mde_cli::mde_mvs::poses::Prepared;
use mde_cli::refiner::Refiner;
use mde_cli::refiner::same_scale::{self, groups_warning};
use mde_cli::scene::SameScale;
use pyo3::prelude::*;
use rayon::prelude::*;
use std::sync::Mutex;

/// Factor, standard deviation of its logarithm, group, photographs in the group.
pub(super) type Factor = (f64, f64, usize, usize);

pub(super) fn same_scale_of((factor, log_sigma, group, photographs): Factor) -> SameScale {
    SameScale { factor, log_sigma, group, photographs }
}

/// The factors of so many photographs, which are added in their order.
#[pyclass(frozen, module = "mdenerf._mdenerf")]
pub(crate) struct OneScale(Mutex<State>);

struct State {
    scale: same_scale::OneScale,
    /// Whether any photograph could be prepared, else why not.
    any: bool,
    first_error: Option<PyErr>,
}

#[pymethods]
impl OneScale {
    #[new]
    fn new(photographs: usize, settings: &Settings) -> Self {
        let scale = same_scale::OneScale::new(photographs, &settings.0.config);
        Self(Mutex::new(State { scale, any: false, first_error: None }))
    }

    /// Adds the next photographs, nothing for those that can't be read. The result is the number of matching pairs.
    fn add<'py>(
        &self,
        py: Python<'py>,
        prior: &Prior,
        settings: &Settings,
        photographs: Vec<Option<Arguments<'py>>>,
        model: Option<Object<'py>>,
        threads: Option<usize>,
    ) -> PyResult<usize> {
        // What can't be prepared has its error when it is refined; the first is kept in case that nothing can.
        let mut errors = Vec::new();
        let mut opened = |one: Arguments<'py>| Inputs::new(one).map_err(|error| errors.push(error)).ok();
        let inputs: Vec<_> = photographs.into_iter().map(|one| one.and_then(&mut opened)).collect();
        let mut state = lock(&self.0);
        let State { scale, any, first_error } = &mut *state;
        worker::run(py, threads, server(py, model, None), |link| {
            let tried: Vec<Option<Result<Prepared, String>>> = prior.open(link, |open| {
                let refiner = Refiner::new(open, settings.0.clone()).map_err(message)?;
                let one = |one: Option<Inputs>| Some(prepared(scale, link, &refiner, one?));
                Ok::<_, String>(inputs.into_par_iter().map(one).collect())
            })?;
            let failed = tried.iter().flatten().filter_map(|one| one.as_ref().err());
            *any |= tried.iter().flatten().any(Result::is_ok);
            *first_error = first_error.take().or_else(|| errors.into_iter().chain(failed.map(raise)).next());
            let prepared: Vec<Option<Prepared>> = tried.into_iter().map(|one| one?.ok()).collect();
            let pairs: Vec<_> =
                prepared.into_iter().flat_map(|prepared| scale.matches.add(prepared)).collect();
            let ratio = |pair| (!link.is_cancelled()).then(|| scale.matches.ratio(pair)).flatten();
            let ratios: Vec<_> = pairs.par_iter().filter_map(ratio).collect();
            scale.matches.extend(ratios);
            Ok(scale.matches.count())
        })
    }

    /// The factor of each photograph, and a warning where they are of several groups.
    fn factors(&self) -> PyResult<(Vec<Factor>, Option<String>)> {
        let State { scale, any, first_error } = &mut *lock(&self.0);
        if let Some(error) = first_error.take().filter(|_| !*any) {
            return Err(error);
        }
        let factors = scale.factors().map_err(raise)?;
        let warning = groups_warning(&factors, "SameScale.group").map(|text| keywords(&text));
        let factor = |found: SameScale| (found.factor, found.log_sigma, found.group, found.photographs);
        Ok((factors.into_iter().map(factor).collect(), warning))
    }
}

fn prepared(
    scale: &same_scale::OneScale,
    link: &Link,
    refiner: &Refiner<'_>,
    inputs: Inputs,
) -> Result<Prepared, String> {
    if link.is_cancelled() {
        return Err("cancelled".to_owned());
    }
    let mut watch = Watched::new(link, false);
    let (scene, _) = inputs.scene(refiner, &mut watch).map_err(message)?;
    refiner.prepare_scale(&scene.photographs[0], scale, &mut watch).map_err(message)
}
