use serde_json::{Value, json};

use super::campaign_file::CampaignFile;
use super::coins::CoinsFile;
use super::daemon_file::DaemonFile;
use super::job_file::JobFile;
use super::rig_changes::RigChanges;
use super::rig_file::RigFile;
use super::simulate::ExperimentFile;
use upm_core::document::schema_of;
use upm_core::signal::RecordedPulse;
use upm_planning::cor_library::Library;

/// Names that [`schema`] accepts.
pub fn schema_names() -> &'static [&'static str] {
    &["job", "rig", "simulate", "library", "trace", "daemon", "coins", "campaign"]
}

/// The JSON Schema (draft 2020-12) of the file called `name`; `None` for other names.
pub fn schema(name: &str) -> Option<Value> {
    let rig_schema = &rig_schema();
    let mut schema = match name {
        "job" => schema_of::<JobFile>(),
        "rig" => rig_schema,
        "simulate" => schema_of::<ExperimentFile>(),
        "library" => schema_of::<Library>(),
        "trace" => schema_of::<RecordedPulse>(),
        "daemon" => schema_of::<DaemonFile>(),
        "coins" => schema_of::<CoinsFile>(),
        "campaign" => schema_of::<CampaignFile>(),
        _ => return None,
    }
    .clone();
    let about = "Path or address of this file's schema, for editors. Nothing else reads it.";
    for file in ["", "/$defs/RigFile", "/$defs/Library", "/anyOf/0", "/anyOf/1"] {
        if let Some(file) = schema.pointer_mut(file).filter(|file| file["properties"].is_object()) {
            file["properties"]["$schema"] = json!({ "description": about, "type": "string" });
        }
    }
    Some(schema)
}

/// The schema of a rig's file: a whole rig, or one that extends another.
fn rig_schema() -> Value {
    let mut forms = [schema_of::<RigFile>(), schema_of::<RigChanges>()].map(Clone::clone);
    let mut take = |key: &str| forms.each_mut().map(|form| form.as_object_mut()?.remove(key))[0].take();
    let mut schema = json!({ "title": "rig", "$schema": take("$schema"), "$defs": take("$defs") });
    schema["description"] = forms[0]["description"].clone();
    schema["anyOf"] = json!(forms);
    schema
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
            let schemas = schemas.iter().map(|schema| schema.pointer("/anyOf/0").unwrap_or(schema));
            let having: Vec<&Value> = schemas.filter(has).collect();
            assert_eq!(having.len(), 1, "{document:?}");
            let is_required = having[0]["required"].as_array().unwrap().iter().any(|key| key == document.key());
            // the tasks of a job may be a list in its place
            assert_eq!(is_required, document != Document::Job, "{document:?}");
        }
    }
}
