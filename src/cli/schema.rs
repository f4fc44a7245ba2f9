use serde_json::Value;

use super::args::SchemaArgs;
use super::offered::schemas;
use super::output::{Failure, print_json};
use upm_recording::{journal_schema, report_schema};
use upm_runner::config;

/// Prints the JSON Schema of a file.
pub(super) fn schema(args: &SchemaArgs) -> Result<u8, Failure> {
    let Some(schema) = named(&args.name) else {
        let names = config::one_of(&args.name, schemas().names());
        return Err(Failure::bad_input(format!("schema: expected {names}, found {:?}", args.name)));
    };
    print_json(&schema)?;
    Ok(0)
}

fn named(name: &str) -> Option<Value> {
    match name {
        "journal" => Some(journal_schema()),
        "report" => Some(report_schema()),
        name => config::schema(name),
    }
}
