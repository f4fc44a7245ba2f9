use std::fs::{self, File};
use std::io;
use std::path::{Path, PathBuf};

use super::{RunError, library_faults};
use crate::config::RigSpec;
use upm_core::document::{Diagnostic, reason};
use upm_core::files::write_whole;
use upm_planning::cor_library::Library;

/// Output file of a library that is still to be measured.
///
/// The file is replaced as a whole, by a library that its own loader has read back; until then it is left untouched.
#[derive(Debug)]
pub struct LibraryOutput {
    out: PathBuf,
    /// Temporary file beside it, to be renamed.
    draft: PathBuf,
}

impl LibraryOutput {
    /// Checks, before anything is measured, that a library can be written to `out`.
    pub fn check(out: &Path) -> Result<Self, RunError> {
        let is_plain = fs::metadata(out).map_or(true, |found| found.is_file());
        let Some(name) = out.file_name().filter(|_| is_plain) else {
            let file = out.display().to_string();
            return Err(Diagnostic::new(&file, "$", "a folder or device", "the path of a file").into());
        };
        let mut name = name.to_owned();
        name.push(".part");
        let draft = out.with_file_name(name);
        File::create(&draft).map_err(|error| not_written(out, &error))?;
        Ok(Self { out: out.to_owned(), draft })
    }

    /// Reads the bytes of `library` back as a run on `rig` would, and replaces the file only if they are valid.
    pub fn replace(self, library: &Library, rig: &RigSpec) -> Result<(), RunError> {
        let (text, file) = (library.to_json(), self.out.display().to_string());
        let read = Library::from_json(&text, &file)?;
        let faults = library_faults(&read, &file, rig);
        if !faults.is_empty() {
            return Err(faults.into());
        }
        File::create(&self.draft)
            .and_then(|draft| write_whole(draft, &self.draft, &self.out, text.as_bytes()))
            .map_err(|error| not_written(&self.out, &error))
    }
}

fn not_written(out: &Path, error: &io::Error) -> RunError {
    RunError::Write { path: out.display().to_string(), reason: reason(error) }
}

impl Drop for LibraryOutput {
    fn drop(&mut self) {
        // absent if it was already renamed
        fs::remove_file(&self.draft).ok();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn rig() -> RigSpec {
        RigSpec::load(&Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../..")).join("configs/rigs/upm-1.json"))
            .unwrap()
    }

    fn shipped() -> Library {
        Library::load(rig().library.as_ref().unwrap()).unwrap()
    }

    fn names(folder: &Path) -> Vec<String> {
        fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().file_name().into_string().unwrap()).collect()
    }

    #[test]
    fn library_that_its_loader_reads_back_replaces_the_file() {
        let folder = tempfile::tempdir().unwrap();
        let out = folder.path().join("l.json");
        fs::write(&out, "old").unwrap();
        LibraryOutput::check(&out).unwrap().replace(&shipped(), &rig()).unwrap();
        assert_eq!(fs::read_to_string(&out).unwrap(), shipped().to_json());
        assert_eq!(names(folder.path()), ["l.json"]);
    }

    #[test]
    fn library_that_its_loader_refuses_leaves_the_file_untouched() {
        let folder = tempfile::tempdir().unwrap();
        let out = folder.path().join("l.json");
        fs::write(&out, "old").unwrap();
        let dead_channel = Library { accelerometer_gain: [35.9, 1.0, 62.9, 1.0], ..shipped() };
        let of_another_rig = Library { fingerprint: "0".into(), ..shipped() };
        for (library, path) in [(dead_channel, "accelerometer_gain[0]"), (of_another_rig, "fingerprint")] {
            match LibraryOutput::check(&out).unwrap().replace(&library, &rig()) {
                Err(RunError::Input(faults)) => assert_eq!(faults[0].path, path),
                other => panic!("{other:?}"),
            }
            assert_eq!(fs::read_to_string(&out).unwrap(), "old");
            assert_eq!(names(folder.path()), ["l.json"]);
        }
    }

    #[test]
    fn output_that_is_a_folder_or_lacks_one_is_refused_beforehand() {
        let folder = tempfile::tempdir().unwrap();
        let not_a_file = |out: &Path| matches!(LibraryOutput::check(out), Err(RunError::Input(_)));
        assert!(not_a_file(folder.path()) && not_a_file(&folder.path().join("..")));
        let nowhere = folder.path().join("none/l.json");
        assert!(matches!(LibraryOutput::check(&nowhere), Err(RunError::Write { .. })));
        assert_eq!(names(folder.path()), [""; 0]);
    }
}
