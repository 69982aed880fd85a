//! Calibrations: what is accepted survives TOML and leaves sigmas that are floats.
#![no_main]

use libfuzzer_sys::fuzz_target;
use mde_cli::mde_uncertainty::calibration::Calibration;

fuzz_target!(|text: &str| {
    match Calibration::parse(text, "fuzz.toml") {
        Ok(calibration) => {
            let table = calibration.intervals().expect("it was checked");
            let factor = table.factor(Calibration::AT).expect("its own probability");
            assert!(((factor * factor) as f32).is_normal());
            for hundredth in 1..=99 {
                let width = table.half_width(f64::from(hundredth) / 100.0).expect("within the table");
                assert!(width >= 0.0 && width.is_finite());
            }
            let toml = calibration.to_toml().expect("it came from TOML");
            let again = Calibration::parse(&toml, "again").expect("its own TOML");
            assert_eq!(again.to_toml().expect("as before"), toml);
        }
        Err(error) => {
            let message = error.to_string();
            assert!(message.starts_with("fuzz.toml: ") && message.lines().count() == 1, "{message}");
        }
    }
});
