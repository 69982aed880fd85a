use std::io;
use std::path::Path;

/// The path of a file as seen from `folder`, with `/` between its parts, as a `transforms.json` there names it; both exist. None for a name
/// that is not UTF-8, which JSON can't hold.
///
/// # Errors
/// Those of the file system where one of them can't be found.
pub fn relative_path(path: &Path, folder: &Path) -> io::Result<Option<String>> {
    let [path, folder] = [path.canonicalize()?, folder.canonicalize()?];
    let common = path.components().zip(folder.components()).take_while(|(a, b)| a == b).count();
    let up = folder.components().skip(common).map(|_| Some(".."));
    let down = path.components().skip(common).map(|part| part.as_os_str().to_str());
    let parts: Option<Vec<&str>> = up.chain(down).collect();
    Ok(parts.map(|parts| parts.join("/")))
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::fs;

    #[test]
    fn a_path_leads_from_the_folder_to_the_file() {
        let place = tempfile::tempdir().unwrap();
        for folder in ["a/b", "d/e"] {
            fs::create_dir_all(place.path().join(folder)).unwrap();
        }
        let file = place.path().join("a/b/c.png");
        fs::write(&file, "").unwrap();
        let cases = [("a/b", "c.png"), ("a", "b/c.png"), ("", "a/b/c.png"), ("d/e", "../../a/b/c.png")];
        for (folder, expected) in cases {
            assert_eq!(relative_path(&file, &place.path().join(folder)).unwrap().as_deref(), Some(expected));
        }
    }
}
