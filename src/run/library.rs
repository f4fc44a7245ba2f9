use std::sync::Arc;

use serde_json::Value;

use crate::config::{JobSpec, LibraryRef, RigSpec};
use crate::library::{FieldFacts, Library, LibraryFault, RigFacts};

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
    let file = match &job.library {
        Some(LibraryRef::File(path)) => path.display().to_string(),
        _ => format!("{}: library", job.file),
    };
    let faults = library_faults(&library, &file, &job.rig);
    if faults.is_empty() { Ok(Arc::new(library)) } else { Err(faults) }
}

/// Everything that keeps `library`, read from `file`, from being used on `rig`.
pub fn library_faults(library: &Library, file: &str, rig: &RigSpec) -> Vec<LibraryFault> {
    let model = &rig.model;
    let facts = RigFacts {
        name: &model.name,
        fingerprint: &rig.fingerprint,
        plate_side_m: model.plate_side_m,
        base_radps: model.base_radps,
        attack_s: model.attack_s,
        rest_s: model.rest_s,
        count_limit: model.count_limit,
        fields: model.fields.map(|fields| FieldFacts {
            base_radps: fields.base_radps,
            harmonics: fields.harmonics,
            attack_s: fields.attack_s,
            rest_s: fields.rest_s,
        }),
    };
    let faults = library.check_fits(&facts).into_iter();
    faults.map(|fault| LibraryFault { file: file.to_owned(), ..fault }).collect()
}
