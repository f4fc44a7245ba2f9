use super::args::SchemaArgs;
use super::output::{Failure, print_json};
use upm_recording::{journal_schema, report_schema};
use upm_runner::config;

/// Prints the JSON Schema of a file.
pub(super) fn schema(args: &SchemaArgs) -> Result<u8, Failure> {
    let schema = match args.name.as_str() {
        "journal" => Some(journal_schema()),
        "report" => Some(report_schema()),
        name => config::schema(name),
    };
    print_json(&schema)?;
    Ok(0)
}
