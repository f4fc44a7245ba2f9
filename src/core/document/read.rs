use std::any::TypeId;
use std::collections::BTreeMap;
use std::fs::File;
use std::io::{self, ErrorKind, Read};
use std::path::Path as FilePath;
use std::sync::{Mutex, OnceLock, PoisonError};

use schemars::{JsonSchema, schema_for};
use serde::de::DeserializeOwned;
use serde_json::{Map, Value, json};

use super::diagnostic::{Diagnostic, Diagnostics, Path, nearest};
use super::json_value::value_of;
use super::{Document, schema_check};

/// Largest file that is read, bytes: 1 MiB.
pub const MOST_BYTES: u64 = 1 << 20;

/// The JSON Schema (draft 2020-12) of `T`, made at the first call. Objects have no members but those of their types.
pub fn schema_of<T: JsonSchema + 'static>() -> &'static Value {
    static MADE: Mutex<BTreeMap<TypeId, &'static Value>> = Mutex::new(BTreeMap::new());
    let mut made = MADE.lock().unwrap_or_else(PoisonError::into_inner);
    made.entry(TypeId::of::<T>()).or_insert_with(|| {
        let mut schema = schema_for!(T).to_value();
        close(&mut schema);
        Box::leak(Box::new(schema))
    })
}

/// Refuses unknown members of every object whose members the schema lists.
fn close(schema: &mut Value) {
    match schema {
        Value::Object(members) => {
            if members.contains_key("properties") {
                members.entry("additionalProperties").or_insert(false.into());
            }
            members.values_mut().for_each(close);
        }
        Value::Array(schemas) => schemas.iter_mut().for_each(close),
        _ => {}
    }
}

/// Standard input, once it was read.
static STANDARD_INPUT: OnceLock<Vec<u8>> = OnceLock::new();

/// Largest standard input, bytes: more than any file may have.
const MOST_INPUT_BYTES: u64 = 64 << 20;

/// Reads standard input, which is the file called `-` from then on.
///
/// # Errors
/// Those of reading it.
pub fn read_standard_input() -> io::Result<()> {
    let mut bytes = Vec::new();
    io::stdin().lock().take(MOST_INPUT_BYTES).read_to_end(&mut bytes)?;
    STANDARD_INPUT.get_or_init(|| bytes);
    Ok(())
}

/// The text of the file at `path`, of up to [`MOST_BYTES`], without its byte order mark.
///
/// # Errors
/// As [`text_within`].
pub fn text_of(path: &FilePath) -> Result<String, Vec<Diagnostic>> {
    text_within(path, MOST_BYTES)
}

/// The text of the file at `path`, without its byte order mark.
///
/// # Errors
/// The only fault of a file that cannot be read, is larger than `most` bytes, a number of MiB, or is not UTF-8.
pub fn text_within(path: &FilePath, most: u64) -> Result<String, Vec<Diagnostic>> {
    let fault =
        |found: String, allowed: &str| vec![Diagnostic::new(&path.display().to_string(), Path::root(), found, allowed)];
    let mut bytes = Vec::new();
    // one byte more than is allowed, so that endless files end here, too
    let read = match STANDARD_INPUT.get().filter(|_| path == FilePath::new("-")) {
        Some(given) => given.take(most + 1).read_to_end(&mut bytes),
        None => File::open(path).and_then(|file| file.take(most + 1).read_to_end(&mut bytes)),
    };
    read.map_err(|error| vec![unreadable(path, &error)])?;
    if bytes.len() as u64 > most {
        return Err(fault("a larger file".to_owned(), &format!("up to {} MiB ({most} bytes)", most >> 20)));
    }
    let text = String::from_utf8(bytes).map_err(|error| {
        let valid = error.utf8_error().valid_up_to();
        fault(format!("a byte that is not UTF-8 at offset {valid}"), "UTF-8 text")
    })?;
    Ok(text.strip_prefix('\u{feff}').map(str::to_owned).unwrap_or(text))
}

/// The fault of an unreadable file, with the file in the same folder that was probably meant.
fn unreadable(path: &FilePath, error: &io::Error) -> Diagnostic {
    let meant = (error.kind() == ErrorKind::NotFound).then(|| sibling(path)).flatten();
    let meant = meant.map(|name| format!(" (did you mean {}?)", path.with_file_name(name).display()));
    Diagnostic::unreadable(&path.display().to_string(), reason(error) + &meant.unwrap_or_default())
}

/// The name in the folder of `path` that is nearest to its own.
fn sibling(path: &FilePath) -> Option<String> {
    const MOST_NAMES: usize = 1000;
    let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(FilePath::new("."));
    let entries = std::fs::read_dir(folder).ok()?.take(MOST_NAMES).filter_map(Result::ok);
    let mut names: Vec<String> = entries.filter_map(|entry| entry.file_name().into_string().ok()).collect();
    names.sort();
    nearest(path.file_name()?.to_str()?, names.iter().map(String::as_str)).map(str::to_owned)
}

