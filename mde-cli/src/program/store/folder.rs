//! An output folder, written atomically.

pub(crate) use crate::output::folder::{RECORD, files_in, list_files};
use crate::output::folder::{exchange, listed_files};
use crate::program::interrupt;
use crate::program::store::lock::{self, Lock};
use anyhow::{Context, Result, bail, ensure};
use std::fs::{self, Metadata};
use std::io::ErrorKind;
use std::path::{Path, PathBuf};

/// The file that marks one of many finished folders, written last.
pub(crate) const ENTRY: &str = "finished.json";

/// Begins the name of what is not finished.
const PREFIX: &str = ".mde-";

#[derive(Debug)]
pub(crate) struct OutputFolder {
    target: PathBuf,
    force: bool,
}

impl OutputFolder {
    /// Checks that the folder can be written at the end; creates nothing.
    pub(crate) fn new(target: &Path, force: bool) -> Result<Self> {
        ensure!(
            target.file_name().is_some(),
            "{}: not the name of a new folder; give one to -o",
            target.display()
        );
        let folder = Self { target: target.to_owned(), force };
        folder.check_target()?;
        check_place("-o", parent(target))?;
        Ok(folder)
    }

    pub(crate) fn path(&self) -> &Path {
        &self.target
    }

    fn check_target(&self) -> Result<()> {
        let path = self.target.display();
        let Some(found) = named("-o", &self.target)? else { return Ok(()) };
        ensure!(found.is_dir(), "{path}: exists and is not a folder; give another name to -o");
        ensure!(self.force, "{path}: the folder exists; give another name to -o, or --force to replace it");
        if fs::read_dir(&self.target).with_context(|| path.to_string())?.next().is_none() {
            return Ok(());
        }
        let Ok(written) = listed_files(&self.target) else {
            bail!("{path}: not replaced, as it holds no {RECORD} of an earlier run; give another name to -o");
        };
        let found = files_in(&self.target).with_context(|| path.to_string())?;
        // The entry comes after the list.
        let ours = |name: &&PathBuf| written.contains(name) || name.as_path() == Path::new(ENTRY);
        if let Some(foreign) = found.iter().find(|name| !ours(name)) {
            let foreign = foreign.display();
            bail!(
                "{path}: not replaced, as no run wrote its {foreign}; move that away, or give another name to -o"
            );
        }
        Ok(())
    }

    /// Lets `fill` write the folder, which then appears whole.
    pub(crate) fn write(&self, fill: impl FnOnce(&Path) -> Result<()>) -> Result<()> {
        let listed = |folder: &Path| {
            fill(folder)?;
            Ok(list_files(folder)?)
        };
        replace(&self.target, listed, || self.check_target())
    }
}

/// Lets `fill` write into a temporary sibling, and renames that to the folder once `check` allows it.
pub(crate) fn replace(
    target: &Path,
    fill: impl FnOnce(&Path) -> Result<()>,
    check: impl FnOnce() -> Result<()>,
) -> Result<()> {
    let parent = parent(target);
    // Removed again where the results do not come into it.
    let _made = NewFolder::make(parent)?;
    let temporary = builder()
        .tempdir_in(parent)
        .with_context(|| format!("{}: can't make a folder in it", parent.display()))?;
    let _guard = interrupt::guard(temporary.path());
    fill(temporary.path())?;
    let held = interrupt::hold();
    ensure!(!interrupt::requested(), crate::error::Error::Interrupted);
    check()?;
    exchange(temporary.path(), target)
        .with_context(|| format!("{}: can't put the results there", target.display()))?;
    drop(held);
    // It has another name now.
    let _ = temporary.keep();
    Ok(())
}

/// Checks that a folder is new, or that of an earlier run: it has the file `marker`, or nothing but what `is_own`; creates nothing.
pub(crate) fn check_own(
    folder: &Path,
    marker: &str,
    is_marker: impl Fn(&Path) -> bool,
    is_own: impl Fn(&Path) -> bool,
) -> Result<()> {
    check_place("-o", folder)?;
    let shown = folder.display();
    if folder.exists() && !is_marker(&folder.join(marker)) {
        let entries = fs::read_dir(folder).with_context(|| shown.to_string())?;
        let own = |path: &Path| is_unfinished(path) || is_own(path);
        ensure!(
            entries.flatten().all(|entry| own(&entry.path())),
            "{shown}: holds no {marker} of an earlier run; give another name to -o"
        );
    }
    Ok(())
}

/// Whether a killed run may have left it.
fn is_unfinished(path: &Path) -> bool {
    path.file_name().is_some_and(|name| name.as_encoded_bytes().starts_with(PREFIX.as_bytes()))
}

/// A folder that is made with those above it, and removed with them where nothing came into them.
pub(crate) struct NewFolder(Vec<PathBuf>);

impl NewFolder {
    pub(crate) fn make(folder: &Path) -> Result<Self> {
        let absent = folder.ancestors().take_while(|path| !path.as_os_str().is_empty() && !path.exists());
        let made = Self(absent.map(Path::to_owned).collect());
        fs::create_dir_all(folder).with_context(|| {
            format!("{}: can't make this folder; give another name to -o", folder.display())
        })?;
        Ok(made)
    }
}

impl Drop for NewFolder {
    fn drop(&mut self) {
        for folder in &self.0 {
            let _ = fs::remove_dir(folder);
        }
    }
}

/// A folder that a run fills bit by bit.
pub(crate) struct OpenFolder {
    // Dropped in this order: the folder can go once the lock is gone.
    _lock: Option<Lock>,
    _made: NewFolder,
}

