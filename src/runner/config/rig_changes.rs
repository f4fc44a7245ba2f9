//! A rig file that extends another one: a name and the members that differ.

use std::borrow::Cow;
use std::path::{Path as FilePath, PathBuf};

use schemars::generate::SchemaSettings;
use schemars::{JsonSchema, Schema, SchemaGenerator};
use serde::Deserialize;
use serde_json::{Map, Value, json};

use super::rig_file::RigFile;

/// Key that names the rig to extend.
const EXTENDS: &str = "extends";

/// Most rigs on which a file may build, one through another.
const MOST_BASES: usize = 4;

/// The members of a rig that differ from those of another. Members of objects are merged, `null` removes one (JSON
/// merge patch, RFC 7396).
#[derive(Clone, Debug, Deserialize)]
pub(super) struct RigChanges {
    /// Path of the other rig as written in the file.
    extends: String,
    #[serde(flatten)]
    members: Map<String, Value>,
}

impl JsonSchema for RigChanges {
    fn schema_name() -> Cow<'static, str> {
        "RigChanges".into()
    }

    fn json_schema(_: &mut SchemaGenerator) -> Schema {
        let alone = SchemaSettings::draft2020_12().with(|settings| settings.inline_subschemas = true);
        let mut schema = alone.into_generator().into_root_schema_for::<RigFile>().to_value();
        make_optional(&mut schema);
        let about = "Path of the rig file that this one extends, relative to this file; `.json` may be left out.";
        schema["properties"][EXTENDS] = json!({ "description": about, "type": "string", "title": "path" });
        schema["required"] = json!([EXTENDS, "name"]);
        schema["description"] = json!("A rig as another one, except for the members given here.");
        Schema::try_from(schema).unwrap_or_default()
    }
}

/// Requires no member of the objects in `schema`.
fn make_optional(schema: &mut Value) {
    match schema {
        Value::Object(members) => {
            if members.contains_key("properties") {
                members.remove("required");
            }
            members.values_mut().for_each(make_optional);
        }
        Value::Array(schemas) => schemas.iter_mut().for_each(make_optional),
        _ => {}
    }
}

impl RigChanges {
    /// True if the document in `text` extends another rig.
    pub(super) fn are_in(text: &str) -> bool {
        let value = serde_json::from_str::<Value>(text.trim_start_matches('\u{feff}'));
        value.is_ok_and(|value| value.get(EXTENDS).is_some())
    }

    /// Path of the other rig, with its ending.
    pub(super) fn base(&self) -> String {
        let is_whole = FilePath::new(&self.extends).extension().is_some_and(|ending| ending == "json");
        if is_whole { self.extends.clone() } else { format!("{}.json", self.extends) }
    }

    /// The rig that these changes make of `base`.
    pub(super) fn applied_to(self, mut base: Value) -> Value {
        if let Some(library) = base.get("library").and_then(Value::as_str) {
            base["library"] = rebased(library, &self.extends).into();
        }
        merge(&mut base, self.members.into());
        base
    }
}

/// The path `path` in a file called `file` as seen from where that name stands.
pub(super) fn rebased(path: &str, file: &str) -> String {
    let folder = FilePath::new(file).parent().unwrap_or(FilePath::new(""));
    folder.join(path).to_string_lossy().into_owned()
}

fn merge(target: &mut Value, patch: Value) {
    let Value::Object(members) = patch else { return *target = patch };
    let mut merged = std::mem::take(target).as_object_mut().map(std::mem::take).unwrap_or_default();
    for (key, member) in members {
        if member.is_null() {
            merged.remove(&key);
        } else {
            merge(merged.entry(key).or_insert(Value::Null), member);
        }
    }
    *target = merged.into();
}

/// Files that extend one another, the first of them that of the rig.
#[derive(Clone, Debug, Default)]
pub(super) struct Chain(Vec<PathBuf>);

impl Chain {
    /// The chain with the file at `path`, else the reason why it may not be extended, and what could be.
    pub(super) fn with(&self, path: &FilePath) -> Result<Self, (String, String)> {
        let file = path.canonicalize().unwrap_or(path.to_owned());
        let is_cycle = self.0.contains(&file);
        let chain = Self(self.0.iter().cloned().chain([file]).collect());
        if is_cycle {
            return Err((chain.text(), "a rig that does not extend this one".to_owned()));
        }
        let allowed = || format!("{MOST_BASES} rigs at most, one through another");
        if chain.0.len() > MOST_BASES + 1 { Err((chain.text(), allowed())) } else { Ok(chain) }
    }

    /// `a.json, which extends b.json, which extends a.json`.
    fn text(&self) -> String {
        let names = self.0.iter().map(|file| file.file_name().unwrap_or_default().to_string_lossy());
        names.collect::<Vec<_>>().join(", which extends ")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn merging_is_that_of_rfc_7396() {
        // appendix A
        for (target, patch, merged) in [
            (json!({"a": "b"}), json!({"a": "c"}), json!({"a": "c"})),
            (json!({"a": "b"}), json!({"b": "c"}), json!({"a": "b", "b": "c"})),
            (json!({"a": "b", "b": "c"}), json!({"a": null}), json!({"b": "c"})),
            (json!({"a": ["b"]}), json!({"a": "c"}), json!({"a": "c"})),
            (json!({"a": "c"}), json!({"a": ["b"]}), json!({"a": ["b"]})),
            (json!({"a": {"b": "c"}}), json!({"a": {"b": "d", "c": null}}), json!({"a": {"b": "d"}})),
            (json!({"a": [{"b": "c"}]}), json!({"a": [1]}), json!({"a": [1]})),
            (json!(["a", "b"]), json!(["c", "d"]), json!(["c", "d"])),
            (json!({"a": "b"}), json!(["c"]), json!(["c"])),
            (json!({"a": "foo"}), json!(null), json!(null)),
            (json!({"e": null}), json!({"a": 1}), json!({"e": null, "a": 1})),
            (json!([1, 2]), json!({"a": "b", "c": null}), json!({"a": "b"})),
            (json!({}), json!({"a": {"bb": {"ccc": null}}}), json!({"a": {"bb": {}}})),
        ] {
            let mut found = target.clone();
            merge(&mut found, patch.clone());
            assert_eq!(found, merged, "{target} with {patch}");
        }
    }
}
