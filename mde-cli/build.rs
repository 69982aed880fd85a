//! Passes the versions of the workspace's crates to the program, and to the tests whether the documents exist.

use std::path::{Path, PathBuf};

fn main() {
    println!("cargo:rerun-if-changed=build.rs");
    let versions = lock_file().map(|path| versions(&path)).unwrap_or_default();
    println!("cargo:rustc-env=MDE_VERSIONS={}", versions.join(" "));
    println!("cargo:rustc-check-cfg=cfg(documents)");
    if std::env::var_os("CARGO_MANIFEST_DIR")
        .is_some_and(|package| Path::new(&package).join("../docs").is_dir())
    {
        println!("cargo:rustc-cfg=documents");
    }
}

/// The lock file of the workspace, or of the package alone where it was published.
fn lock_file() -> Option<PathBuf> {
    let package = PathBuf::from(std::env::var_os("CARGO_MANIFEST_DIR")?);
    package.ancestors().map(|folder| folder.join("Cargo.lock")).find(|path| path.is_file())
}

/// `name=version` of every package whose name starts with `mde-`, but the Python package, which is built on the program.
fn versions(lock: &Path) -> Vec<String> {
    println!("cargo:rerun-if-changed={}", lock.display());
    let text = std::fs::read_to_string(lock).unwrap_or_default();
    let value =
        |line: &str, key: &str| Some(line.strip_prefix(key)?.trim_matches([' ', '=', '"']).to_owned());
    let (mut found, mut name) = (Vec::new(), None);
    for line in text.lines() {
        if let Some(value) = value(line, "name") {
            name = (value.starts_with("mde-") && value != "mde-py").then_some(value);
        } else if let (Some(name), Some(version)) = (&name, value(line, "version")) {
            found.push(format!("{name}={version}"));
        }
    }
    found
}
