use std::fmt;

use schemars::JsonSchema;
use serde::de::value::MapAccessDeserializer;
use serde::de::{Error, MapAccess, Visitor};
use serde::{Deserialize, Deserializer, Serialize};

use super::rig_file::RigFile;

/// A rig named by its file or written out.
#[derive(Clone, Debug, PartialEq, Serialize, JsonSchema)]
#[serde(untagged)]
pub enum RigSource {
    /// Path of a rig file, relative to the file it stands in.
    #[schemars(title = "path")]
    File(String),
    /// The rig itself.
    Inline(Box<RigFile>),
}

/// By hand, so that a fault inside the object keeps its place; an untagged enum would lose it.
impl<'de> Deserialize<'de> for RigSource {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct PathOrObject;
        impl<'de> Visitor<'de> for PathOrObject {
            type Value = RigSource;

            fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                f.write_str("a path or a rig object")
            }

            fn visit_str<E: Error>(self, path: &str) -> Result<RigSource, E> {
                Ok(RigSource::File(path.to_owned()))
            }

            fn visit_map<A: MapAccess<'de>>(self, map: A) -> Result<RigSource, A::Error> {
                RigFile::deserialize(MapAccessDeserializer::new(map)).map(|rig| RigSource::Inline(Box::new(rig)))
            }
        }
        deserializer.deserialize_any(PathOrObject)
    }
}
