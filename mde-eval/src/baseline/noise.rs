use super::{check, known};
use crate::{Refined, Result, Task};
use mde_uncertainty::random::CounterRng;
use rand_distr::{Distribution, StandardNormal};

/// \\(s\\).
const RELATIVE: f64 = 0.01;

/// Multiplies each depth by \\(1 + s\\,n\\), \\(n\\) standard normal and independent: a control that makes every depth worse and the
/// sharpness better.
pub fn white_noise(task: &Task<'_>) -> Result<Refined> {
    check(task)?;
    let mut depth = task.prior.to_owned();
    for (index, d) in depth.iter_mut().enumerate() {
        let normal: f64 =
            StandardNormal.sample(&mut CounterRng::new(task.seed, "white-noise", 0, index as u64));
        // Never through the camera, however far out the draw.
        let gain = (1.0 + RELATIVE * normal).max(1e-3);
        *d = if known(*d) { (f64::from(*d) * gain) as f32 } else { 0.0 };
    }
    Ok(depth.into())
}