/// The reason in `error` as reported by the system, in plain words and without its number.
pub fn reason(error: &io::Error) -> String {
    match error.kind() {
        ErrorKind::NotFound => "no such file".to_owned(),
        ErrorKind::PermissionDenied => "permission denied".to_owned(),
        ErrorKind::IsADirectory => "it is a folder".to_owned(),
        ErrorKind::NotADirectory => "a part of its path is not a folder".to_owned(),
        ErrorKind::StorageFull => "the disk is full".to_owned(),
        _ => {
            let text = error.to_string();
            let number = error.raw_os_error().map(|number| format!(" (os error {number})")).unwrap_or_default();
            text.strip_suffix(&number).unwrap_or(&text).to_lowercase()
        }
    }
}

/// Builds the result of `build` from the document in `text`.
///
/// # Errors
/// The faults of [`parse`]; where there are none, every fault that `build` reports.
pub fn parse_and_build<T: DeserializeOwned + JsonSchema + 'static, Made>(
    text: &str,
    file: &str,
    build: impl FnOnce(T, &mut Diagnostics) -> Option<Made>,
) -> Result<Made, Vec<Diagnostic>> {
    let document = parse(text, file)?;
    let mut faults = Diagnostics::of(file);
    let made = build(document, &mut faults);
    faults.into_result(made)
}

/// As [`parse_and_build`], for a `build` that knows what depends on what: where members of the document break its
/// schema, it gets the rest, with their defaults or nothing in their places, and finds more faults.
///
/// # Errors
/// The faults of [`parse`], and every fault that `build` reports.
pub fn parse_and_build_rest<T: DeserializeOwned + JsonSchema + 'static, Made>(
    text: &str,
    file: &str,
    build: impl FnOnce(T, &mut Diagnostics) -> Option<Made>,
) -> Result<Made, Vec<Diagnostic>> {
    let list = match parse(text, file) {
        Ok(document) => {
            let mut faults = Diagnostics::of(file);
            let made = build(document, &mut faults);
            return faults.into_result(made);
        }
        Err(list) => list,
    };
    let Ok(Value::Object(mut members)) = value_of(text, &mut Diagnostics::of(file)) else { return Err(list) };
    let known = &schema_of::<T>()["properties"];
    let mut broken: Vec<String> = list.iter().map(|fault| fault.member().to_owned()).collect();
    let names = || known.as_object().into_iter().flat_map(Map::keys).map(String::as_str);
    let meant: Vec<&str> = broken.iter().filter_map(|name| nearest(name, names())).collect();
    broken.extend(meant.into_iter().map(str::to_owned).collect::<Vec<_>>());
    if !broken.iter().all(|name| members.contains_key(name) || known.get(name).is_some()) {
        return Err(list);
    }
    for name in &broken {
        members.remove(name);
        let empty = match known[name]["type"].as_str() {
            Some("array") => json!([]),
            Some("string") => json!(""),
            _ => continue,
        };
        members.insert(name.clone(), empty);
    }
    let mut faults = Diagnostics::of(file);
    faults.append(list);
    faults.broken = broken;
    if let Ok(rest) = serde_json::from_value(Value::Object(members)) {
        build(rest, &mut faults);
    }
    Err(faults.into_list())
}

/// Parses the document in `text`. It is checked against its schema for all faults of keys, types and ranges at once,
/// then read by serde for rules that a schema cannot express.
///
/// # Errors
/// Text that is not JSON and a document of another kind yield that single fault. Otherwise every key that is there
/// twice and every fault against the schema; once there are none, the first fault that serde finds.
pub fn parse<T: DeserializeOwned + JsonSchema + 'static>(text: &str, file: &str) -> Result<T, Vec<Diagnostic>> {
    let mut faults = Diagnostics::of(file);
    let value = value_of(text, &mut faults).map_err(|error| vec![Diagnostic::syntax(file, &error)])?;
    read(&value, file, faults)
}

/// As [`parse`], for text that was parsed before, with the faults found in it so far.
///
/// # Errors
/// As [`parse`].
pub fn read<T: DeserializeOwned + JsonSchema + 'static>(
    value: &Value,
    file: &str,
    mut faults: Diagnostics,
) -> Result<T, Vec<Diagnostic>> {
    let schema = schema_of::<T>();
    if let Some((wanted, found)) = Document::mistaken(value, schema) {
        let found = format!("{}, for `{}`", found.name(), found.command());
        return Err(vec![Diagnostic::new(file, Path::root(), found, wanted.name())]);
    }
    schema_check::check(value, schema, &Path::root(), &mut faults);
    if !faults.is_empty() {
        return Err(faults.into_list());
    }
    serde_path_to_error::deserialize(value).map_err(|error| {
        let path = Some(error.path().to_string()).filter(|path| path != ".").unwrap_or("$".to_owned());
        vec![Diagnostic::new(file, path, error.inner(), "what `upm schema` prints")]
    })
}
