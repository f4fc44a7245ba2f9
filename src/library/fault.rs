use std::fmt;

/// One thing that is wrong with a library or does not fit the rig: where, what was found, what is allowed.
/// Shown as one line, `FILE: PATH: found X, allowed: Y`.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct LibraryFault {
    /// The file as the person named it.
    pub file: String,
    /// JSON path inside it: `entries[3].spin_rad_s`; `$` for the whole file.
    pub path: String,
    /// What is there.
    pub found: String,
    /// What may be there.
    pub allowed: String,
}

impl LibraryFault {
    pub(super) fn new(path: impl Into<String>, found: impl fmt::Display, allowed: impl Into<String>) -> Self {
        Self { file: String::new(), path: path.into(), found: found.to_string(), allowed: allowed.into() }
    }

    pub(super) fn in_file(self, file: &str) -> Self {
        Self { file: file.to_owned(), ..self }
    }
}

impl fmt::Display for LibraryFault {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}: {}: found {}, allowed: {}", self.file, self.path, self.found, self.allowed)
    }
}

impl std::error::Error for LibraryFault {}
