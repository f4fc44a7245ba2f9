//! JSON documents that people write or keep: read against the schema of their type, and every fault told with its file,
//! its place, what was found and what is allowed.

mod duplicates;
mod fault;
mod kind;
mod read;
mod shape;

pub use fault::{Fault, Faults, Path, counted, one_of, quoted, shown};
pub use kind::Document;
pub use read::{MOST_BYTES, parse, parse_and_build, schema_of, text_of};
