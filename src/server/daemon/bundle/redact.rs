//! Redaction for the bundle. Of the configuration only the members listed here keep their text; texts written by people
//! or programs lose paths, passwords and words that look random.

use serde_json::{Map, Value};

/// Replaces each removed text.
pub(super) const REMOVED: &str = "[removed]";

/// Members of the configuration whose text is kept. Numbers and flags are kept everywhere.
const KEPT: [&str; 5] = ["listen", "pace", "default_plate", "name", "start"];

/// Longest run of letters and digits that passes as a plain word.
const LONGEST_PLAIN: usize = 20;

/// The same for a run that mixes digits with small and capital letters.
const LONGEST_MIXED: usize = 9;

/// The same for a run of hex digits with both digits and letters.
const LONGEST_HEX: usize = 7;

/// Words that announce a secret after them.
const ANNOUNCE: [&str; 10] =
    ["password", "passwd", "passphrase", "pwd", "secret", "token", "bearer", "authorization", "api-key", "apikey"];

/// A configuration without paths, tokens and names given by users.
pub(super) fn configuration(value: Value) -> Value {
    allowed(value, false)
}

fn allowed(value: Value, keep_text: bool) -> Value {
    match value {
        Value::String(text) if keep_text => Value::String(scrub(&text)),
        Value::String(_) => Value::String(REMOVED.to_owned()),
        Value::Array(items) => items.into_iter().map(|item| allowed(item, false)).collect(),
        Value::Object(members) => {
            let one = |(key, value): (String, Value)| (member(&key), allowed(value, KEPT.contains(&key.as_str())));
            Value::Object(members.into_iter().map(one).collect::<Map<_, _>>())
        }
        other => other,
    }
}

/// JSON with every text in it scrubbed, member names included.
pub(super) fn scrubbed(value: Value) -> Value {
    match value {
        Value::String(text) => Value::String(scrub(&text)),
        Value::Array(items) => items.into_iter().map(scrubbed).collect(),
        Value::Object(members) => {
            let one = |(key, value): (String, Value)| {
                let value = if announces(&key) { Value::String(REMOVED.to_owned()) } else { scrubbed(value) };
                (member(&key), value)
            };
            Value::Object(members.into_iter().map(one).collect::<Map<_, _>>())
        }
        other => other,
    }
}

/// The name of a member. Names in the program's style are kept; others are scrubbed like any text.
fn member(key: &str) -> String {
    let is_ours = |c: char| c.is_ascii_lowercase() || c.is_ascii_digit() || c == '_';
    if key.chars().all(is_ours) && !key.split('_').any(is_drawn) { key.to_owned() } else { scrub(key) }
}

/// A text without possible secrets. Everything after a word that announces one is cut off.
pub(super) fn scrub(text: &str) -> String {
    let mut kept: Vec<&str> = Vec::new();
    let mut words = text.split(' ').peekable();
    while let Some(word) = words.next() {
        kept.push(if is_odd(word) { REMOVED } else { word });
        if announces(word) && words.peek().is_some() {
            kept.push(REMOVED);
            break;
        }
    }
    kept.join(" ")
}

/// True for a word that announces a secret: `token`, `"Token:"`.
fn announces(word: &str) -> bool {
    let word = word.trim_matches(|c: char| !c.is_alphanumeric()).to_ascii_lowercase().replace('_', "-");
    ANNOUNCE.iter().any(|announcing| word.ends_with(announcing))
}

/// True for a word that may be a secret, hold one (`token=abc`), or be a path.
fn is_odd(word: &str) -> bool {
    let lower = word.to_ascii_lowercase().replace('_', "-");
    let holds = |announcing: &str| {
        let after = lower.split_once(announcing).map_or("", |(_, after)| after);
        after.len() > 1 && !after.starts_with(char::is_alphanumeric)
    };
    let is_path = word.starts_with(['/', '~']) || word.matches('/').count() > 1 || word.contains(['\\', '@']);
    is_path
        || ANNOUNCE.iter().any(|announcing| holds(announcing))
        || word.split(|c: char| !c.is_alphanumeric()).any(is_drawn)
}

