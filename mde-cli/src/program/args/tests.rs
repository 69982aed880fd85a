use super::*;

#[test]
fn the_command_line_is_consistent() {
    Cli::command().debug_assert();
}

#[test]
fn an_output_without_a_name_is_called_after_its_input() {
    let name = |arguments: &str, input: &str| {
        let cli = Cli::try_parse_from(arguments.split_whitespace()).unwrap();
        let Command::Refine(refine) = cli.command else { panic!() };
        refine.run.output(Path::new(input), "-depth")
    };
    let refine = "mde refine a/room.v2.jpg --prior-depth d.npy";
    assert_eq!(name(refine, "a/room.v2.jpg"), Path::new("room.v2-depth"));
    assert_eq!(name(&format!("{refine} -o out/x"), "a/room.v2.jpg"), Path::new("out/x"));
}

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
    let rare: [(&str, &[&str]); 2] = [
        ("refine", &["unit", "shard", "same_scale"]),
        (
            "eval",
            &[
                "filled_depth",
                "photographs",
                "baseline",
                "pose_noise",
                "gain",
                "without_poses",
                "without_intrinsics",
                "eigen_crop",
                "gt_encoding",
                "methods",
            ],
        ),
    ];
    for (name, flags) in rare {
        let command = Cli::command();
        let command = command.find_subcommand(name).unwrap();
        for flag in flags {
            let argument = command.get_arguments().find(|argument| argument.get_id() == flag).unwrap();
            let usual = ["same_scale", "methods"].contains(flag);
            assert_eq!(argument.get_help_heading() == Some("Advanced"), !usual, "{name} {flag}");
        }
    }
}

/// Where the results go by default is told for each command as it is.
#[test]
fn the_help_names_the_folder_of_each_command() {
    for (name, folder) in [
        ("refine", "room-depth"),
        ("warp", "room-views"),
        ("render", "field-render"),
        ("demo", "mde-demo"),
        ("eval", "SUNRGBD-eval"),
        ("calibrate", "SUNRGBD-eval"),
        ("ablate", "SUNRGBD-ablate"),
        ("poses", "transforms.json"),
    ] {
        let command = Cli::command();
        let command = command.find_subcommand(name).unwrap();
        let output = command.get_arguments().find(|argument| argument.get_id() == "output").unwrap();
        let help = output.get_help().unwrap().to_string();
        assert!(
            help.contains(folder) && (name == "refine" || !help.contains("room-depth")),
            "{name}: {help}"
        );
    }
}

#[test]
fn sizes_and_triples() {
    assert_eq!(size("320x240"), Ok([320, 240]));
    assert!(["320", "0x9", "axb", "99999x99"].iter().all(|text| size(text).is_err()));
    assert_eq!(triple("-1, 0,2.5"), Ok([-1.0, 0.0, 2.5]));
    assert!(["1,2", "1,2,inf", "a,b,c"].iter().all(|text| triple(text).is_err()));
}
