use std::fs::{self, File};
use std::path::{Path, PathBuf};
use std::sync::Arc;

use super::RunError;
use crate::config::{Diagnostic, DiagnosticClass, JobSpec, LibraryRef, RigSpec, place_parts};
use upm_core::files::write_whole;
use upm_core::random::Streams;
use upm_planning::cor_library::Library;

/// Expected of a job or a rig without a library.
const MADE_BY: &str = "a COR library, made by `upm calibrate`";

/// Reads the COR library of a job and checks it against the job's rig.
pub fn job_library(job: &JobSpec) -> Result<Arc<Library>, Vec<Diagnostic>> {
    match &job.library {
        Some(LibraryRef::File(path)) => load_library(path, &job.library_key(), &job.rig),
        Some(LibraryRef::Inline(library)) => {
            let file = format!("{}: library", job.file);
            fitting(Library::from_value(library, &file)?, &file, &job.rig)
        }
        None => {
            let found = "nothing, in the job and in its rig";
            Err(vec![Diagnostic::new(&job.file, "library", found, MADE_BY)])
        }
    }
}

/// Reads the COR library that `rig` names and checks it against the rig.
pub fn rig_library(rig: &RigSpec) -> Result<Arc<Library>, Vec<Diagnostic>> {
    let name = &rig.model.name;
    let none = || vec![Diagnostic::new(name, "library", "nothing", MADE_BY)];
    load_library(rig.library.as_ref().ok_or_else(none)?, &format!("rig {name}: library"), rig)
}

/// `library`, read from `file`, or the reasons why it does not fit the rig.
fn fitting(library: Library, file: &str, rig: &RigSpec) -> Result<Arc<Library>, Vec<Diagnostic>> {
    let faults = library_faults(&library, file, rig);
    if faults.is_empty() { Ok(Arc::new(library)) } else { Err(faults) }
}

/// Reads the COR library at `path` and checks it against `rig`; faults carry the key that names the file.
pub fn load_library(path: &Path, named_by: &str, rig: &RigSpec) -> Result<Arc<Library>, Vec<Diagnostic>> {
    let library = Library::load(path).and_then(|library| fitting(library, &path.display().to_string(), rig));
    let named = |mut fault: Diagnostic| {
        if fault.class == DiagnosticClass::Unreadable {
            fault.found += "; `upm calibrate` makes one";
        }
        fault.named_by(named_by)
    };
    library.map_err(|faults| faults.into_iter().map(named).collect())
}

/// Checks whether the parts of `job` find places. No picture is taken and nothing is planned, so the check is cheap
/// enough for every submitted job.
pub fn check_places(job: &JobSpec) -> Result<(), Diagnostic> {
    place_parts(job, Streams::new(job.seed())).map(|_| ())
}

/// As [`job_library`] and [`check_places`]: the faults of both.
pub fn library_and_places(job: &JobSpec) -> Result<Arc<Library>, Vec<Diagnostic>> {
    match (job_library(job), check_places(job)) {
        (Ok(library), Ok(())) => Ok(library),
        (library, places) => Err(library.err().into_iter().flatten().chain(places.err()).collect()),
    }
}

/// All reasons why `library`, read from `file`, cannot be used on `rig`.
pub fn library_faults(library: &Library, file: &str, rig: &RigSpec) -> Vec<Diagnostic> {
    let faults = library.check_fits(&rig.model, &rig.fingerprint).into_iter();
    faults.map(|fault| fault.in_file(file)).collect()
}

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
        if out.file_name().is_none() || fs::metadata(out).is_ok_and(|found| !found.is_file()) {
            let file = out.display().to_string();
            return Err(Diagnostic::new(&file, "$", "a folder or device", "the path of a file").into());
        }
        let draft = out.with_added_extension("part");
        File::create(&draft).map_err(|error| RunError::write(out, &error))?;
        Ok(Self { out: out.to_owned(), draft })
    }

    /// Reads the bytes of `library` back as a run on `rig` would, and replaces the file only if they are valid.
    pub fn replace(self, library: &Library, rig: &RigSpec) -> Result<(), RunError> {
        let (text, file) = (library.to_json(), self.out.display().to_string());
        fitting(Library::from_json(&text, &file)?, &file, rig)?;
        write_whole(&self.draft, &self.out, text.as_bytes()).map_err(|error| RunError::write(&self.out, &error))
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

    #[test]
    fn library_of_a_rig_is_read_only_where_it_fits() {
        let file = Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../../configs/rigs/upm-2.json"));
        let rig = RigSpec::load(file).unwrap();
        assert_eq!(rig_library(&rig).unwrap().rig, "upm-2");
        let unnamed = rig_library(&RigSpec::upm_2().unwrap()).unwrap_err();
        assert_eq!(unnamed[0].path, "library");
        let other = RigSpec { fingerprint: "0000000000000000".into(), ..rig };
        let unfit = rig_library(&other).unwrap_err();
        assert!(unfit.iter().any(|fault| fault.path == "fingerprint"), "{unfit:?}");
    }

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
