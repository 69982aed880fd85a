//! Names of folders for photographs.

use std::collections::HashSet;
use std::path::Path;

/// A folder's name for each photograph: that of its file without the extension, unique on any file system, and none of `reserved`.
/// Names that collide are numbered in the order of the paths, so that the order of the photographs changes no name.
pub fn folders<'n>(photographs: impl Iterator<Item = &'n Path>, reserved: &[&str]) -> Vec<String> {
    let mut taken: HashSet<String> = reserved.iter().map(|name| name.to_lowercase()).collect();
    let mut name = |photograph: &Path| {
        let stem = photograph.file_stem().unwrap_or_default().to_string_lossy().into_owned();
        let plain = |c: char| if c.is_alphanumeric() || "-_.".contains(c) { c } else { '_' };
        let base: String = stem.chars().map(plain).collect::<String>().trim_start_matches('.').to_owned();
        let base = if base.is_empty() { "photograph".to_owned() } else { base };
        let numbered = (2_u64..).map(|number| format!("{base}_{number}"));
        let free =
            std::iter::once(base.clone()).chain(numbered).find(|name| !taken.contains(&name.to_lowercase()));
        let name = free.unwrap_or(base);
        taken.insert(name.to_lowercase());
        name
    };
    let mut sorted: Vec<(usize, &Path)> = photographs.enumerate().collect();
    sorted.sort_by_key(|(_, photograph)| *photograph);
    let mut named: Vec<(usize, String)> =
        sorted.into_iter().map(|(index, photograph)| (index, name(photograph))).collect();
    named.sort();
    named.into_iter().map(|(_, name)| name).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn folders_are_named_after_the_photographs_and_differ() {
        let names = ["a/1.png", "b/1.PNG", "ü b.jpg", "cloud.ply.png", ".jpg", "A 1.png", "a?1.png"];
        let expected = ["1", "1_2", "ü_b", "cloud.ply_2", "jpg", "A_1", "a_1_2"];
        assert_eq!(folders(names.iter().map(Path::new), &["cloud.ply"]), expected);
        let reversed = folders(names.iter().rev().map(Path::new), &["cloud.ply"]);
        assert_eq!(reversed.iter().rev().collect::<Vec<_>>(), expected.iter().collect::<Vec<_>>());
    }
}
