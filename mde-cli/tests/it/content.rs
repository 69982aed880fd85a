//! Kept results belong to the content of the inputs, not to their names, and are checked before they are used again.

use crate::common::{HEIGHT, Place, WIDTH, fixture, names, tiny, wait_until};
use mde_cli::mde_prior::format::write_npy;
use mde_eval::data::{DataSet, Rooms};
use std::fs;

const EVAL: &str = "eval --dataset rooms --size 64x48 --limit 1";

fn anew(place: &Place, arguments: &str) -> bool {
    place.run(arguments).contains("computed again")
}

#[test]
fn a_prior_is_known_by_its_content_and_not_by_its_folder() {
    let place = Place::new();
    let sample = Rooms::new(0, WIDTH, HEIGHT).load(0).unwrap();
    let (id, truth) = (sample.id, sample.depth);
    let wrong = ndarray::Array2::from_shape_fn((HEIGHT, WIDTH), |(y, x)| 1.0 + (x * y) as f32 * 1e-3);
    fs::create_dir(place.path("pr")).unwrap();
    write_npy(place.path(&format!("pr/{id}.npy")), wrong.view()).unwrap();
    let eval = |rest: &str| format!("{EVAL} --methods prior --prior-depth {rest}");
    let score = |out: &str| -> f64 {
        let text = place.text(&format!("{out}/scenes.csv"));
        let mut rows = text.lines().map(|line| line.split(','));
        let column = rows.next().unwrap().position(|name| name == "abs_rel").unwrap();
        let value: f64 = rows.next().unwrap().nth(column).unwrap().parse().unwrap();
        // Kept scores may differ in their last digit.
        (value * 1e9).round()
    };
    place.run(&eval("pr -o e"));
    let wrong = score("e");
    // The same files by another path, and elsewhere.
    fs::create_dir(place.path("x")).unwrap();
    assert!(!anew(&place, &eval("x/../pr -o e")));
    fs::rename(place.path("pr"), place.path("moved")).unwrap();
    assert!(!anew(&place, &eval("moved -o e")));
    assert_eq!(score("e"), wrong);
    // Other files of the same names.
    write_npy(place.path(&format!("moved/{id}.npy")), truth.view()).unwrap();
    assert!(anew(&place, &eval("moved -o e")));
    place.run(&eval("moved -o fresh"));
    assert!(wrong > 1e8 && score("e") == 0.0 && score("fresh") == 0.0);
    // The same files, read otherwise.
    assert!(anew(&place, &eval("moved --png-scale 2 -o e")));
}

#[cfg(feature = "onnx")]
#[test]
fn weights_beside_the_model_count_as_the_model() {
    let place = Place::new();
    place.take(fixture("external.onnx"), "external.onnx");
    place.write("external.toml", "width = 32\nheight = 32\noutput = 'metric'\n");
    let short = tiny(&[("steps = 60", "steps = 10"), ("iterations = 2", "iterations = 1")]);
    place.write("short.toml", format!("augmentation.predictions = 1\n{short}"));
    let weights = [0.9_f32, 0.05, 0.05].map(f32::to_le_bytes).concat();
    let rooms = "--dataset rooms --size 64x48 --prior-model external.onnx";
    for command in [
        format!("eval {rooms} --limit 1 --methods prior -o e"),
        format!("ablate {rooms} --limit 1 --rows min-depth --seeds 1 --config short.toml -o a"),
        format!("calibrate {rooms} --limit 3 --method short.toml -o c"),
    ] {
        place.take(fixture("external.bin"), "external.bin");
        place.run(&command);
        assert!(!anew(&place, &command), "{command}");
        place.write("external.bin", &weights);
        assert!(anew(&place, &command), "{command}");
    }
}

#[test]
fn a_damaged_map_is_computed_again() {
    let place = Place::new();
    let eval = format!("{EVAL} --methods guided -o e");
    place.run(&eval);
    let scene = names(&place.path("e/scenes")).remove(0);
    let map = place.path(&format!("e/scenes/{scene}/guided/depth.npy"));
    let whole = fs::read(&map).unwrap();
    let mut altered = whole.clone();
    *altered.last_mut().unwrap() ^= 1;
    for broken in [altered, whole[..whole.len() / 2].to_vec(), Vec::new()] {
        fs::write(&map, broken).unwrap();
        assert!(place.run(&eval).contains("guided: computed again"));
        assert_eq!(fs::read(&map).unwrap(), whole);
    }
    fs::remove_file(&map).unwrap();
    assert!(place.run(&eval).contains("guided: computed again"));
    assert!(!anew(&place, &eval));
}

#[test]
fn one_evaluation_at_a_time_writes_a_folder() {
    let place = Place::new();
    place.write("long.toml", tiny(&[("steps = 60", "steps = 100000")]));
    let mut first = place.start(&format!("{EVAL} --methods long.toml -o e"));
    wait_until(&mut first, || place.has("e/eval.json"));
    let second = format!("{EVAL} --methods guided -q -o e");
    place.refused(&second, &[&format!("another process ({})", first.id()), "-o"]);
    // The lock of a killed process holds nobody.
    first.kill().unwrap();
    first.wait().unwrap();
    assert!(place.has("e/.mde-lock"));
    place.run(&second);
    assert!(!names(&place.path("e")).iter().any(|name| name.starts_with('.')));
}
