//! What a pipe gets and what a terminal gets.

use crate::common::{Place, REFINE};

#[test]
fn a_pipe_gets_no_escape_codes_and_the_end_says_what_was_gained() {
    let said = "depth: typical change ; sigma: median ; fusion: a ; weight of the field ; wrote out ; open out/report.html ; !\x1b";
    Place::new().prints(&format!("{REFINE} -o out"), 0, said);
}

/// What a terminal of 80 columns gets.
#[cfg(target_os = "linux")]
fn on_a_terminal(place: &Place, arguments: &str, no_color: Option<&str>) -> String {
    let mde = env!("CARGO_BIN_EXE_mde");
    let mut command = std::process::Command::new("script");
    command.args(["-qec", &format!("stty cols 80 rows 24; {mde} {arguments}"), "/dev/null"]);
    command.current_dir(place.path(".")).stdin(std::process::Stdio::null());
    command.env("TERM", "xterm").env_remove("CLICOLOR").env_remove("NO_COLOR");
    no_color.map(|value| command.env("NO_COLOR", value));
    let output = command.output().expect("the program script of util-linux makes a terminal; install it");
    String::from_utf8(output.stdout).unwrap()
}

#[test]
#[cfg(target_os = "linux")]
fn a_terminal_gets_a_coloured_bar_for_each_stage_and_warnings_at_the_end() {
    let place = Place::new();
    let run = REFINE.replace(" --fov 60", "");
    let text = on_a_terminal(&place, &format!("{run} -o a"), None);
    assert!(text.contains("\x1b[36m"), "no colour: {text}");
    for stage in ["prior [", "1/2: warp [", "1/2: fit ", "2/2: render ", "2/2: fuse ["] {
        assert!(text.contains(stage), "no {stage}: {text}");
    }
    let plain = on_a_terminal(&place, &format!("{run} -o b"), Some("1"));
    assert!(!plain.contains("\x1b[3") && plain.contains("1/2: fit "), "{plain}");
    // Once, between the last stage and the results.
    let at = |part: &str| plain.rfind(part).unwrap_or_else(|| panic!("no {part}: {plain}"));
    assert_eq!(plain.matches("the camera is unknown").count(), 1, "{plain}");
    assert!(at("2/2: fuse") < at("warning: the camera is unknown") && at("warning:") < at("depth: typical"));
    // What has no control sequences is no bar, and fits.
    let lines: Vec<&str> = plain.lines().filter(|line| !line.contains('\x1b')).collect();
    assert!(lines.len() > 5 && lines.iter().all(|line| line.trim_end().chars().count() <= 80), "{plain}");

    // An error is printed without the warnings of its run.
    let failing = format!("{run} --gt nowhere.npy -o out");
    place.refused(&failing, "error: nowhere.npy ; !warning");
    let text = on_a_terminal(&place, &failing, None);
    assert!(text.contains("\x1b[31m") && text.contains("error:") && !text.contains("warning"), "{text}");
}

/// The lines that stay on a terminal of 80 columns: of a bar that is drawn again, the last state, which fills its line.
#[cfg(target_os = "linux")]
fn lines(text: &str) -> Vec<String> {
    let last = |line: &str| {
        let line = line.trim_end_matches('\r');
        let shown: Vec<char> =
            console::strip_ansi_codes(&line[line.rfind('\r').map_or(0, |at| at + 1)..]).chars().collect();
        let rows: Vec<String> = shown.chunks(80).map(|row| row.iter().collect()).collect();
        if rows.is_empty() { vec![String::new()] } else { rows }
    };
    text.trim_end().split('\n').flat_map(last).collect()
}

#[test]
#[cfg(target_os = "linux")]
fn an_evaluation_on_a_terminal_ends_with_its_verdict_and_one_line() {
    let place = Place::new();
    let eval = |methods: &str, out: &str| {
        let arguments = format!("eval --dataset rooms --size 64x48 --limit 6 --methods {methods} -o {out}");
        lines(&on_a_terminal(&place, &arguments, None))
    };
    let one = eval("guided", "one");
    assert!(one.len() <= 10, "{one:#?}");
    assert!(one[0].contains("12/12") && one[1].starts_with("- guided: AbsRel "), "{one:#?}");
    let end = "6 scenes; report: one/report.html; tables: one/table.md";
    assert!(one.last().unwrap().ends_with(end), "{one:#?}");
    // The simulated prior accepts no crops: that method fails in each scene.
    let more = eval("guided,noise,unsharp1,zoom", "more");
    assert!(more.len() <= 24 && more[1].starts_with("- "), "{more:#?}");
    let failures = more.iter().filter(|line| line.contains("failed")).collect::<Vec<_>>();
    assert!(failures.len() == 2 && failures[0].starts_with("- failed: zoom on 6 scenes: "), "{more:#?}");
    assert!(failures[1].starts_with("error: 6 of the runs failed"), "{more:#?}");
}
