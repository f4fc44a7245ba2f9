//! Patterns that comments leave out, and the width of their lines: the part of the house's rules that a program can
//! see.
#![allow(clippy::unwrap_used, clippy::panic)] // a test that cannot go on shall say so

use std::fs;
use std::path::{Path, PathBuf};

/// Columns of a comment line.
const WIDEST: usize = 120;

/// Words that a comment does not begin a sentence with: the first sentence names the item.
const NO_SUBJECTS: [&str; 4] = ["What", "Who", "Whoever", "Whatever"];

/// Phrases with a plainer equivalent.
const NO_PHRASES: [&str; 6] = ["but for", "as yet", "of late", "somebody", "nobody", "whoever"];

/// Rust sources and scripts in `folder` and below.
fn sources(folder: &Path, files: &mut Vec<PathBuf>) {
    for entry in fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        if path.is_dir() {
            sources(&path, files);
        } else if path.extension().is_some_and(|extension| extension == "rs" || extension == "js") {
            files.push(path);
        }
    }
}

/// The words of a comment line of Rust or of a script; `None` for a line of code.
fn comment(line: &str) -> Option<&str> {
    let line = line.trim_start();
    let rest = line.strip_prefix("//").or_else(|| line.strip_prefix("/**"))?;
    Some(rest.trim_start_matches(['/', '!']).trim_start())
}

/// True when `phrase` stands in `words` with no letter beside it.
fn has_phrase(words: &str, phrase: &str) -> bool {
    let is_letter = |c: Option<char>| c.is_some_and(char::is_alphanumeric);
    words.match_indices(phrase).any(|(at, _)| {
        let (before, after) = (&words[..at], &words[at + phrase.len()..]);
        !is_letter(before.chars().next_back()) && !is_letter(after.chars().next())
    })
}

/// The rule that a comment line breaks.
fn broken_rule(line: &str) -> Option<String> {
    let words = comment(line)?;
    let lower = words.to_lowercase();
    let firsts = words.split(". ").filter_map(|sentence| sentence.split(|c: char| !c.is_alphanumeric()).next());
    if let Some(first) = firsts.into_iter().find(|first| NO_SUBJECTS.contains(first)) {
        return Some(format!("begins a sentence with {first}"));
    }
    if let Some(phrase) = NO_PHRASES.iter().find(|phrase| has_phrase(&lower, phrase)) {
        return Some(format!("says {phrase:?}"));
    }
    let width = line.chars().count();
    (width > WIDEST).then(|| format!("has {width} columns"))
}

#[test]
fn broken_rules_are_found_and_others_are_not() {
    assert_eq!(broken_rule("    /// What a person sees.").as_deref(), Some("begins a sentence with What"));
    assert!(broken_rule("  /** Ages. Whoever asks again. */").is_some_and(|rule| rule.ends_with("Whoever")));
    assert_eq!(broken_rule("//! Rests, but for a swing.").as_deref(), Some("says \"but for\""));
    assert_eq!(broken_rule(&format!("// {}", "x ".repeat(60))).as_deref(), Some("has 123 columns"));
    for fine in ["let what = \"What\";", "/// Whole frames.", "// whatever the seed", "/// A tribute forever."] {
        assert_eq!(broken_rule(fine), None, "{fine}");
    }
}

#[test]
fn comments_keep_the_rules_that_a_program_can_see() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let mut files = vec![root.join("build.rs")];
    ["src", "tests", "examples", "assets/page"].iter().for_each(|folder| sources(&root.join(folder), &mut files));
    files.sort();
    let mut broken = Vec::new();
    for file in files {
        let text = fs::read_to_string(&file).unwrap();
        let found = text.lines().enumerate().filter_map(|(i, line)| Some((i + 1, broken_rule(line)?)));
        broken
            .extend(found.map(|(line, rule)| format!("{}:{line} {rule}", file.strip_prefix(root).unwrap().display())));
    }
    assert!(broken.is_empty(), "{}", broken.join("\n"));
}
