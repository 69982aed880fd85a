//! Another fusion behind the same trait: `cargo run -p mde-fusion --example own_fuser`.
#![allow(clippy::print_stdout)]

use mde_fusion::ndarray::array;
use mde_fusion::{
    Aggregation, BayesFuser, Fused, Fuser, FusionReport, Gaussian, GaussianDepth, Prior, Result, aggregate,
    posterior,
};

/// No calibration and no estimate: the prior has a given standard deviation.
struct FixedSigma(f64);

impl Fuser for FixedSigma {
    fn fuse(&self, prior: &Prior, evidence: &[GaussianDepth]) -> Result<Fused> {
        let aggregated = aggregate(evidence, Aggregation::Precision, false)?;
        let mut mean = prior.mean().to_owned();
        let mut variance = mean.mapv(|_| f32::INFINITY);
        for (pixel, mean) in mean.indexed_iter_mut().filter(|(_, mean)| **mean > 0.0) {
            let belief = Gaussian::new((*mean).into(), self.0 * self.0);
            let views = aggregated.get(pixel.0, pixel.1).map(|(m, v)| Gaussian::new(m.into(), v.into()));
            let fused = views.map_or(belief, |views| posterior(belief, views));
            (*mean, variance[pixel]) = (fused.mean as f32, fused.variance as f32);
        }
        let depth = GaussianDepth::new(mean, variance)?;
        Ok(Fused { depth, aligned: aggregated.clone(), aggregated, report: FusionReport::default() })
    }
}

fn main() -> Result<()> {
    let prior = Prior::new(array![[2.0, 2.5, 3.0, 0.0]])?;
    let view = GaussianDepth::new(array![[2.2, 2.2, 0.0, 3.2]], array![[0.01, 0.01, f32::INFINITY, 0.01]])?;
    for fuser in [&FixedSigma(0.1) as &dyn Fuser, &BayesFuser::default()] {
        println!("{:.3}", fuser.fuse(&prior, std::slice::from_ref(&view))?.depth.mean());
    }
    Ok(())
}
