use super::{channels, check, known};
use crate::{Refined, Result, Task};

/// \\(\sigma_s\\), pixels.
const SIGMA_SPACE: f64 = 8.0;
/// \\(\sigma_r\\), in colour (0 to 1).
const SIGMA_COLOUR: f64 = 0.1;

/// Joint bilateral filter (Petschnigg et al., 2004): the mean of depth weighted by nearness in place and in colour,
///
/// \\[ w(x, y) = \exp\left(-\frac{\\|x - y\\|^2}{2\sigma_s^2} - \frac{\\|I_x - I_y\\|^2}{2\sigma_r^2}\right), \\]
///
/// over a square of two \\(\sigma_s\\) to each side.
pub fn joint_bilateral(task: &Task<'_>) -> Result<Refined> {
    check(task)?;
    let depth = task.prior.mapv(|d| if known(d) { d } else { 0.0 });
    let support = depth.mapv(|d| if d > 0.0 { 1.0 } else { 0.0 });
    let guide = channels(task.image);
    let filter = mde_uncertainty::filter::JointBilateral::dense(SIGMA_SPACE, SIGMA_COLOUR);
    let filtered = filter.filter(depth.view(), Some(support.view()), &guide)?;
    Ok((filtered * support).into())
}
