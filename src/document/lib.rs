//! JSON documents that users write or keep. They are checked against the schema of their type, and every fault is
//! reported with its file, its place, the expected and the found value.

mod duplicates;
mod fault;
mod kind;
mod read;
mod schema_key;
mod shape;

pub use fault::{Fault, FaultClass, Faults, Path, counted, listed, nearest, one_of, quoted, shown};
pub use kind::Document;
pub use read::{MOST_BYTES, parse, parse_and_build, reason, schema_of, text_of};
pub use schema_key::SchemaKey;
