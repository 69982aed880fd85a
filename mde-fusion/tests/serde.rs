//! The configuration in a file.
#![allow(clippy::unwrap_used)]
#![cfg(feature = "serde")]

use mde_fusion::{Calibration, FusionConfig, PriorVariance};
use serde::Deserialize;
use serde::de::value::{Error, MapDeserializer};

fn read(pairs: &[(&'static str, &'static str)]) -> Result<FusionConfig, Error> {
    FusionConfig::deserialize(MapDeserializer::new(pairs.iter().copied()))
}

#[test]
fn missing_keys_have_the_values_of_the_paper() {
    assert_eq!(read(&[]).unwrap(), FusionConfig::paper());
    let config = read(&[("calibration", "none"), ("prior-variance", "fixed-median")]).unwrap();
    assert_eq!(config.calibration, Calibration::None);
    assert_eq!(config.prior_variance, PriorVariance::FixedMedian);
    assert_eq!(config.aggregation, FusionConfig::paper().aggregation);
}

#[test]
fn unknown_keys_and_values_are_named() {
    let error = read(&[("calibratoin", "wls")]).unwrap_err().to_string();
    assert!(error.contains("calibratoin"), "{error}");
    let error = read(&[("aggregation", "max-depth")]).unwrap_err().to_string();
    assert!(error.contains("max-depth") && error.contains("min-depth"), "{error}");
}
