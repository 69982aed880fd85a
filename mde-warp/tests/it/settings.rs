//! Settings and cameras as text.

use mde_warp::{PinholeCamera, ReprojectConfig, ViewSampling, WarpConfig};
use serde::{Serialize, de::DeserializeOwned};
use std::fmt::Debug;

fn survives<T: Serialize + DeserializeOwned + PartialEq + Debug>(value: &T) {
    let text = toml::to_string(value).unwrap();
    assert_eq!(&toml::from_str::<T>(&text).unwrap(), value, "{text}");
}

#[test]
fn all_survive_toml() {
    survives(&PinholeCamera::from_fov(60.0, 640, 480).unwrap());
    survives(&ViewSampling { count: 3, translation: 0.01, ..ViewSampling::default() });
    survives(&WarpConfig { tear: 0.1 });
    survives(&ReprojectConfig { front: 0.02, ..ReprojectConfig::default() });
}

#[test]
fn what_is_left_out_has_its_default_and_what_is_unknown_is_refused() {
    let sampling: ViewSampling = toml::from_str("rotation-degrees = 2.0").unwrap();
    assert_eq!(sampling, ViewSampling { rotation_degrees: 2.0, ..ViewSampling::default() });
    let error = toml::from_str::<WarpConfig>("taer = 0.1").unwrap_err();
    assert!(error.to_string().contains("taer"), "{error}");
    let camera = toml::from_str::<PinholeCamera>("fx = 1.0");
    assert!(camera.is_err());
}

#[test]
fn the_defaults_are_valid() {
    ViewSampling::default().validate().unwrap();
    WarpConfig::default().validate().unwrap();
    ReprojectConfig::default().validate().unwrap();
}
