use std::borrow::Cow;

use schemars::{JsonSchema, Schema, SchemaGenerator};
use serde::{Deserialize, Deserializer};

/// The key `$schema` of a document, by which an editor finds the schema for completion and checks. Its value is
/// discarded: a document with it equals the same one without it, and neither fingerprints nor `effective.json` contain
/// it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct SchemaKey;

impl<'de> Deserialize<'de> for SchemaKey {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        String::deserialize(deserializer).map(|_| Self)
    }
}

impl JsonSchema for SchemaKey {
    fn inline_schema() -> bool {
        true
    }

    fn schema_name() -> Cow<'static, str> {
        "SchemaKey".into()
    }

    fn json_schema(generator: &mut SchemaGenerator) -> Schema {
        String::json_schema(generator)
    }
}
