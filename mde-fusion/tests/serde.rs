//! The configuration as a file sees it.
#![allow(clippy::unwrap_used)]
#![cfg(feature = "serde")]

use mde_fusion::{Calibration, FusionConfig, PriorVariance};
use serde::Deserialize;
use serde::de::value::{Error, MapDeserializer};

fn read(pairs: &[(&'static str, &'static str)]) -> Result<FusionConfig, Error> {
    FusionConfig::deserialize(MapDeserializer::new(pairs.iter().copied()))
}

#[test]
fn what_is_left_out_is_the_papers() {
    assert_eq!(read(&[]).unwrap(), FusionConfig::paper());
    let config = read(&[("calibration", "effective"), ("prior-variance", "paule-mandel")]).unwrap();
    assert_eq!(config.calibration, Calibration::Effective);
    assert_eq!(config.prior_variance, PriorVariance::PauleMandel);
    assert!(!config.spread);
}

#[test]
fn what_is_unknown_is_refused_by_name() {
    let error = read(&[("calibratoin", "wls")]).unwrap_err().to_string();
    assert!(error.contains("calibratoin"), "{error}");
    let error = read(&[("aggregation", "max-depth")]).unwrap_err().to_string();
    assert!(error.contains("max-depth") && error.contains("min-depth"), "{error}");
}
