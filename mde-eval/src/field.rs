//! Fields of an ablation: one that the methods of a scene share, and a filter in the place of one.

use crate::{Method, Task};
use mde_nerf::{
    Error, FieldCallback, FitReport, Nerf, NerfConfig, RadianceField, RenderConfig, RenderedView, Result,
};
use mde_prior::DisparityRule;
use mde_uncertainty::GaussianDepth;
use mde_warp::{PinholeCamera, Pose, PosedView, ReprojectConfig, reproject};
use ndarray::Array3;
use std::collections::HashMap;
use std::collections::hash_map::{DefaultHasher, Entry};
use std::hash::{Hash, Hasher};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// The fitted fields of a scene, by settings, seed and views. Clones share one memory.
#[derive(Clone, Default)]
pub struct FieldMemory(Arc<Mutex<HashMap<u64, Arc<Fitted>>>>);

struct Fitted {
    nerf: Nerf,
    report: FitReport,
    /// By the settings of the render, camera and pose.
    renders: Mutex<HashMap<String, RenderedView>>,
}

/// A [`Nerf`] that is fitted only where the memory has none of the same settings, seed and views.
pub struct SharedField {
    memory: FieldMemory,
    config: NerfConfig,
    seed: u64,
    fitted: Option<Arc<Fitted>>,
}

impl SharedField {
    /// One that is not fitted yet.
    pub fn new(memory: &FieldMemory, config: NerfConfig, seed: u64) -> Self {
        Self { memory: memory.clone(), config, seed, fitted: None }
    }
}

impl RadianceField for SharedField {
    fn fit(&mut self, views: &[PosedView], callback: &mut FieldCallback<'_>) -> Result<FitReport> {
        let key = fit_key(&self.config, self.seed, views);
        let known = lock(&self.memory.0).get(&key).cloned();
        let fitted = match known {
            Some(fitted) => fitted,
            None => {
                let mut nerf = Nerf::new(self.config.clone(), self.seed)?;
                let report = nerf.fit(views, callback)?;
                let fitted = Arc::new(Fitted { nerf, report, renders: Mutex::default() });
                lock(&self.memory.0).insert(key, fitted.clone());
                fitted
            }
        };
        Ok(self.fitted.insert(fitted).report.clone())
    }

    fn render(
        &self,
        camera: &PinholeCamera,
        pose: &Pose,
        callback: &mut FieldCallback<'_>,
    ) -> Result<RenderedView> {
        let Some(fitted) = &self.fitted else { return Err(Error::NotFitted) };
        // `Debug` shows every number.
        let key = format!("{:?} {camera:?} {pose:?}", self.config.render);
        match lock(&fitted.renders).entry(key) {
            Entry::Occupied(known) => Ok(known.get().clone()),
            Entry::Vacant(place) => {
                let nerf = fitted.nerf.clone().with_render(self.config.render.clone())?;
                Ok(place.insert(nerf.render(camera, pose, callback)?).clone())
            }
        }
    }
}

fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Of everything that a fit depends on.
fn fit_key(config: &NerfConfig, seed: u64, views: &[PosedView]) -> u64 {
    let mut hasher = DefaultHasher::new();
    let config = NerfConfig { render: RenderConfig::default(), ..config.clone() };
    format!("{config:?} {seed}").hash(&mut hasher);
    for view in views {
        format!("{:?} {:?}", view.camera, view.pose).hash(&mut hasher);
        view.mask.hash(&mut hasher);
        view.image.iter().for_each(|v| v.to_bits().hash(&mut hasher));
        for depth in &view.hypotheses {
            depth.mean().iter().chain(depth.variance()).for_each(|v| v.to_bits().hash(&mut hasher));
        }
    }
    hasher.finish()
}

/// Standard deviation as a fraction of the depth, typical of the termination of rays.
const RELATIVE_SIGMA: f64 = 0.05;

/// A field without a fit: the depth of the first view after a [`Method`] (a filter, or noise), reprojected.
///
/// Its standard deviation is 5 % of the depth. In place of a NeRF, it shows what the same fusion gains with a plain filter.
pub struct FilteredField {
    filter: Box<dyn Method + Send + Sync>,
    seed: u64,
    view: Option<(PosedView, GaussianDepth)>,
}

impl FilteredField {
    /// One that has seen no view yet; `seed` is that of the method's draws.
    pub fn new(filter: Box<dyn Method + Send + Sync>, seed: u64) -> Self {
        Self { filter, seed, view: None }
    }
}

fn fault(error: &dyn std::fmt::Display) -> Error {
    Error::View { index: 0, reason: error.to_string() }
}

impl RadianceField for FilteredField {
    fn fit(&mut self, views: &[PosedView], _: &mut FieldCallback<'_>) -> Result<FitReport> {
        let view = views.first().ok_or(Error::NoPixels)?;
        let depth = view.hypotheses.first().ok_or(Error::NoRange)?;
        let rule = DisparityRule::default();
        let task =
            Task { seed: self.seed, ..Task::new(view.image.view(), &view.camera, depth.mean(), &rule) };
        let refined = self.filter.refine(&task).map_err(|e| fault(&e))?.depth;
        let variance = refined
            .mapv(|d| if d > 0.0 { (RELATIVE_SIGMA * f64::from(d)).powi(2) as f32 } else { f32::INFINITY });
        let depth = GaussianDepth::new(refined, variance).map_err(|e| fault(&e))?;
        self.view = Some((view.clone(), depth));
        Ok(FitReport::default())
    }

    fn render(&self, camera: &PinholeCamera, pose: &Pose, _: &mut FieldCallback<'_>) -> Result<RenderedView> {
        let (view, depth) = self.view.as_ref().ok_or(Error::NotFitted)?;
        let depth = reproject(depth, &view.camera, &view.pose, camera, pose, &ReprojectConfig::default())
            .map_err(|e| fault(&e))?;
        let opacity = depth.support().mapv(|known| f32::from(u8::from(known)));
        let image = Array3::zeros((camera.height, camera.width, 3));
        Ok(RenderedView { image, depth, opacity, in_bin: None })
    }
}
