//! Jobs whose numbers are changed at random are taken, or refused in words.

use proptest::prelude::*;
use serde_json::{Value, json};
use tempfile::TempDir;

use super::{shipped, upm};

/// JSON pointers of all numbers in a document.
fn numbers(document: &Value, at: &str, out: &mut Vec<String>) {
    match document {
        Value::Number(_) => out.push(at.to_owned()),
        Value::Array(items) => items.iter().enumerate().for_each(|(i, item)| numbers(item, &format!("{at}/{i}"), out)),
        Value::Object(members) => members.iter().for_each(|(key, member)| numbers(member, &format!("{at}/{key}"), out)),
        _ => {}
    }
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 48, failure_persistence: None, ..ProptestConfig::default() })]

    /// A job whose numbers are changed at random is valid or has faults of one line each.
    #[test]
    fn other_numbers_are_taken_or_refused_in_words(
        which in 0..5_usize,
        changes in proptest::collection::vec((any::<prop::sample::Index>(), prop_oneof![-200.0..200.0f64, -3.0..9.0f64, any::<f64>()]), 1..4),
    ) {
        let folder = TempDir::new().unwrap();
        let name = ["arrange-8", "sort-8", "sort-12", "ring-6", "bowtie-3"][which];
        let file = shipped(folder.path(), name, |job| {
            let mut all = Vec::new();
            numbers(job, "", &mut all);
            for (index, value) in changes {
                let whole = value.fract() == 0.0 && value.abs() < 1e9;
                *job.pointer_mut(index.get(&all[..]).as_str()).unwrap() = if whole { json!(value as i64) } else { json!(value) };
            }
        });
        let output = upm().args(["check", file.to_str().unwrap()]).output().unwrap();
        let stderr = String::from_utf8(output.stderr).unwrap();
        prop_assert!(matches!(output.status.code(), Some(0 | 2)), "{stderr}");
        // a warning about a tolerance finer than the rig can hold is not a refusal
        let is_refused = stderr.lines().any(|line| !line.starts_with("upm: warning: "));
        prop_assert_eq!(output.status.code() == Some(2), is_refused, "{}", stderr);
        prop_assert!(stderr.lines().all(|line| line.contains(": expected ") && line.contains(", found ")), "{stderr}");
    }
}
