use std::fmt;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use serde_json::Value;
use serde_json::error::Category;

/// Largest number of faults listed for one file; a file with more usually repeats one mistake.
const MOST_DIAGNOSTICS: usize = 200;

/// The path of a whole document.
const WHOLE: &str = "$";

/// Longest value shown in a fault, characters.
const LONGEST_SHOWN: usize = 60;

/// A fault in a file. Displays as one line: `configs/x.json: parts[1].kind: expected one of penny, nickel, dime,
/// quarter (did you mean penny?), found "pennyy"`.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[schemars(rename = "ProblemFault")]
pub struct Diagnostic {
    /// The file as the user named it; on the network it is the request.
    #[serde(skip)]
    pub file: Box<str>,
    /// Its place in the file: `parts[1].position_mm[0]`, `$` for the whole.
    pub path: String,
    /// The value found there.
    pub found: String,
    /// The values allowed there.
    #[serde(rename = "allowed")]
    pub expected: String,
    /// Where the text stops being JSON; absent where it is JSON.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub position: Option<TextPosition>,
    /// Kind of the fault.
    #[serde(skip)]
    pub class: DiagnosticClass,
    /// The key of another file that names this one: `rig upm-1.json: library`.
    #[serde(skip)]
    pub named_by: Option<Box<str>>,
}

/// A place in a text.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub struct TextPosition {
    /// Line, from 1.
    pub line: u32,
    /// Column of the last byte read, from 1; 0 before the first.
    pub column: u32,
}

/// Kind of a fault.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum DiagnosticClass {
    /// A value that is not allowed.
    #[default]
    Value,
    /// A required value is missing.
    Missing,
    /// The file cannot be read.
    Unreadable,
    /// The text is not valid JSON.
    Syntax,
}

impl Diagnostic {
    /// A fault of class [`DiagnosticClass::Value`].
    pub fn new(file: &str, path: impl fmt::Display, found: impl fmt::Display, expected: impl Into<String>) -> Self {
        let (file, path, found) = (file.into(), path.to_string(), found.to_string());
        Self { file, path, found, expected: expected.into(), ..Self::default() }
    }

    /// The same fault in the file `file`.
    pub fn in_file(self, file: &str) -> Self {
        Self { file: file.into(), ..self }
    }

    /// The fault of the missing member at `path`.
    pub fn missing(file: &str, path: impl fmt::Display, expected: impl Into<String>) -> Self {
        Self { class: DiagnosticClass::Missing, ..Self::new(file, path, "nothing", expected) }
    }

    /// The fault of a file that cannot be read, for this reason.
    pub fn unreadable(file: &str, reason: impl fmt::Display) -> Self {
        Self { class: DiagnosticClass::Unreadable, ..Self::new(file, Path::root(), reason, "a file that can be read") }
    }

    /// The fault of a text that is not valid JSON.
    pub fn syntax(file: &str, error: &serde_json::Error) -> Self {
        let expected = "JSON, nested at most 127 deep, with numbers within 64 bits";
        let counted = |place: usize| u32::try_from(place).unwrap_or(u32::MAX);
        let position = Some(TextPosition { line: counted(error.line()), column: counted(error.column()) });
        let found = match error.classify() {
            Category::Eof if error.column() == 0 && error.line() == 1 => "an empty file".to_owned(),
            Category::Eof => format!("the end of the file: {error}"),
            _ => format!("a mistake: {error}"),
        };
        Self { class: DiagnosticClass::Syntax, position, ..Self::new(file, Path::root(), found, expected) }
    }

    /// The member of the document that the fault is in: `parts` of `parts[1].kind`.
    pub(super) fn member(&self) -> &str {
        self.path.split(['.', '[']).next().unwrap_or_default()
    }

    /// The same fault with the key that names its file: `rig upm-1.json: library`.
    pub fn named_by(self, key: &str) -> Self {
        Self { named_by: Some(key.into()), ..self }
    }
}

