use std::path::{Path as FilePath, PathBuf};

use serde::Serialize;
use serde_json::json;

use upm_core::document::{Diagnostics, Path, quoted};
use upm_core::geometry::Vec2;
use upm_core::units::{file_form, m_from_mm, written_mm};

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
    pub(crate) fn named_file(&self, named: &str, at: &Path, faults: &mut Diagnostics) -> Option<PathBuf> {
        let path = self.resolve(named);
        faults.require(path.is_some(), at, quoted(named), "nothing (files cannot be named here)");
        path
    }
}

/// Description of valid names, for messages.
pub(super) const NAMES: &str = "1 to 64 letters, digits, `.`, `_`, `-`, the first neither `.` nor `-`";

/// Pattern of valid names in schemas, which [`is_name`] follows. It bars ASCII marks, controls, spaces and invisible
/// characters, since not every dialect of patterns knows letters of all scripts.
pub(super) const NAME_PATTERN: &str = concat!(
    r"^[^\u0000-/:-@\[-\^`{-\u00a0\u061c\u2000-\u206f\u3000\ufeff\ufff0-\uffff]",
    r"[^\u0000-,/:-@\[-\^`{-\u00a0\u061c\u2000-\u206f\u3000\ufeff\ufff0-\uffff]*$"
);
/// The same for [`is_plain_name`].
pub(super) const PLAIN_NAME_PATTERN: &str = "^[A-Za-z0-9_][A-Za-z0-9._-]*$";
/// Pattern of paths of such names.
pub(super) const BASE_PATH_PATTERN: &str = "^(/[A-Za-z0-9_][A-Za-z0-9._-]{0,63})+$";

/// True for names of letters and digits of any script, `.`, `_` and `-` that are safe as a folder name.
pub(super) fn is_name(name: &str) -> bool {
    let is_allowed = |c: char| match c {
        '\0'..='\u{7f}' => c.is_ascii_alphanumeric() || "._-".contains(c),
        '\u{80}'..='\u{a0}' | '\u{61c}' | '\u{2000}'..='\u{206f}' | '\u{3000}' | '\u{feff}' => false,
        _ => !('\u{fff0}'..='\u{ffff}').contains(&c),
    };
    (1..=64).contains(&name.chars().count()) && !name.starts_with(['.', '-']) && name.chars().all(is_allowed)
}

/// True for names that are safe in addresses, too: those of ASCII.
pub fn is_plain_name(name: &str) -> bool {
    name.is_ascii() && is_name(name)
}

fn written_point_mm(m: &Vec2) -> [f64; 2] {
    [m.x, m.y].map(written_mm)
}

file_form!(optional_mm: Option<f64> => Option<f64>, |mm| mm.map(m_from_mm), |m| m.map(written_mm));
file_form!(optional_mm_point: Option<[f64; 2]> => Option<Vec2>, |mm| mm.map(|mm| mm.map(m_from_mm).into()),
    |m| m.as_ref().map(written_point_mm));
file_form!(optional_mm_points: Option<Vec<[f64; 2]>> => Option<Vec<Vec2>>,
    |mm| mm.map(|places| places.into_iter().map(|mm| mm.map(m_from_mm).into()).collect()),
    |m| m.as_ref().map(|places| places.iter().map(written_point_mm).collect()));

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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_have_letters_of_any_script_and_are_safe_as_file_names() {
        let (many, too_many) = ("𞤀".repeat(64), "a".repeat(65));
        for name in ["größe-1", "名前", "हिन्दी", "тест.2", "_", "7", many.as_str()] {
            assert!(is_name(name), "{name}");
        }
        let bad =
            ["", ".", "..", ".a", "-a", "a b", "a/b", "a\\b", "a:b", "a\n", "a\u{202e}b", "a\u{a0}b", "\u{feff}a"];
        for name in bad.into_iter().chain([too_many.as_str()]) {
            assert!(!is_name(name), "{name:?}");
        }
        assert!(is_plain_name("plate.1-a_B") && !is_plain_name("größe"));
    }
}
