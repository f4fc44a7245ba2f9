use std::sync::Arc;

use serde_json::Value;

use crate::config::{JobSpec, LibraryRef};
use crate::library::{Library, LibraryFault};

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
    library.check_fits(&job.rig.model.name, &job.rig.fingerprint).map_err(|fault| {
        let file = match &job.library {
            Some(LibraryRef::File(path)) => path.display().to_string(),
            _ => fault.file,
        };
        vec![LibraryFault { file, ..fault }]
    })?;
    Ok(Arc::new(library))
}