impl fmt::Display for Diagnostic {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { file, path, found, expected, class, named_by, .. } = self;
        let naming = named_by.as_ref().map(|key| format!("{key}: ")).unwrap_or_default();
        let line = match class {
            DiagnosticClass::Unreadable => format!("{naming}cannot read {file}: {found}"),
            DiagnosticClass::Syntax => format!("{naming}{file}: expected JSON, found {found}"),
            DiagnosticClass::Value | DiagnosticClass::Missing => {
                let at = Some(path).filter(|path| *path != WHOLE).map(|path| format!("{path}: ")).unwrap_or_default();
                format!("{naming}{file}: {at}expected {expected}, found {found}")
            }
        };
        let is_mark = |c| matches!(c, '\u{200b}'..='\u{200f}' | '\u{202a}'..='\u{202e}' | '\u{2066}'..='\u{2069}');
        for c in line.chars() {
            if c.is_control() || is_mark(c) { write!(f, "{}", c.escape_default())? } else { write!(f, "{c}")? }
        }
        Ok(())
    }
}

impl std::error::Error for Diagnostic {}

/// Path of a value in a JSON document.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Path(String);

impl Path {
    /// The path of the whole document.
    pub fn root() -> Self {
        Self::default()
    }

    /// The path of member `key` of this object.
    pub fn key(&self, key: &str) -> Self {
        let plain = !key.is_empty() && key.chars().all(|c| c.is_ascii_alphanumeric() || "_-".contains(c));
        match (plain, self.0.is_empty()) {
            (false, _) => Self(format!("{}[{}]", self.0, quoted(key))),
            (true, true) => Self(key.to_owned()),
            (true, false) => Self(format!("{}.{key}", self.0)),
        }
    }

    /// The path of item `i` of this list.
    pub fn index(&self, i: usize) -> Self {
        Self(format!("{}[{i}]", self.0))
    }
}

impl fmt::Display for Path {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(if self.0.is_empty() { WHOLE } else { &self.0 })
    }
}

/// The faults of one file, in the order in which they were found.
#[derive(Debug)]
pub struct Diagnostics {
    file: String,
    list: Vec<Diagnostic>,
    /// Members of the document that break its schema: further faults in them would be consequences.
    pub(super) broken: Vec<String>,
}

impl Diagnostics {
    /// An empty list for the file `file`.
    pub fn of(file: &str) -> Self {
        Self { file: file.to_owned(), list: Vec::new(), broken: Vec::new() }
    }

    /// True if none of these members of the document breaks its schema.
    pub fn are_sound(&self, members: &[&str]) -> bool {
        !members.iter().any(|member| self.broken.iter().any(|broken| broken == member))
    }

    /// Adds a fault at `path`.
    pub fn push(&mut self, path: impl fmt::Display, found: impl fmt::Display, expected: impl Into<String>) {
        self.append_own(Diagnostic::new(&self.file, path, found, expected));
    }

    /// Adds a fault for the missing member at `path`.
    pub fn push_missing(&mut self, path: impl fmt::Display, expected: impl Into<String>) {
        self.append_own(Diagnostic::missing(&self.file, path, expected));
    }

    fn append_own(&mut self, fault: Diagnostic) {
        if self.are_sound(&[fault.member()]) {
            self.append(vec![fault]);
        }
    }

    /// Appends the faults found in another file.
    pub fn append(&mut self, others: Vec<Diagnostic>) {
        self.list.extend(others);
        self.list.truncate(MOST_DIAGNOSTICS);
    }

    /// Appends the faults of a file that the key `named_by` names.
    pub fn append_named(&mut self, others: Vec<Diagnostic>, named_by: &str) {
        self.append(others.into_iter().map(|fault| fault.named_by(named_by)).collect());
    }

    /// Adds a fault at `path` unless `holds`, which it returns.
    pub fn require(
        &mut self,
        holds: bool,
        path: impl fmt::Display,
        found: impl fmt::Display,
        expected: impl Into<String>,
    ) -> bool {
        if !holds {
            self.push(path, found, expected);
        }
        holds
    }

    /// Number of faults.
    pub fn len(&self) -> usize {
        self.list.len()
    }

    /// True without faults.
    pub fn is_empty(&self) -> bool {
        self.list.is_empty()
    }

    /// `made` when there are no faults, otherwise all faults.
    pub fn into_result<T>(self, made: Option<T>) -> Result<T, Vec<Diagnostic>> {
        match made {
            Some(made) if self.list.is_empty() => Ok(made),
            _ => Err(self.list),
        }
    }

    /// All faults, in the order in which they were found.
    pub fn into_list(self) -> Vec<Diagnostic> {
        self.list
    }
}

