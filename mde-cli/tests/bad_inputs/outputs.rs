//! Where results go.

use crate::table::{check, refused};

#[test]
pub(crate) fn unusable_places() {
    let refine = "refine image.png --prior-depth depth.npy --quiet";
    let mut cases = vec![
        refused(format!("{refine} -o empty"), &["empty", "--force"]),
        refused(format!("{refine} -o earlier"), &["earlier", "--force"]),
        refused(format!("{refine} -o file --force"), &["file", "not a folder", "-o"]),
        refused(format!("{refine} -o file/out"), &["file", "not a folder", "-o"]),
        refused(format!("{refine} -o thesis --force"), &["thesis", "run.json", "-o"]),
        refused(format!("{refine} -o .."), &["..", "-o"]),
        refused(format!("{refine} -o {}", "n".repeat(300)), &["nnn", "too long", "-o"]),
        refused(format!("{refine} -o /"), &["/", "-o"]),
        refused("demo --size 64x48 --quiet -o empty", &["empty", "--force"]),
        refused("warp image.png --prior-depth depth.npy --quiet -o empty", &["empty", "--force"]),
        refused(
            "render --field field.safetensors --size 64x48 -q -o thesis --force",
            &["thesis", "run.json"],
        ),
        refused(
            "eval --dataset rooms --limit 1 --size 64x48 --quiet -o thesis",
            &["thesis", "eval.json", "-o"],
        ),
        refused(
            "eval --dataset rooms --limit 1 --size 64x48 --quiet -o file",
            &["file", "not a folder", "-o"],
        ),
        refused("eval --dataset rooms --limit 1 --size 64x48 --quiet -o file/out", &["file", "-o"]),
        refused("ablate --dataset rooms --limit 1 --size 64x48 --quiet -o thesis", &["thesis", "eval.json"]),
    ];
    // Not even the superuser can write there.
    if cfg!(target_os = "linux") {
        cases.push(refused(format!("{refine} -o /proc/out"), &["/proc", "can't write there", "-o"]));
        cases.push(refused(
            "eval --dataset rooms --limit 1 --size 64x48 --quiet -o /proc/out",
            &["/proc", "-o"],
        ));
    }
    check(&cases);
}
