use std::sync::Arc;

use serde_json::Value;

use crate::config::{JobSpec, LibraryRef};
use crate::library::{Library, LibraryFault, RigFacts};

/// The COR library a job runs with, checked against its rig.
pub fn job_library(job: &JobSpec) -> Result<Arc<Library>, Vec<LibraryFault>> {
    let library = match &job.library {
        Some(LibraryRef::File(path)) => Library::load(path)?,
        Some(LibraryRef::Inline(members)) => {
            Library::from_json(&Value::Object(members.clone()).to_string(), &format!("{}: library", job.file))?
        }
        None => {
            return Err(vec![LibraryFault {
                file: job.file.clone(),
                path: "library".into(),
                found: "nothing, in the job and in its rig".into(),
                allowed: "a COR library, made by `upm calibrate`".into(),
            }]);
        }
    };
    let model = &job.rig.model;
    let rig = RigFacts {
        name: &model.name,
        fingerprint: &job.rig.fingerprint,
        plate_side_m: model.plate_side_m,
        base_radps: model.base_radps,
        attack_s: model.attack_s,
        rest_s: model.rest_s,
        count_limit: model.count_limit,
    };
    let faults: Vec<LibraryFault> = library.check_fits(&rig).into_iter().map(|fault| in_file(fault, job)).collect();
    if faults.is_empty() { Ok(Arc::new(library)) } else { Err(faults) }
}

/// The fault under the name of the file the library came from.
fn in_file(fault: LibraryFault, job: &JobSpec) -> LibraryFault {
    let file = match &job.library {
        Some(LibraryRef::File(path)) => path.display().to_string(),
        _ => format!("{}: library", job.file),
    };
    LibraryFault { file, ..fault }
}
