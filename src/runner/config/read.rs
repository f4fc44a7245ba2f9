use std::path::{Path as FilePath, PathBuf};

use serde::Serialize;
use serde_json::json;

use upm_core::document::{Diagnostics, Path, quoted};
use upm_core::geometry::Vec2;
use upm_core::units::m_from_mm;

/// Origin of a document: the name for its faults, and the base of its relative paths.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Origin {
    /// Name of the document in faults: the file as the user named it.
    pub file: String,
    /// Folder that its paths are relative to; `None` if it may not name files, as over HTTP.
    pub folder: Option<PathBuf>,
}

impl Origin {
    /// Origin of the file at `path`.
    pub fn of_file(path: &FilePath) -> Self {
        let folder = path.parent().map(FilePath::to_path_buf).unwrap_or_default();
        Self { file: path.display().to_string(), folder: Some(folder) }
    }

    /// Origin of a document without a file, which may not name files.
    pub fn of_request(name: &str) -> Self {
        Self { file: name.to_owned(), folder: None }
    }

    /// Path of the file that the document names `named`.
    pub(super) fn resolve(&self, named: &str) -> Option<PathBuf> {
        self.folder.as_ref().map(|folder| folder.join(named))
    }
    /// Path of the file that the document names `named`, else a fault at `at`.
    pub(super) fn named_file(&self, named: &str, at: &Path, faults: &mut Diagnostics) -> Option<PathBuf> {
        let path = self.resolve(named);
        faults.require(path.is_some(), at, quoted(named), "nothing (files cannot be named here)");
        path
    }
}

/// Pattern of names that [`is_plain_name`] accepts; it does not limit their length.
pub(super) const NAME_PATTERN: &str = "^([.]?[.]?[A-Za-z0-9_-]|[.]{3})[A-Za-z0-9._-]*$";

/// Description of valid names, for messages.
pub(super) const NAMES: &str = "1 to 64 letters, digits, `.`, `_`, `-`, other than `.` and `..`";

/// True for names that are safe as a folder name: 1 to 64 of `A-Z a-z 0-9 . _ -`, not `.` or `..`.
pub fn is_plain_name(name: &str) -> bool {
    let plain = |c: char| c.is_ascii_alphanumeric() || "._-".contains(c);
    (1..=64).contains(&name.len()) && name.chars().all(plain) && name != "." && name != ".."
}

/// A point in metres.
pub(super) fn point_m(mm: [f64; 2]) -> Vec2 {
    Vec2::from(mm.map(m_from_mm))
}

/// Those of `keys` that are present in `object`.
pub(super) fn given<'k>(object: &impl Serialize, keys: &[&'k str]) -> Vec<&'k str> {
    let object = json!(object);
    keys.iter().copied().filter(|key| !object[key].is_null()).collect()
}

/// True if exactly one of `keys` is present in `object`, which is at `at`, else a fault.
pub(super) fn exactly_one(object: &impl Serialize, keys: &[&str], at: &Path, faults: &mut Diagnostics) -> bool {
    let given = given(object, keys);
    let found = if given.is_empty() { "none".to_owned() } else { given.join(" and ") };
    faults.require(given.len() == 1, at, found, format!("exactly one of {}", keys.join(", ")))
}