impl OpenFolder {
    /// Makes it where it is missing; unless it is `shared` with other processes, locks it and removes what killed runs left unfinished.
    pub(crate) fn open(folder: &Path, shared: bool) -> Result<Self> {
        let made = NewFolder::make(folder)?;
        let lock = if shared { None } else { Lock::take(folder)? };
        if !shared {
            remove_unfinished(folder);
        }
        Ok(Self { _lock: lock, _made: made })
    }
}

/// The folders in a folder, sorted; none where it is missing.
pub(crate) fn folders_in(folder: &Path) -> Vec<PathBuf> {
    let entries = fs::read_dir(folder).into_iter().flatten().flatten();
    let mut folders: Vec<_> = entries.map(|entry| entry.path()).filter(|path| path.is_dir()).collect();
    folders.sort();
    folders
}

/// Checks that the file of `flag` can be written at the end; creates nothing.
pub(crate) fn check_new_file(flag: &str, path: &Path, force: bool) -> Result<()> {
    let name = path.display();
    ensure!(!path.is_dir(), "{flag} {name}: is a folder; give a file's name");
    ensure!(
        force || !path.exists(),
        "{flag} {name}: the file exists; give another name, or --force to replace it"
    );
    named(flag, path)?;
    check_place(flag, parent(path))
}

/// Most bytes of a name, with room for the prefix and the extension of a temporary file.
const LONGEST_FILE_NAME: usize = 200;

/// A file name that every file system accepts; different texts have different names.
pub(crate) fn file_name(text: &str) -> String {
    let mut name = String::new();
    for byte in text.bytes() {
        match byte {
            b'.' if name.is_empty() => name += "%2e",
            b'/' => name.push('+'),
            _ if byte.is_ascii_alphanumeric() || b"-_.".contains(&byte) => name.push(char::from(byte)),
            _ => name += &format!("%{byte:02x}"),
        }
    }
    if name.len() > LONGEST_FILE_NAME {
        // Ends in the checksum of the whole text.
        name.truncate(LONGEST_FILE_NAME - 9);
        name += &format!("~{:08x}", crc32fast::hash(text.as_bytes()));
    }
    name
}

/// Checks that a folder, or its first existing ancestor, is writable.
pub(crate) fn check_place(flag: &str, folder: &Path) -> Result<()> {
    for path in folder.ancestors().take_while(|path| !path.exists()) {
        let link = named(flag, path)?.is_some();
        ensure!(!link, "{}: is a link to nothing; give another place to {flag}", path.display());
    }
    let ancestor = folder.ancestors().find(|path| path.exists()).unwrap_or(Path::new("."));
    ensure!(ancestor.is_dir(), "{}: is not a folder; give another place to {flag}", ancestor.display());
    tempfile::tempfile_in(ancestor).with_context(|| {
        format!("{}: can't write there; give another place to {flag}", ancestor.display())
    })?;
    Ok(())
}

/// What has that name, a link itself; an error for a name that nothing can have.
fn named(flag: &str, path: &Path) -> Result<Option<Metadata>> {
    match fs::symlink_metadata(path) {
        Ok(found) => Ok(Some(found)),
        Err(error) if matches!(error.kind(), ErrorKind::NotFound | ErrorKind::NotADirectory) => Ok(None),
        Err(error) => Err(error).with_context(|| format!("{}: give another name to {flag}", path.display())),
    }
}

pub(crate) fn parent(path: &Path) -> &Path {
    path.parent().filter(|parent| !parent.as_os_str().is_empty()).unwrap_or(Path::new("."))
}

/// Removes the folders and files that killed runs left unfinished in a folder of results that no other process writes to.
pub(crate) fn remove_unfinished(folder: &Path) {
    for path in fs::read_dir(folder).into_iter().flatten().flatten().map(|entry| entry.path()) {
        // The lock is this process's own.
        if is_unfinished(&path) && !path.ends_with(lock::FILE) {
            let _ = fs::remove_dir_all(&path).or_else(|_| fs::remove_file(&path));
        }
    }
}

/// Temporary folders are private by default; a result should have the permissions that the user's umask gives.
fn builder() -> tempfile::Builder<'static, 'static> {
    let mut builder = tempfile::Builder::new();
    builder.prefix(PREFIX);
    #[cfg(unix)]
    {
        use std::os::unix::fs::PermissionsExt;
        builder.permissions(fs::Permissions::from_mode(0o777));
    }
    builder
}

#[cfg(test)]
mod tests {
    use super::*;

    #[cfg(unix)]
    #[test]
    fn a_link_to_nothing_is_refused_before_the_work() {
        let place = tempfile::tempdir().unwrap();
        let link = place.path().join("link");
        std::os::unix::fs::symlink(place.path().join("absent"), &link).unwrap();
        for target in [link.clone(), link.join("out"), link.join("a/b")] {
            let refused = OutputFolder::new(&target, true).unwrap_err().to_string();
            assert!(refused.contains("link") && refused.contains("-o"), "{refused}");
        }
        assert!(!place.path().join("absent").exists());
    }

    #[test]
    fn every_name_has_a_file_name_of_its_own() {
        let long = ["室".repeat(60), "室".repeat(61), "a".repeat(300), "a".repeat(301)];
        let names = ["a/b", "a+b", "a b", ".", "..", "a%2fb", "zoom+fbs", "ä"].into_iter();
        let names: Vec<_> = names.chain(long.iter().map(String::as_str)).map(file_name).collect();
        assert!(names.iter().all(|name| name.len() <= LONGEST_FILE_NAME));
        let distinct: std::collections::BTreeSet<_> = names.iter().collect();
        assert_eq!(distinct.len(), names.len());
        assert!(names.iter().all(|name| !name.contains('/') && !name.starts_with('.')), "{names:?}");
    }
}
