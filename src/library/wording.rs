//! What serde has to say of a library's shape, in the words of every other fault.

use super::LibraryFault;

/// The fault for serde's `message` about the value at `path`; a dot is the whole file.
pub(super) fn reworded(path: &str, message: &str) -> LibraryFault {
    let path = if path == "." { "" } else { path };
    let here = if path.is_empty() { "$" } else { path };
    let inside = |key: &str| if path.is_empty() { key.to_owned() } else { format!("{path}.{key}") };
    let message = message.rsplit_once(" at line ").map_or(message, |(said, _)| said);
    let quoted = |text: &str| text.split('`').nth(1).unwrap_or_default().to_owned();
    let (found, allowed) = message.split_once(", expected ").unwrap_or((message, "what `upm schema library` prints"));
    match found.split_once(' ') {
        Some(("missing", field)) => {
            let key = quoted(field);
            let meant = if path.starts_with("plate.") { "a number" } else { meant_by(&key) };
            LibraryFault::new(inside(&key), "nothing", meant)
        }
        Some(("unknown", field)) => {
            let keys: Vec<&str> = allowed.split('`').skip(1).step_by(2).collect();
            LibraryFault::new(here, format!("unknown key {:?}", quoted(field)), keys.join(", "))
        }
        Some(("duplicate", field)) => {
            let key = quoted(field);
            LibraryFault::new(inside(&key), format!("the key {key:?} a second time"), "each key once")
        }
        Some(("invalid", rest)) => {
            let found = rest.strip_prefix("length ").map(|length| format!("a list of {length}"));
            LibraryFault::new(here, found.unwrap_or_else(|| shown(rest)), in_words(allowed))
        }
        _ => LibraryFault::new(here, found, allowed),
    }
}

/// The value in `type: string "fast"` or `value: integer `3``.
fn shown(rest: &str) -> String {
    let value = rest.split_once(": ").map_or(rest, |(_, value)| value);
    match value {
        "map" => "an object".to_owned(),
        "sequence" => "a list".to_owned(),
        _ => match (value.split('`').nth(1), value.strip_prefix("string ")) {
            (_, Some(text)) => text.to_owned(),
            (Some(number), None) => number.to_owned(),
            (None, None) => value.to_owned(),
        },
    }
}

/// What a Rust type looks like in the file.
fn in_words(expected: &str) -> String {
    match expected.split_once(" of length ") {
        Some((_, items)) => return format!("a list of {items} items"),
        None if expected.starts_with("fewer elements") => return "fewer items".to_owned(),
        None => {}
    }
    match expected {
        "f64" => "a number",
        "i32" => "a whole number",
        "a sequence" => "a list",
        other if other.starts_with("struct ") => "an object",
        other => other,
    }
    .to_owned()
}

/// What stands under `key`.
fn meant_by(key: &str) -> &'static str {
    match key {
        "rig" | "fingerprint" => "a string",
        "base_hz" | "attack_s" | "rest_s" | "spin_rad_s" | "limit_counts" => "a number",
        "shapes" | "displacement" | "natural_hz" | "damping_ratio" => "an object",
        "amplitudes" => "a list of 4 whole numbers",
        "velocity_mm_s" => "a list of 2 numbers",
        "x" | "y" | "spin" => "a list of 2 lists of 2 numbers",
        "distance_mm" | "sd_mm" => "a list of lists of numbers",
        "entries" => "a list of objects",
        "twist_from_counts" => "a list of matrices of 3 rows of 3 [re, im]",
        _ => "a list of numbers",
    }
}
