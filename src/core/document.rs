//! JSON documents that users write or keep. They are checked against the schema of their type, and every fault is
//! reported with its file, its place, the expected and the found value.

mod diagnostic;
mod file_kind;
mod json_value;
mod read;
mod schema_check;

pub use diagnostic::{
    Diagnostic, DiagnosticClass, Diagnostics, Path, TextPosition, counted, listed, nearest, one_of, quoted, shown,
};
pub use file_kind::Document;
pub use json_value::pretty;
pub use read::{
    MOST_BYTES, parse, parse_and_build, parse_and_build_rest, read, read_standard_input, reason, schema_of, text_of,
    text_within,
};
