use std::path::Path;
use std::sync::Arc;

use serde_json::Value;

use crate::config::{Diagnostic, DiagnosticClass, JobSpec, LibraryRef, RigSpec, place_parts};
use upm_core::random::Streams;
use upm_planning::cor_library::Library;

/// Reads the COR library of a job and checks it against the job's rig.
pub fn job_library(job: &JobSpec) -> Result<Arc<Library>, Vec<Diagnostic>> {
    match &job.library {
        Some(LibraryRef::File(path)) => load_library(path, &job.library_key(), &job.rig),
        Some(LibraryRef::Inline(members)) => {
            let file = format!("{}: library", job.file);
            fitting(Library::from_json(&Value::Object(members.clone()).to_string(), &file)?, &file, &job.rig)
        }
        None => {
            let found = "nothing, in the job and in its rig";
            Err(vec![Diagnostic::new(&job.file, "library", found, "a COR library, made by `upm calibrate`")])
        }
    }
}

/// Reads the COR library that `rig` names and checks it against the rig.
pub fn rig_library(rig: &RigSpec) -> Result<Arc<Library>, Vec<Diagnostic>> {
    let Some(path) = &rig.library else {
        return Err(vec![Diagnostic::new(
            &rig.model.name,
            "library",
            "nothing",
            "a COR library, made by `upm calibrate`",
        )]);
    };
    load_library(path, &format!("rig {}: library", rig.model.name), rig)
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

/// All reasons why `library`, read from `file`, cannot be used on `rig`.
pub fn library_faults(library: &Library, file: &str, rig: &RigSpec) -> Vec<Diagnostic> {
    let faults = library.check_fits(&rig.model, &rig.fingerprint).into_iter();
    faults.map(|fault| fault.in_file(file)).collect()
}

#[cfg(test)]
mod tests {
    use std::path::Path;

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
}
