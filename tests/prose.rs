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

/// Words that tell a reader nothing about an item.
const FILLERS: [&str; 10] = ["the", "a", "an", "its", "their", "this", "of", "that", "each", "all"];

/// Keywords before the name of an item; fields, variants, constants and statics have none of them.
const NAMING: [&str; 8] = ["fn", "struct", "enum", "union", "trait", "type", "mod", "macro_rules!"];

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

/// Words of a sentence or a name in lower case, without fillers and plural endings: `RigKinds` gives `rig` and `kind`.
fn words_of(text: &str) -> Vec<String> {
    let (mut spaced, mut before) = (String::new(), ' ');
    for letter in text.replace("'s", "").chars() {
        if letter.is_uppercase() && !before.is_uppercase() {
            spaced.push(' ');
        }
        spaced.push(if letter.is_alphanumeric() { letter } else { ' ' });
        before = letter;
    }
    let spaced = spaced.to_lowercase();
    let words = spaced.split_whitespace().filter(|word| !FILLERS.contains(word));
    // a single `s` is the unit
    words.map(|word| word.strip_suffix('s').filter(|rest| !rest.is_empty()).unwrap_or(word).to_owned()).collect()
}

/// First of `lines` that is not part of an attribute.
fn declaration<'a>(lines: &[&'a str]) -> Option<&'a str> {
    let mut open = 0;
    lines.iter().map(|line| line.trim()).find(|line| {
        let is_code = open == 0 && !line.starts_with("#[");
        open = (open + line.matches('[').count()).saturating_sub(line.matches(']').count());
        is_code
    })
}

/// Words of the name in a declaration; of a field, variant, constant or static also those of its type.
fn declared_words(declaration: &str) -> Vec<String> {
    match declaration.split(' ').skip_while(|word| !NAMING.contains(word)).nth(1) {
        Some(name) => words_of(name.split(|c: char| c != '_' && !c.is_alphanumeric()).next().unwrap_or(name)),
        None => words_of(declaration.split(" =").next().unwrap_or(declaration)),
    }
}

/// True when line `at` is a whole doc comment, of one sentence, and the declaration below it has all its words.
fn restates_the_name(lines: &[&str], at: usize) -> bool {
    let doc = |at: usize| lines.get(at).and_then(|line| line.trim_start().strip_prefix("///"));
    let Some(sentence) = doc(at).filter(|sentence| !sentence.contains(". ")) else { return false };
    let is_whole = doc(at + 1).is_none() && at.checked_sub(1).and_then(doc).is_none();
    let below = declaration(&lines[at + 1..]).filter(|_| is_whole).map(declared_words);
    below.is_some_and(|below| words_of(sentence).iter().all(|word| below.contains(word)))
}

/// Files that the rules are for, in `root`.
fn checked_files(root: &Path) -> Vec<PathBuf> {
    let mut files = vec![root.join("build.rs")];
    ["src", "tests", "examples", "assets/page"].iter().for_each(|folder| sources(&root.join(folder), &mut files));
    files.sort();
    files
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
    let mut broken = Vec::new();
    for file in checked_files(root) {
        let text = fs::read_to_string(&file).unwrap();
        let found = text.lines().enumerate().filter_map(|(i, line)| Some((i + 1, broken_rule(line)?)));
        broken
            .extend(found.map(|(line, rule)| format!("{}:{line} {rule}", file.strip_prefix(root).unwrap().display())));
    }
    assert!(broken.is_empty(), "{}", broken.join("\n"));
}

#[test]
fn restated_names_are_found_and_other_comments_are_not() {
    let restates = |text: &str| restates_the_name(&text.lines().collect::<Vec<_>>(), 0);
    for empty in [
        "/// The path.\npath: PathBuf,",
        "/// The rig.\npub rig: RigSpec,",
        "/// Its kind.\n#[serde(default)]\n#[schemars(\n    length(min = 1),\n)]\nkind: String,",
        "/// The commands.\npub enum Command {",
        "/// Radius, mm.\npub radius_mm: f64,",
        "/// State of a job.\npub(super) enum JobState {",
        "/// All parts of the rig's kind.\nfn kind_of_rig_parts(&self) -> Parts {",
        "/// Sustain, s.\nconst SUSTAIN_S: f64 = 0.1;",
        "/// Idle.\nIdle = \"idle\",",
    ] {
        assert!(restates(empty), "{empty}");
    }
    for fine in [
        "/// Radius, mm.\npub radius: f64,",
        "/// The path; `None` without a file.\npath: Option<PathBuf>,",
        "/// The path of the journal.\nfn path(&self, journal: &Journal) -> PathBuf {",
        "/// The path.\n/// Its file exists.\npath: PathBuf,",
        "/// The path. Its file exists.\npath: PathBuf,",
        "/// Seed, 7 at first.\nconst SEED: u64 = 7;",
        "// The path.\npath: PathBuf,",
        "/// The path.",
    ] {
        assert!(!restates(fine), "{fine}");
    }
}

#[test]
fn comments_say_more_than_the_names_of_their_items() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let mut restated = Vec::new();
    for file in checked_files(root) {
        let text = fs::read_to_string(&file).unwrap();
        let lines: Vec<_> = text.lines().collect();
        let found = (0..lines.len()).filter(|&at| restates_the_name(&lines, at));
        let shown = file.strip_prefix(root).unwrap().display();
        restated.extend(found.map(|at| format!("{shown}:{} only restates the name: {}", at + 1, lines[at].trim())));
    }
    assert!(restated.is_empty(), "{}", restated.join("\n"));
}
