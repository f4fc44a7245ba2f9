use std::fs::File;
use std::io::{self, Read};
use std::path::{Path as FilePath, PathBuf};

use schemars::JsonSchema;
use serde::de::DeserializeOwned;
use serde_json::Value;

use super::document::Document;
use super::fault::{Fault, Faults, Path};
use super::{schema, shape};

/// Largest file read, bytes: 1 MiB.
pub const MOST_BYTES: u64 = 1 << 20;

/// Where a document comes from.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Origin {
    /// What faults call it: the file as the person named it.
    pub file: String,
    /// Folder that paths in it are relative to; `None` where files may not be named, as over HTTP.
    pub folder: Option<PathBuf>,
}

impl Origin {
    /// The file at `path`.
    pub fn of_file(path: &FilePath) -> Self {
        let folder = path.parent().map(FilePath::to_path_buf).unwrap_or_default();
        Self { file: path.display().to_string(), folder: Some(folder) }
    }

    /// A document that came without a file and may name none.
    pub fn of_request(name: &str) -> Self {
        Self { file: name.to_owned(), folder: None }
    }

    /// The file that the document calls `named`.
    pub(super) fn resolve(&self, named: &str) -> Option<PathBuf> {
        self.folder.as_ref().map(|folder| folder.join(named))
    }
}

/// The text of the file at `path`, or the one fault that keeps it from being read.
pub(super) fn text_of(path: &FilePath) -> Result<String, Fault> {
    let fault = |found: String, allowed: &str| Fault::new(&path.display().to_string(), &Path::root(), found, allowed);
    let bytes = bytes_of(path).map_err(|error| fault(error.to_string(), "a file that can be read"))?;
    if bytes.len() as u64 > MOST_BYTES {
        return Err(fault("a larger file".to_owned(), "up to 1 MiB (1048576 bytes)"));
    }
    String::from_utf8(bytes).map_err(|error| {
        let valid = error.utf8_error().valid_up_to();
        fault(format!("a byte that is not UTF-8 at offset {valid}"), "UTF-8 text")
    })
}

/// At most one byte more than is allowed, so that endless files end here too.
fn bytes_of(path: &FilePath) -> io::Result<Vec<u8>> {
    let mut bytes = Vec::new();
    File::open(path)?.take(MOST_BYTES + 1).read_to_end(&mut bytes)?;
    Ok(bytes)
}

/// The document in `text`: held against its schema for all faults of keys, types and ranges at once, then read
/// by serde for what a schema cannot say, such as a key that stands twice. A file of another kind has that one fault.
pub(super) fn parse<T: DeserializeOwned + JsonSchema>(text: &str, file: &str) -> Result<T, Vec<Fault>> {
    let mut faults = Faults::of(file);
    let value: Value = match serde_json::from_str(text) {
        Ok(value) => value,
        Err(error) => {
            faults.push(&Path::root(), error.to_string(), "JSON, nested at most 127 deep, numbers within 64 bits");
            return Err(faults.into_list());
        }
    };
    let schema = schema::of::<T>();
    match Document::mistaken(&value, &schema) {
        Some((wanted, found)) => faults.push(&Path::root(), found.name(), wanted.name()),
        None => shape::check(&value, &schema, &Path::root(), &mut faults),
    }
    if faults.len() > 0 {
        return Err(faults.into_list());
    }
    let made = serde_path_to_error::deserialize(&mut serde_json::Deserializer::from_str(text));
    made.map_err(|error| {
        let path = Some(error.path().to_string()).filter(|path| path != ".").unwrap_or("$".to_owned());
        let (file, found) = (file.to_owned(), error.inner().to_string());
        vec![Fault { file, path, found, allowed: "what `upm schema` prints, each key once".to_owned() }]
    })
}
