//! Another fusion behind the same trait: `cargo run -p mde-fusion --example own_fuser`.
#![allow(clippy::print_stdout)]

use mde_fusion::ndarray::array;
use mde_fusion::{
    Aggregation, BayesFuser, Error, Fused, Fuser, FusionReport, Gaussian, GaussianDepth, Prior, Result,
    aggregate, posterior,
};

/// No calibration and no estimate: the prior has this standard deviation, in its unit.
struct FixedSigma(f64);

impl Fuser for FixedSigma {
    fn fuse(&self, prior: &Prior, views: &[GaussianDepth]) -> Result<Fused> {
        let (height, width) = prior.dim();
        if let Some((view, map)) = views.iter().enumerate().find(|(_, map)| map.dim() != (height, width)) {
            return Err(Error::Shape { view, expected: [height, width], found: map.dim().into() });
        }
        // Without views the aggregate has no size of its own.
        let aggregated = match views {
            [] => GaussianDepth::missing(height, width),
            views => aggregate(views, Aggregation::Precision)?,
        };
        let mut mean = prior.mean().to_owned();
        let mut variance = mean.mapv(|_| f32::INFINITY);
        for (pixel, mean) in mean.indexed_iter_mut().filter(|(_, mean)| **mean > 0.0) {
            let own = Gaussian::new((*mean).into(), self.0 * self.0);
            let view = aggregated.get(pixel.0, pixel.1).map(|(m, v)| Gaussian::new(m.into(), v.into()));
            let fused = view.map_or(own, |view| posterior(own, view));
            if fused.mean <= 0.0 {
                // An error of this implementation's own.
                let fault = format!("depth {} at {pixel:?} is not positive", fused.mean);
                return Err(Error::External(fault.into()));
            }
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
        // Every map has the prior's size, also without views.
        let alone = fuser.fuse(&prior, &[])?;
        assert_eq!((alone.aggregated.dim(), alone.aligned.dim()), (prior.dim(), prior.dim()));
        assert_eq!(alone.depth.mean(), prior.mean());
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    #[test]
    fn it_runs() -> mde_fusion::Result<()> {
        super::main()
    }
}
