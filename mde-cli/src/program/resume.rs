//! `OUT.resume`, the folder beside an output from which `--resume` continues.

use crate::program::store::folder::temporary_folder;
use crate::program::provenance::write_json;
use crate::program::interrupt;
use anyhow::{Context, Result, ensure};
use serde_json::json;
use std::fs;
use std::path::{Path, PathBuf};

/// The file that marks the folder as the program's own.
const MARKER: &str = "resume.json";

/// The folder with one entry, itself a folder, for each finished piece of work. An entry appears whole or not at all.
pub(crate) struct ResumeFolder {
    path: PathBuf,
    /// The file that every entry has.
    record: &'static str,
}

impl ResumeFolder {
    /// In a folder beside the output. One that the program did not make is refused.
    pub(crate) fn beside(output: &Path, record: &'static str) -> Result<Self> {
        let mut name = output.file_name().unwrap_or_default().to_owned();
        name.push(".resume");
        let folder = Self { path: output.with_file_name(name), record };
        folder.check()?;
        Ok(folder)
    }

    fn check(&self) -> Result<()> {
        let shown = self.path.display();
        let Ok(found) = fs::symlink_metadata(&self.path) else { return Ok(()) };
        let remedy = "move it away, or give another name to -o";
        ensure!(found.is_dir(), "{shown}: --resume needs this name for a folder of its own; {remedy}");
        if self.path.join(MARKER).is_file() {
            return Ok(());
        }
        for entry in fs::read_dir(&self.path).with_context(|| shown.to_string())? {
            let name = entry.with_context(|| shown.to_string())?.file_name();
            // A run that was killed as it made the folder leaves no more than unfinished files.
            ensure!(
                name.as_encoded_bytes().starts_with(b".mde-"),
                "{shown}: a folder of this name that --resume did not make; {remedy}"
            );
        }
        Ok(())
    }

    pub(crate) fn entry(&self, name: &str) -> PathBuf {
        self.path.join(name)
    }

    /// Lets `fill` write an entry, in place of an older one.
    pub(crate) fn keep(&self, name: &str, fill: impl FnOnce(&Path) -> Result<()>) -> Result<()> {
        let fault = || format!("{}: can't write there what --resume keeps", self.path.display());
        self.check()?;
        fs::create_dir_all(&self.path).with_context(fault)?;
        let marker = self.path.join(MARKER);
        if !marker.is_file() {
            write_json(&marker, &json!({ "program": "mde" }))?;
        }
        let temporary = temporary_folder(&self.path)?;
        let new = temporary.path().join("new");
        fs::create_dir(&new).with_context(fault)?;
        let guard = interrupt::guard(temporary.path());
        fill(&new)?;
        let held = interrupt::hold();
        let place = self.entry(name);
        if place.exists() {
            fs::rename(&place, temporary.path().join("old")).with_context(fault)?;
        }
        fs::rename(&new, &place).with_context(fault)?;
        drop(held);
        drop(guard);
        Ok(())
    }

    /// Removes what the program wrote there once the results are written; the folder, unless it holds anything else.
    pub(crate) fn discard(&self) {
        if self.check().is_err() {
            return;
        }
        self.discard_entries();
        // Last: a run killed before this line leaves a folder that is still known.
        let _ = fs::remove_file(self.path.join(MARKER));
        let _ = fs::remove_dir(&self.path);
    }

    /// Entries leave whole, by a rename, as a killed removal would leave folders without their record.
    fn discard_entries(&self) {
        let Ok(removed) = temporary_folder(&self.path) else { return };
        for entry in fs::read_dir(&self.path).into_iter().flatten().flatten() {
            let unfinished = entry.file_name().as_encoded_bytes().starts_with(b".mde-");
            let folder = entry.file_type().is_ok_and(|kind| kind.is_dir());
            if unfinished || (folder && entry.path().join(self.record).is_file()) {
                let _ = fs::rename(entry.path(), removed.path().join(entry.file_name()));
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const RECORD: &str = "state.json";

    fn kept(output: &Path) -> ResumeFolder {
        let folder = ResumeFolder::beside(output, RECORD).unwrap();
        folder.keep("1", |path| Ok(fs::write(path.join(RECORD), "{}")?)).unwrap();
        folder
    }

    #[test]
    fn a_folder_of_someone_else_is_refused_and_stays() {
        let place = tempfile::tempdir().unwrap();
        let output = place.path().join("out");
        let other = place.path().join("out.resume");
        fs::create_dir(&other).unwrap();
        fs::write(other.join("thesis.txt"), "years").unwrap();
        let refused = ResumeFolder::beside(&output, RECORD).err().unwrap().to_string();
        assert!(refused.contains("out.resume") && refused.contains("move it away"), "{refused}");
        fs::remove_file(other.join("thesis.txt")).unwrap();
        fs::write(other.join(".mde-AbCdEf"), "{").unwrap();
        kept(&output).discard();
        assert!(!other.exists());
        fs::write(&other, "a file").unwrap();
        assert!(ResumeFolder::beside(&output, RECORD).is_err());
    }

    #[test]
    fn only_what_the_program_wrote_is_removed() {
        let place = tempfile::tempdir().unwrap();
        let output = place.path().join("out");
        let folder = kept(&output);
        let path = place.path().join("out.resume");
        fs::write(path.join("thesis.txt"), "years").unwrap();
        fs::create_dir(path.join("mine")).unwrap();
        folder.discard_entries();
        assert!(path.join(MARKER).is_file() && !path.join("1").exists());
        folder.discard();
        let mut names: Vec<_> = fs::read_dir(&path).unwrap().map(|e| e.unwrap().file_name()).collect();
        names.sort();
        assert_eq!(names, ["mine", "thesis.txt"]);
    }

    #[cfg(unix)]
    #[test]
    fn no_link_is_followed() {
        let place = tempfile::tempdir().unwrap();
        let target = place.path().join("photographs");
        kept(&place.path().join("photographs"));
        fs::rename(place.path().join("photographs.resume"), &target).unwrap();
        std::os::unix::fs::symlink(&target, place.path().join("out.resume")).unwrap();
        assert!(ResumeFolder::beside(&place.path().join("out"), RECORD).is_err());
        assert!(target.join("1").join(RECORD).is_file());
    }
}
