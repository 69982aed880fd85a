//! The loop's configuration: what is accepted survives TOML.
#![no_main]

use libfuzzer_sys::fuzz_target;
use mde_cli::config::Preset;

fuzz_target!(|text: &str| {
    for preset in Preset::ALL {
        match preset.config().with_text(text, "fuzz.toml") {
            Ok(config) => {
                config.validate().expect("it was validated");
                let again = config.to_toml().expect("its seed came from TOML");
                assert_eq!(preset.config().with_text(&again, "again").expect("its own TOML"), config);
            }
            Err(error) => {
                let message = error.to_string();
                assert!(message.starts_with("fuzz.toml: ") && message.lines().count() == 1, "{message}");
            }
        }
    }
});
