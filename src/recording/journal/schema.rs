use schemars::generate::SchemaSettings;
use serde_json::Value;

use super::lines::JournalLine;

/// The JSON Schema (draft 2020-12) of one line of `journal.jsonl`.
pub fn journal_schema() -> Value {
    // a schema for serialisation: nothing reads a line back into these types
    let generator = SchemaSettings::draft2020_12().for_serialize().into_generator();
    generator.into_root_schema_for::<JournalLine<'static>>().to_value()
}
