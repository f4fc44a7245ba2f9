//! Patterns that comments leave out, and the width of their lines: the part of the house's rules that a program can
//! see.
#![allow(clippy::unwrap_used)] // a test that cannot go on shall say so

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

/// The rule that a line breaks, if it is a comment.
fn broken_rule(line: &str) -> Option<String> {
    let start = line.trim_start();
    let rest = start.strip_prefix("//").or_else(|| start.strip_prefix("/**"))?;
    let words = rest.trim_start_matches(['/', '!']).trim_start();
    let mut firsts = words.split(". ").filter_map(|sentence| sentence.split(|c: char| !c.is_alphanumeric()).next());
    if let Some(first) = firsts.find(|first| NO_SUBJECTS.contains(first)) {
        return Some(format!("begins a sentence with {first}"));
    }
    // words alone, so that a phrase has no letter beside it
    let spaced = words.to_lowercase().replace(|c: char| !c.is_alphanumeric(), " ");
    if let Some(phrase) = NO_PHRASES.iter().find(|phrase| format!(" {spaced} ").contains(&format!(" {phrase} "))) {
        return Some(format!("says {phrase:?}"));
    }
    let width = line.chars().count();
    (width > WIDEST).then(|| format!("has {width} columns"))
}

#[test]
fn comments_keep_the_rules_that_a_program_can_see() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let (mut files, mut broken) = (vec![root.join("build.rs")], Vec::new());
    ["src", "tests", "examples", "assets/page"].iter().for_each(|folder| sources(&root.join(folder), &mut files));
    for file in files {
        let text = fs::read_to_string(&file).unwrap();
        let found = text.lines().enumerate().filter_map(|(i, line)| Some((i + 1, broken_rule(line)?)));
        broken.extend(found.map(|(line, rule)| format!("{}:{line} {rule}", file.display())));
    }
    assert!(broken.is_empty(), "{}", broken.join("\n"));
}

#[test]
fn broken_rules_are_found_and_others_are_not() {
    assert_eq!(broken_rule("    /// What a person sees.").as_deref(), Some("begins a sentence with What"));
    assert_eq!(broken_rule("//! Rests, but for a swing.").as_deref(), Some("says \"but for\""));
    assert_eq!(broken_rule(&format!("// {}", "x ".repeat(60))).as_deref(), Some("has 123 columns"));
    for fine in ["let what = \"What\";", "/// Whole frames.", "// whatever the seed", "/// A tribute forever."] {
        assert_eq!(broken_rule(fine), None, "{fine}");
    }
}
