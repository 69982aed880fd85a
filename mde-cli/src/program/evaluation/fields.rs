//! Fields that the methods of a scene share.

use mde_nerf::{FieldCallback, FitReport, Nerf, NerfConfig, RadianceField, RenderConfig, RenderedView};
use mde_warp::{PinholeCamera, Pose, PosedView};
use std::collections::HashMap;
use std::collections::hash_map::{DefaultHasher, Entry};
use std::hash::{Hash, Hasher};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// Fitted fields and their renderings, by settings, seed and views. Clones share one memory.
#[derive(Clone, Default)]
pub(crate) struct FieldMemory(Arc<Mutex<HashMap<u64, Arc<Fitted>>>>);

struct Fitted {
    nerf: Nerf,
    report: FitReport,
    /// By camera, pose and the settings of the render.
    renders: Mutex<HashMap<u64, RenderedView>>,
}

impl FieldMemory {
    /// A field that is fitted only where the memory has none of the same settings, seed and views.
    pub(crate) fn field(&self, config: NerfConfig, seed: u64) -> Remembered {
        Remembered { memory: self.clone(), config, seed, fitted: None }
    }
}

/// A [`Nerf`] that shares a [`FieldMemory`].
pub(crate) struct Remembered {
    memory: FieldMemory,
    config: NerfConfig,
    seed: u64,
    fitted: Option<Arc<Fitted>>,
}

impl RadianceField for Remembered {
    fn fit(&mut self, views: &[PosedView], callback: &mut dyn FieldCallback) -> mde_nerf::Result<FitReport> {
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
        let report = fitted.report.clone();
        self.fitted = Some(fitted);
        Ok(report)
    }

    fn render(
        &self,
        camera: &PinholeCamera,
        pose: &Pose,
        callback: &mut dyn FieldCallback,
    ) -> mde_nerf::Result<RenderedView> {
        let Some(fitted) = &self.fitted else { return Err(mde_nerf::Error::NotFitted) };
        match lock(&fitted.renders).entry(view_key(camera, pose, &self.config)) {
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

fn fit_key(config: &NerfConfig, seed: u64, views: &[PosedView]) -> u64 {
    let mut hasher = DefaultHasher::new();
    // The fit does not depend on the render settings. `Debug` shows every number of a configuration.
    let fit = NerfConfig { render: RenderConfig::default(), ..config.clone() };
    format!("{fit:?}").hash(&mut hasher);
    seed.hash(&mut hasher);
    for view in views {
        hash_view(&view.camera, &view.pose, &mut hasher);
        view.image.iter().for_each(|v| v.to_bits().hash(&mut hasher));
        view.mask.iter().for_each(|v| v.hash(&mut hasher));
        for depth in &view.hypotheses {
            depth.mean().iter().chain(depth.variance()).for_each(|v| v.to_bits().hash(&mut hasher));
        }
    }
    hasher.finish()
}

fn view_key(camera: &PinholeCamera, pose: &Pose, config: &NerfConfig) -> u64 {
    let mut hasher = DefaultHasher::new();
    format!("{:?}", config.render).hash(&mut hasher);
    hash_view(camera, pose, &mut hasher);
    hasher.finish()
}

fn hash_view(camera: &PinholeCamera, pose: &Pose, hasher: &mut DefaultHasher) {
    [camera.fx, camera.fy, camera.cx, camera.cy].map(f64::to_bits).hash(hasher);
    [camera.width, camera.height].hash(hasher);
    pose.to_homogeneous().iter().for_each(|v| v.to_bits().hash(hasher));
}
