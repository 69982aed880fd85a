//! The same bytes on processors with other vectors: the tests run themselves within qemu-user.

use crate::library::{config, go_on, inputs, refine_several, rendered, tiny};
use mde_cli::{Preset, Stages, refine};
use mde_eval::scene::Room;
use std::fs;
use std::path::Path;
use std::process::Command;

/// Where [`bytes_of_small_runs`] writes them.
const BYTES: &str = "MDE_BYTES";
/// SSE2, and AVX2 with FMA but without what qemu would warn of. It does not emulate AVX-512.
const PROCESSORS: [&str; 2] = ["qemu64", "Haswell-noTSX,-pcid,-x2apic,-tsc-deadline,-invpcid"];

/// One photograph with each kind of field, and several.
#[test]
#[ignore = "a part of the other test, which runs it within qemu"]
fn bytes_of_small_runs() {
    let Some(path) = std::env::var_os(BYTES) else { return };
    let (capture, prior) = inputs(&rendered(Room::Study, 2, [64, 48]), true);
    let alone = |text: &str| {
        let photograph = &capture.photographs[0];
        let (image, camera) = (photograph.image.read().unwrap(), &photograph.camera.camera);
        refine(image.view(), camera, Stages::new(&prior), &config(Preset::Paper, text), &mut go_on).unwrap()
    };
    let short = tiny(4, 1);
    let hash = alone(&short);
    let grids = "kind = 'hash', levels = 4, log2-rows = 10, finest = 64";
    let mlp = alone(&short.replace(grids, "kind = 'mlp', layers = 2"));
    let field: Vec<&str> = short.lines().filter(|line| line.starts_with("nerf.")).collect();
    let config = config(Preset::MultiView, &field.join("\n"));
    let several = refine_several(&capture, Stages::new(&prior), &config, &mut go_on).unwrap();
    assert_eq!(several.capture.as_ref().unwrap().fallback, None);
    let runs = [("hash", hash), ("MLP", mlp), ("several photographs", several)].map(|(name, refined)| {
        assert!(refined.field.is_some(), "{name}: no field");
        assert!(refined.prior != refined.depth.mean(), "{name}: the field has no part in it");
        let bits = |map: ndarray::ArrayView2<'_, f32>| map.iter().map(|v| v.to_bits()).collect::<Vec<_>>();
        (name, bits(refined.depth.mean()), bits(refined.depth.variance()))
    });
    fs::write(path, serde_json::to_vec(&runs).unwrap()).unwrap();
}

#[test]
#[ignore = "needs qemu-x86_64 (Debian: qemu-user), and takes minutes"]
fn the_vectors_of_a_processor_change_no_byte() {
    let this = std::env::current_exe().unwrap();
    let bytes = |start: &[&str], name: &str| {
        let path = Path::new(env!("CARGO_TARGET_TMPDIR")).join(name);
        let (_, module) = module_path!().split_once("::").unwrap();
        let mut command = Command::new("env");
        command.args(start).arg(&this).args(["--exact", &format!("{module}::bytes_of_small_runs")]);
        command.args(["--ignored", "--test-threads", "1"]).env(BYTES, &path);
        assert!(command.status().unwrap().success(), "{name}");
        serde_json::from_slice::<Vec<(String, Vec<u32>, Vec<u32>)>>(&fs::read(path).unwrap()).unwrap()
    };
    let here = bytes(&[], "here");
    std::thread::scope(|scope| {
        for processor in PROCESSORS {
            let (bytes, here) = (&bytes, &here);
            scope.spawn(move || {
                for (a, b) in here.iter().zip(bytes(&["qemu-x86_64", "-cpu", processor], processor)) {
                    assert!(*a == b, "{processor}: {}", a.0);
                }
            });
        }
    });
}
