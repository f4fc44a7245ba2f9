use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::rig_file::RigFile;

// faults inside the object are found by its schema, with their places
/// A rig named by its file or written out.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(untagged)]
pub enum RigSource {
    /// Path of a rig file, relative to the file it stands in.
    #[schemars(title = "path")]
    File(String),
    /// The rig itself.
    Inline(Box<RigFile>),
}