/// A JSON value as shown in a fault, shortened to 60 characters.
pub fn shown(value: &Value) -> String {
    let text = value.to_string();
    match value {
        Value::Object(_) => "an object".to_owned(),
        Value::Array(items) if text.len() > LONGEST_SHOWN => format!("a list of {}", items.len()),
        _ if text.len() > LONGEST_SHOWN => text.chars().take(LONGEST_SHOWN).chain(['…']).collect(),
        _ => text,
    }
}

/// A text as a fault shows it; see [`shown`].
pub fn quoted(text: &str) -> String {
    shown(&Value::from(text))
}

/// A number with its noun: `1 part`, `2 parts`.
pub fn counted(number: usize, what: &str) -> String {
    format!("{number} {what}{}", if number == 1 { "" } else { "s" })
}

/// `one of a, b, c`, followed by the choice that `found` was probably meant to be.
pub fn one_of(found: &str, choices: &[&str]) -> String {
    let meant = nearest(found, choices.iter().copied()).map(|meant| format!(" (did you mean {meant}?)"));
    listed(choices) + &meant.unwrap_or_default()
}

/// `one of a, b, c`; a single choice alone.
pub fn listed(choices: &[&str]) -> String {
    let list = choices.join(", ");
    if choices.len() == 1 { list } else { format!("one of {list}") }
}

/// The choice that `found` was probably meant to be, the first of equally near ones.
pub fn nearest<'a>(found: &str, choices: impl Iterator<Item = &'a str>) -> Option<&'a str> {
    let distance = |choice: &str| strsim::damerau_levenshtein(found, choice);
    let rated = choices.filter(|_| found.len() <= LONGEST_SHOWN).map(|choice| (distance(choice), choice));
    let near = rated.filter(|(distance, choice)| *distance <= 1 + choice.len() / 4);
    near.min_by_key(|(distance, _)| *distance).map(|(_, choice)| choice)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_fault_is_one_line() {
        let path = Path::root().key("parts").index(1).key("kind");
        let fault =
            Diagnostic::new("configs/x.json", &path, "\"pennyy\"", one_of("pennyy", &["penny", "nickel", "dime"]));
        let line = r#"configs/x.json: parts[1].kind: expected one of penny, nickel, dime (did you mean penny?), found "pennyy""#;
        assert_eq!(fault.to_string(), line);
        let odd = Diagnostic::new("a\nb.json", Path::root().key("we\nird key"), "x\r\n", "y");
        assert_eq!(odd.to_string(), r#"a\nb.json: ["we\nird key"]: expected y, found x\r\n"#);
        assert_eq!(Path::root().to_string(), "$");
        let unread = Diagnostic::unreadable("l.json", "no such file").named_by("rig r.json: library");
        assert_eq!(unread.to_string(), "rig r.json: library: cannot read l.json: no such file");
    }

    #[test]
    fn invalid_json_is_reported_with_place_and_reason() {
        let found = |text: &str| {
            let error = serde_json::from_str::<Value>(text).unwrap_err();
            Diagnostic::syntax("x.json", &error).to_string()
        };
        assert_eq!(found(""), "x.json: expected JSON, found an empty file");
        let cut = "found the end of the file: EOF while parsing an object at line 2 column 11";
        assert_eq!(found("{\n  \"seed\": 3"), format!("x.json: expected JSON, {cut}"));
        let extra = "found a mistake: trailing characters at line 1 column 4";
        assert_eq!(found("{} x"), format!("x.json: expected JSON, {extra}"));
        let error = serde_json::from_str::<Value>("{\n  \"seed\": 3").unwrap_err();
        let placed = serde_json::to_value(Diagnostic::syntax("x.json", &error)).unwrap();
        assert_eq!(placed["position"], serde_json::json!({"line": 2, "column": 11}));
    }

    #[test]
    fn only_near_words_are_proposed() {
        assert_eq!(
            one_of("toleranc_mm", &["seed", "tolerance_mm"]),
            "one of seed, tolerance_mm (did you mean tolerance_mm?)"
        );
        assert_eq!(one_of("zebra", &["seed", "tolerance_mm"]), "one of seed, tolerance_mm");
        assert_eq!(one_of(&"x".repeat(1 << 20), &["seed"]), "seed");
    }

    #[test]
    fn long_values_are_cut() {
        assert_eq!(shown(&Value::from("é".repeat(1000))).chars().count(), LONGEST_SHOWN + 1);
        assert_eq!(shown(&Value::from(vec![1; 1000])), "a list of 1000");
        assert_eq!(shown(&Value::from(vec![1, 2])), "[1,2]");
    }
}
