use super::{check, known, weights};
use crate::metrics::sharpness::sharpness;
use crate::raster::{blur_known, four_sigma, same_shape};
use crate::{Method, Refined, Result, Task, error};
use ndarray::{Array2, ArrayView2, Zip};

/// Unsharp mask in log depth: \\(\ln d + a (\ln d - G_\sigma * \ln d)\\).
///
/// The Gaussian ignores what is missing or outside. Scale of the depth does not matter. It adds no information to the prior
/// and raises every metric that rewards gradient.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Unsharp {
    /// \\(a\\): how much of the detail is added; negative amounts blur.
    pub amount: f64,
}

/// \\(\sigma\\), pixels.
const SIGMA: f64 = 8.0;

impl Unsharp {
    /// The mask that makes `prior` as sharp ([mean gradient over median depth](sharpness)) as `other` is, both
    /// `[height, width]`: the control of a method that claims sharper depth. The truth is not used.
    ///
    /// The amount lies in -1 to 50; the nearer end where even that is not enough.
    ///
    /// # Errors
    /// [`Error::Shape`](crate::Error::Shape) where the maps differ, [`Error::Empty`](crate::Error::Empty) where they have no depth in common.
    pub fn matching(prior: ArrayView2<'_, f32>, other: ArrayView2<'_, f32>) -> Result<Self> {
        same_shape("the other map", other.dim(), prior.dim())?;
        let both = Zip::from(prior).and(other).map_collect(|&p, &q| known(p) && known(q));
        let target = sharpness(other, both.view())?;
        let detail = detail(prior);
        let (mut low, mut high) = (-1.0, 50.0);
        for _ in 0..24 {
            let amount = 0.5 * (low + high);
            let sharpness = sharpness(sharpened(prior, &detail, amount).view(), both.view())?;
            *if sharpness < target { &mut low } else { &mut high } = amount;
        }
        Ok(Self { amount: 0.5 * (low + high) })
    }
}

/// \\(\ln d - G_\sigma * \ln d\\), 0 where missing.
fn detail(prior: ArrayView2<'_, f32>) -> Array2<f64> {
    let logs = prior.mapv(|d| if known(d) { f64::from(d).ln() } else { 0.0 });
    let weights = weights(prior);
    (&logs - blur_known(&logs, &weights, four_sigma(SIGMA))) * weights
}

fn sharpened(prior: ArrayView2<'_, f32>, detail: &Array2<f64>, amount: f64) -> Array2<f32> {
    Zip::from(prior).and(detail).map_collect(|&d, &detail| {
        // A factor beyond any depth, and never out of f32: what is known stays so.
        let value = f64::from(d) * (amount * detail).clamp(-20.0, 20.0).exp();
        if known(d) { value.clamp(f32::MIN_POSITIVE.into(), f32::MAX.into()) as f32 } else { 0.0 }
    })
}

impl Method for Unsharp {
    fn refine(&self, task: &Task<'_>) -> Result<Refined> {
        check(task)?;
        error::check([("amount", self.amount, self.amount.is_finite(), "use a finite number")])?;
        Ok(sharpened(task.prior, &detail(task.prior), self.amount).into())
    }
}
