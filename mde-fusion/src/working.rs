use crate::gaussian::to_f32;
use crate::{Gaussian, Prior, Space, to_depth, to_disparity};
use mde_uncertainty::GaussianDepth;
use mde_uncertainty::statistics::median;
use ndarray::{Array2, Zip};

/// The prior in the space that the equations are evaluated in.
#[derive(Debug)]
pub(crate) struct WorkingPrior {
    space: Space,
    /// \\(D_o\\) in that space, `[height, width]`; 0 where missing.
    pub(crate) mean: Array2<f64>,
    /// Its variance there, if the prior came with one.
    pub(crate) variance: Option<Array2<f64>>,
}

impl WorkingPrior {
    pub(crate) fn new(prior: &Prior, space: Space) -> Self {
        let mut mean = prior.mean().mapv(f64::from);
        let mut variance = prior.variance().map(|v| v.mapv(f64::from));
        if space == Space::Disparity {
            match &mut variance {
                None => mean.mapv_inplace(|d| if d > 0.0 { d.recip() } else { 0.0 }),
                Some(variance) => Zip::from(&mut mean).and(variance).for_each(|m, v| {
                    let g = if *m > 0.0 { to_disparity(Gaussian::new(*m, *v)) } else { None };
                    (*m, *v) = g.map_or((0.0, f64::INFINITY), |g| (g.mean, g.variance));
                }),
            }
        }
        Self { space, mean, variance }
    }

    /// Median over the known pixels.
    pub(crate) fn median(&self) -> Option<f64> {
        median(self.mean.iter().filter(|&&m| m > 0.0).map(|&m| to_f32(m)))
    }

    /// The belief at a pixel of depth `depth` and working mean `mean`, given the variance there.
    ///
    /// A prior without variance was inverted without the mean correction, as that needs the variance; now it is
    /// known.
    pub(crate) fn belief(&self, depth: f64, mean: f64, variance: f64) -> Gaussian {
        let plain = Gaussian::new(mean, variance);
        match (self.space, &self.variance) {
            (Space::Disparity, None) => {
                to_disparity(Gaussian::new(depth, variance * depth.powi(4))).unwrap_or(plain)
            }
            _ => plain,
        }
    }
}

/// Views in the working space; what has no disparity becomes missing.
pub(crate) fn working_views(views: &[GaussianDepth], space: Space) -> Vec<GaussianDepth> {
    match space {
        Space::Depth => views.to_vec(),
        Space::Disparity => views.iter().map(|view| through(view, to_disparity)).collect(),
    }
}

/// A map from the working space back to depth.
pub(crate) fn depth_map(map: &GaussianDepth, space: Space) -> GaussianDepth {
    match space {
        Space::Depth => map.clone(),
        Space::Disparity => through(map, to_depth),
    }
}

/// A belief back to depth; `None` where that is not a positive, finite number.
pub(crate) fn depth_belief(belief: Gaussian, space: Space) -> Option<Gaussian> {
    let depth = match space {
        Space::Depth => belief,
        Space::Disparity => to_depth(belief)?,
    };
    (to_f32(depth.mean) > 0.0 && depth.variance.is_finite()).then_some(depth)
}

/// The depth-space variance of a prior left alone: `variance` is in the working space.
pub(crate) fn prior_depth_variance(depth: f64, variance: f64, space: Space) -> f64 {
    match space {
        Space::Depth => variance,
        Space::Disparity => variance * depth.powi(4),
    }
}

fn through(map: &GaussianDepth, f: impl Fn(Gaussian) -> Option<Gaussian>) -> GaussianDepth {
    map.clone().map(|m, v| match f(Gaussian::new(f64::from(m), f64::from(v))) {
        Some(g) => (g.mean as f32, g.variance as f32),
        None => (0.0, f32::INFINITY),
    })
}
