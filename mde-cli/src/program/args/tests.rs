use super::*;
use crate::program::args::values::{focal, grid};

/// What everyone needs comes first, what few need last.
#[test]
fn the_help_begins_with_the_output_and_ends_with_what_is_rare() {
    for name in ["refine", "demo", "eval"] {
        let mut command = command();
        let help = command.find_subcommand_mut(name).unwrap().render_long_help().to_string();
        let at = |text: &str| help.find(text).unwrap_or_else(|| panic!("{name}: no {text}"));
        assert!(at("--output") < at("--force") && at("--output") < at("--threads"), "{name}: {help}");
        assert!(at("Advanced:") < at("--threads"), "{name}: {help}");
        let mut headings =
            help[..at("Examples:")].lines().filter(|line| !line.starts_with(' ') && line.ends_with(':'));
        assert_eq!(headings.next_back(), Some("Advanced:"), "{name}: {help}");
    }
    for (name, flags) in [
        ("refine", &["unit", "shard", "same_scale", "work_size", "seed"][..]),
        ("eval", &["grid", "withhold", "crop", "runtime"]),
    ] {
        let command = Cli::command();
        let command = command.find_subcommand(name).unwrap();
        for flag in flags {
            let argument = command.get_arguments().find(|argument| argument.get_id() == flag).unwrap();
            assert_eq!(argument.get_help_heading(), Some("Advanced"), "{name} {flag}");
        }
    }
}

#[test]
fn a_command_has_few_flags() {
    let command = Cli::command();
    let most = [("refine", 36), ("eval", 29), ("ablate", 27), ("calibrate", 24), ("warp", 21), ("poses", 20)];
    for (name, most) in most {
        let arguments = command.find_subcommand(name).unwrap().get_arguments();
        let flags: Vec<_> = arguments.filter_map(clap::Arg::get_long).collect();
        assert!(flags.len() <= most, "{name} has {}: {flags:?}", flags.len());
    }
}

#[test]
fn a_grid_is_conditions_with_values() {
    let found = grid("views=3,5; pose-noise=0,.3").unwrap();
    assert_eq!((found.views, found.pose_noises, found.gains), (vec![3, 5], vec![0.0, 0.3], vec![0.0]));
    assert_eq!(focal("520"), Ok((520.0, None)));
    assert_eq!(focal("520, 521"), Ok((520.0, Some(521.0))));
    assert!(focal("520,").is_err());
}
