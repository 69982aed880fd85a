//! The step by which a finished folder gets its name.

use std::fs;
use std::io::Result;
use std::path::Path;

/// Gives the folder `new` the name `target`, on the same file system, and removes what had that name: in one exchange where the file
/// system can, so that a process killed here leaves the old folder or the new one.
///
/// # Errors
/// Those of the file system; the old folder then keeps its name.
pub fn exchange(new: &Path, target: &Path) -> Result<()> {
    if !target.exists() {
        return fs::rename(new, target);
    }
    #[cfg(target_os = "linux")]
    {
        use rustix::fs::{CWD, RenameFlags, renameat_with};
        if renameat_with(CWD, new, CWD, target, RenameFlags::EXCHANGE).is_ok() {
            return fs::remove_dir_all(new);
        }
    }
    let mut aside = new.as_os_str().to_owned();
    aside.push(".old");
    let aside = Path::new(&aside);
    fs::rename(target, aside)?;
    fs::rename(new, target).inspect_err(|_| {
        let _ = fs::rename(aside, target);
    })?;
    fs::remove_dir_all(aside)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_folder_takes_the_place_of_another() {
        let place = tempfile::tempdir().unwrap();
        let [new, target] = ["new", "target"].map(|name| place.path().join(name));
        for content in ["first", "second"] {
            fs::create_dir(&new).unwrap();
            fs::write(new.join("file"), content).unwrap();
            exchange(&new, &target).unwrap();
            assert_eq!(fs::read_to_string(target.join("file")).unwrap(), content);
            assert_eq!(fs::read_dir(place.path()).unwrap().count(), 1);
        }
    }
}
