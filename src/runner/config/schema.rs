use schemars::{JsonSchema, schema_for};
use serde_json::Value;

use super::{RawDaemon, RawJob, RawRig, RawSimulate, RawTrace};
use upm_library::RawLibrary;

/// Names that [`schema`] knows.
pub fn schema_names() -> &'static [&'static str] {
    &["job", "rig", "simulate", "library", "trace", "daemon"]
}

/// The JSON Schema (draft 2020-12) of the file called `name`, `None` when there is none.
pub fn schema(name: &str) -> Option<Value> {
    match name {
        "job" => Some(of::<RawJob>()),
        "rig" => Some(of::<RawRig>()),
        "simulate" => Some(of::<RawSimulate>()),
        "library" => Some(of::<RawLibrary>()),
        "trace" => Some(of::<RawTrace>()),
        "daemon" => Some(of::<RawDaemon>()),
        _ => None,
    }
}

pub(super) fn of<T: JsonSchema>() -> Value {
    schema_for!(T).to_value()
}
