//! JSON documents that people write or keep: read against the schema of their type, and every fault told with its file,
//! its place, what is expected and what was found.

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
