use std::fs::{self, File};
use std::io;
use std::path::{Path, PathBuf};

use super::library_faults;
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

/// Reason why a library was not written.
#[derive(Debug, thiserror::Error)]
pub enum LibraryOutputFault {
    /// The path is a folder or a device.
    #[error("{}: expected the path of a file, found a folder or device", path.display())]
    NotAFile {
        /// Path given for the library.
        path: PathBuf,
    },
    /// The file cannot be written.
    #[error("cannot write {}: {}", path.display(), reason(error))]
    Write {
        /// Path given for the library, also when its draft cannot be written.
        path: PathBuf,
        /// Cause of the failure.
        error: io::Error,
    },
    /// The measured library is invalid for runs; one line per fault.
    #[error("{}", .0.iter().map(ToString::to_string).collect::<Vec<_>>().join("\n"))]
    Unusable(Vec<Diagnostic>),
}

impl LibraryOutput {
    /// Checks, before anything is measured, that a library can be written to `out`.
    pub fn check(out: &Path) -> Result<Self, LibraryOutputFault> {
        let is_plain = fs::metadata(out).map_or(true, |found| found.is_file());
        let Some(name) = out.file_name().filter(|_| is_plain) else {
            return Err(LibraryOutputFault::NotAFile { path: out.to_owned() });
        };
        let mut name = name.to_owned();
        name.push(".part");
        let draft = out.with_file_name(name);
        File::create(&draft).map_err(|error| LibraryOutputFault::Write { path: out.to_owned(), error })?;
        Ok(Self { out: out.to_owned(), draft })
    }

    /// Reads the bytes of `library` back as a run on `rig` would, and replaces the file only if they are valid.
    pub fn replace(self, library: &Library, rig: &RigSpec) -> Result<(), LibraryOutputFault> {
        let (text, file) = (library.to_json(), self.out.display().to_string());
        let read = Library::from_json(&text, &file).map_err(LibraryOutputFault::Unusable)?;
        let faults = library_faults(&read, &file, rig);
        if !faults.is_empty() {
            return Err(LibraryOutputFault::Unusable(faults));
        }
        File::create(&self.draft)
            .and_then(|draft| write_whole(draft, &self.draft, &self.out, text.as_bytes()))
            .map_err(|error| LibraryOutputFault::Write { path: self.out.clone(), error })
    }
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
                Err(LibraryOutputFault::Unusable(faults)) => assert_eq!(faults[0].path, path),
                other => panic!("{other:?}"),
            }
            assert_eq!(fs::read_to_string(&out).unwrap(), "old");
            assert_eq!(names(folder.path()), ["l.json"]);
        }
    }

    #[test]
    fn output_that_is_a_folder_or_lacks_one_is_refused_beforehand() {
        let folder = tempfile::tempdir().unwrap();
        let not_a_file = |out: &Path| matches!(LibraryOutput::check(out), Err(LibraryOutputFault::NotAFile { .. }));
        assert!(not_a_file(folder.path()) && not_a_file(&folder.path().join("..")));
        let nowhere = folder.path().join("none/l.json");
        assert!(matches!(LibraryOutput::check(&nowhere), Err(LibraryOutputFault::Write { .. })));
        assert_eq!(names(folder.path()), [""; 0]);
    }
}
