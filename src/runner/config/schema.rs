use serde_json::{Value, json};

use super::coins::CoinsFile;
use super::daemon_file::DaemonFile;
use super::job_file::JobFile;
use super::rig_file::RigFile;
use super::simulate::ExperimentFile;
use upm_core::document::schema_of;
use upm_core::signal::RecordedPulse;
use upm_planning::cor_library::Library;

/// Names that [`schema`] accepts.
pub fn schema_names() -> &'static [&'static str] {
    &["job", "rig", "simulate", "library", "trace", "daemon", "coins"]
}

/// The JSON Schema (draft 2020-12) of the file called `name`; `None` for other names.
pub fn schema(name: &str) -> Option<Value> {
    let mut schema = match name {
        "job" => schema_of::<JobFile>(),
        "rig" => schema_of::<RigFile>(),
        "simulate" => schema_of::<ExperimentFile>(),
        "library" => schema_of::<Library>(),
        "trace" => schema_of::<RecordedPulse>(),
        "daemon" => schema_of::<DaemonFile>(),
        "coins" => schema_of::<CoinsFile>(),
        _ => return None,
    }
    .clone();
    let about = "Path or address of this file's schema, for editors. Nothing else reads it.";
    for file in ["", "/$defs/RigFile", "/$defs/Library"] {
        if let Some(file) = schema.pointer_mut(file) {
            file["properties"]["$schema"] = json!({ "description": about, "type": "string" });
        }
    }
    Some(schema)
}

#[cfg(test)]
mod tests {
    use super::*;
    use upm_core::document::Document;

    #[test]
    fn each_kind_of_document_has_its_own_key() {
        let schemas: Vec<Value> = schema_names().iter().map(|name| schema(name).unwrap()).collect();
        assert_eq!(schemas.len(), Document::ALL.len());
        for document in Document::ALL {
            let has = |schema: &&Value| schema["properties"].get(document.key()).is_some();
            let having: Vec<&Value> = schemas.iter().filter(has).collect();
            assert_eq!(having.len(), 1, "{document:?}");
            let is_required = having[0]["required"].as_array().unwrap().iter().any(|key| key == document.key());
            // the tasks of a job may be a list in its place
            assert_eq!(is_required, document != Document::Job, "{document:?}");
        }
    }
}
