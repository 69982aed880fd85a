//! Paths within a `transforms.json`.

use anyhow::{Context, Result};
use std::path::{Component, Path};

/// The path of an existing file as seen from `folder`, with `/` between its parts.
pub(crate) fn relative(path: &Path, folder: &Path) -> Result<String> {
    let absolute = |path: &Path| {
        // The folder may not exist yet.
        let existing = path.ancestors().find(|part| part.exists() && !part.as_os_str().is_empty());
        let existing = existing.unwrap_or(Path::new("."));
        let rest = path.strip_prefix(existing).unwrap_or(path);
        existing
            .canonicalize()
            .map(|found| if rest.as_os_str().is_empty() { found } else { found.join(rest) })
    };
    let fault = || format!("{}: can't be found; check the path", path.display());
    let (path, folder) = (absolute(path).with_context(fault)?, absolute(folder).with_context(fault)?);
    let common = path.components().zip(folder.components()).take_while(|(a, b)| a == b).count();
    let up = folder.components().skip(common).map(|_| "..");
    let down = path.components().skip(common).map(|part| {
        let name = match part {
            Component::Normal(name) => name.to_str(),
            other => other.as_os_str().to_str(),
        };
        name.with_context(|| {
            format!(
                "{}: the name is not UTF-8, which a transforms.json can't hold; rename it",
                path.display()
            )
        })
    });
    Ok(up.map(Ok).chain(down).collect::<Result<Vec<_>>>()?.join("/"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_path_leads_from_the_folder_to_the_file() {
        let place = tempfile::tempdir().unwrap();
        std::fs::create_dir_all(place.path().join("a/b")).unwrap();
        std::fs::write(place.path().join("a/b/c.png"), "").unwrap();
        let file = place.path().join("a/b/c.png");
        for (folder, expected) in
            [("a/b", "c.png"), ("a", "b/c.png"), ("", "a/b/c.png"), ("d/e", "../../a/b/c.png")]
        {
            assert_eq!(relative(&file, &place.path().join(folder)).unwrap(), expected);
        }
    }

    #[test]
    #[cfg(unix)]
    fn a_name_that_json_cannot_hold_is_refused() {
        use std::os::unix::ffi::OsStrExt;
        let place = tempfile::tempdir().unwrap();
        let file = place.path().join(std::ffi::OsStr::from_bytes(b"\xff.png"));
        std::fs::write(&file, "").unwrap();
        let fault = relative(&file, place.path()).unwrap_err().to_string();
        assert!(fault.contains("UTF-8"), "{fault}");
    }
}