/// True for a run of letters and digits that looks random.
fn is_drawn(run: &str) -> bool {
    let has = |of: fn(&char) -> bool| run.chars().any(|c| of(&c));
    let (digit, letter) = (has(char::is_ascii_digit), has(|c| c.is_alphabetic()));
    let mixed = digit && has(char::is_ascii_lowercase) && has(char::is_ascii_uppercase);
    let hex = digit && letter && run.chars().all(|c| c.is_ascii_hexdigit());
    let length = run.chars().count();
    let most = if hex {
        LONGEST_HEX
    } else if mixed {
        LONGEST_MIXED
    } else {
        LONGEST_PLAIN
    };
    length > most
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;
    use serde_json::json;

    use super::*;

    proptest! {
        #[test]
        fn no_long_run_of_letters_and_digits_survives(run in "[A-Za-z0-9]{21,64}", around in "[ -~]{0,20}") {
            let (text, value) = (format!("{around}{run}{around}"), json!({ run.clone(): [around, run] }));
            let left = [scrub(&text), scrubbed(value).to_string()];
            prop_assert!(left.iter().all(|left| !left.contains(&run)), "{left:?}");
        }
    }

    #[test]
    fn ordinary_texts_stay() {
        for text in [
            "two-pennies-and-a-quarter-7-20261122T051400Z",
            "plus-sign-1-20261122T051400Z-2",
            "emergency stop",
            "control came 6 frames late",
            "coin stuck  at the edge, 12.5 mm/s",
            "127.0.0.1:40213",
            "[2001:db8::1]:8750",
            "Ana (night shift)",
            "the disk has 12.5 MB left, jobs are taken from 16.0 MB on",
            "2026-11-22T05:14:00.123456Z",
        ] {
            assert_eq!(scrub(text), text);
        }
    }

    #[test]
    fn secret_looking_words_are_removed() {
        for word in [
            "hIq8Zr0pT3vL5mWn9xYb2cKd7fGj4sAe",
            "0123456789abcdef0123456789abcdef",
            "a3f1c9d2-77aa-41d0-9e0b-5b1f0c2d3e4f",
            "lorem-ipsum-7fKq2mZp9xQw-dolor",
            "password=hunter2",
            "TOKEN:x1y2",
            "api_key=\"abc\"",
            "/etc/upm/token",
            "https://user:pw@example.org/x",
            "C:\\upm\\token",
        ] {
            assert_eq!(scrub(word), REMOVED, "{word}");
            assert!(scrub(&format!("see {word} there")).starts_with(&format!("see {REMOVED} ")));
        }
        assert_eq!(scrub("Authorization: Bearer abc def"), "Authorization: [removed]");
        assert_eq!(scrub("the password is: hunter2"), "the password [removed]");
        assert_eq!(scrub("no token"), "no token");
    }

    #[test]
    fn only_harmless_values_of_a_configuration_are_kept() {
        let given = json!({
            "listen": "127.0.0.1:8750", "data": "../data", "token_file": "my-token", "queue": 64,
            "hosts": ["lab.example.org"], "plates": [{"name": "left", "rig": {"library": "x.json", "side_mm": 203.2}}],
        });
        let kept = json!({
            "listen": "127.0.0.1:8750", "data": REMOVED, "token_file": REMOVED, "queue": 64,
            "hosts": [REMOVED], "plates": [{"name": "left", "rig": {"library": REMOVED, "side_mm": 203.2}}],
        });
        assert_eq!(configuration(given), kept);
    }

    #[test]
    fn json_is_scrubbed_to_its_leaves() {
        let given = json!({"a": [{"text": "see /etc/upm/token"}, 1, null], "Token": {"x": 1}});
        assert_eq!(scrubbed(given), json!({"a": [{"text": "see [removed]"}, 1, null], "Token": REMOVED}));
    }
}
