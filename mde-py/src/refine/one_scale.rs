//! One scale for many photographs.

use super::inputs::{Arguments, Inputs};
use super::{Object, Watched, server};
use crate::error::{message, raise};
use crate::prior::Prior;
use crate::settings::Settings;
use crate::worker::{self, Link};
use mde_cli::Naming;
use mde_cli::mde_mvs::poses::Prepared;
use mde_cli::results::{self, SameScale};
use pyo3::prelude::*;
use rayon::prelude::*;
use std::sync::{Mutex, PoisonError};

/// Factor, standard deviation of its logarithm, group, photographs in the group.
pub(super) type Factor = (f64, f64, usize, usize);

pub(super) fn same_scale((factor, log_sigma, group, photographs): Factor) -> SameScale {
    SameScale { factor, log_sigma, group, photographs }
}

/// The factors of so many photographs, which are added in their order.
#[pyclass(frozen, module = "mdenerf._mdenerf")]
pub(crate) struct OneScale(Mutex<results::OneScale>);

#[pymethods]
impl OneScale {
    #[new]
    #[pyo3(signature = (photographs, settings))]
    fn new(photographs: usize, settings: &Settings) -> Self {
        Self(Mutex::new(results::OneScale::new(photographs, &settings.config)))
    }

    /// Adds the next photographs, nothing for those that can't be read. The result is the number of matching pairs.
    #[pyo3(signature = (prior, settings, photographs, model, threads))]
    fn add<'py>(
        &self,
        py: Python<'py>,
        prior: &Prior,
        settings: &Settings,
        photographs: Vec<Option<Arguments<'py>>>,
        model: Option<Object<'py>>,
        threads: Option<usize>,
    ) -> PyResult<usize> {
        // What can't be prepared has its error when it is refined.
        let inputs: Vec<_> =
            photographs.into_iter().map(|one| one.and_then(|one| Inputs::new(one).ok())).collect();
        worker::run(py, threads, server(py, model, None), |link| {
            let mut scale = self.0.lock().unwrap_or_else(PoisonError::into_inner);
            let prepared: Vec<Option<Prepared>> = inputs
                .par_iter()
                .map(|one| prepared(&scale, link, prior, settings, one.as_ref()?).ok())
                .collect();
            let pairs: Vec<_> = prepared.into_iter().flat_map(|prepared| scale.add(prepared)).collect();
            let ratio = |pair| (!link.is_cancelled()).then(|| scale.ratio(pair)).flatten();
            let ratios: Vec<_> = pairs.par_iter().filter_map(ratio).collect();
            scale.extend(ratios);
            Ok(scale.matches())
        })
    }

    /// The factor of each photograph, and a warning where they are of several groups.
    fn factors(&self) -> PyResult<(Vec<Factor>, Option<String>)> {
        let scale = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        let factors = scale.factors().map_err(raise)?;
        let warning = SameScale::groups_warning(&factors, Naming::Keywords, "SameScale.group");
        let factor = |found: SameScale| (found.factor, found.log_sigma, found.group, found.photographs);
        Ok((factors.into_iter().map(factor).collect(), warning))
    }
}

fn prepared(
    scale: &results::OneScale,
    link: &Link,
    prior: &Prior,
    settings: &Settings,
    inputs: &Inputs,
) -> Result<Prepared, String> {
    if link.is_cancelled() {
        return Err("cancelled".to_owned());
    }
    let linked = prior.linked(link);
    let (placed, bound, _) =
        inputs.open(settings, &linked, &mut Watched::new(link, false)).map_err(message)?;
    let first = &placed[0].opened;
    scale.prepare(&first.image, &first.camera, &bound).map_err(message)
}
