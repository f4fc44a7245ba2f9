//! Names and lines of `ARCHITECTURE.md` beyond the map: files and items that it names exist.

use std::collections::BTreeSet;
use std::path::Path;

use super::map::quoted;
use super::scan;

/// Most columns of a line outside tables and links to pictures.
const WIDEST: usize = 120;

/// Words before the name of an item that a source defines.
const KEYWORDS: [&str; 5] = ["const", "enum", "struct", "trait", "type"];

fn is_word(c: char) -> bool {
    c.is_alphanumeric() || c == '_'
}

/// True for text in the form of a path: `control/pulse_planner.rs`, `docs/`, `Cargo.toml`.
fn is_path(text: &str) -> bool {
    let is_plain = text.chars().all(|c| is_word(c) || "-./".contains(c));
    is_plain && (text.contains('/') || [".rs", ".md", ".toml"].iter().any(|end| text.ends_with(end)))
}

/// True for text in the form of a name of the project: `Plan`, `signal::Shaping`, `belt_table`.
fn is_name(text: &str) -> bool {
    let is_plain = text.chars().all(|c| is_word(c) || c == ':');
    is_plain && text.starts_with(|c: char| c.is_alphabetic()) && !text.starts_with("std::")
}

/// True if a path leads somewhere from the project's root, or is the end of a source's path or folder: `fields/seeds`
/// is `src/planner/fields/seeds.rs`.
fn exists(path: &str, files: &[(String, String)]) -> bool {
    let path = path.trim_end_matches('/');
    let is_end = |whole: &str| whole.strip_suffix(path).is_some_and(|before| before.ends_with('/'));
    let is_source =
        |file: &str| is_end(file) || is_end(file.trim_end_matches(".rs")) || file.contains(&format!("/{path}/"));
    Path::new(env!("CARGO_MANIFEST_DIR")).join(path).exists() || files.iter().any(|(file, _)| is_source(file))
}

/// Faults of the page, given all sources with their texts.
pub fn faults(page: &str, files: &[(String, String)]) -> Vec<String> {
    let code: Vec<String> = files.iter().flat_map(|(_, text)| scan::words(text)).collect();
    let items = code.windows(2).filter(|pair| KEYWORDS.contains(&pair[0].as_str())).map(|pair| pair[1].as_str());
    let of_manifest = include_str!("../../Cargo.toml").split(|c| !is_word(c));
    let words: BTreeSet<&str> = code.iter().map(String::as_str).chain(of_manifest).collect();
    let items: BTreeSet<&str> = items.collect();
    // Modules and variants are words of the code of some source, types are defined in one.
    let is_known = |name: &str| {
        let item = name.split("::").find(|word| word.starts_with(char::is_uppercase));
        name.split("::").all(|word| words.contains(word)) && item.is_none_or(|item| items.contains(item))
    };
    let is_missing = |text: &&str| if is_path(text) { !exists(text, files) } else { is_name(text) && !is_known(text) };
    let (mut faults, mut is_drawn) = (Vec::new(), false);
    for (number, line) in page.lines().enumerate() {
        is_drawn ^= line.starts_with("```");
        let names: Vec<&str> = if is_drawn {
            line.split(|c| !is_word(c)).filter(|word| word.contains('_')).collect()
        } else {
            quoted(line).collect()
        };
        let missing = names.into_iter().filter(is_missing).map(|name| format!("there is no `{name}`"));
        let is_wide = line.chars().count() > WIDEST && !line.starts_with(['|', '!']);
        let wide = is_wide.then(|| format!("lines have at most {WIDEST} columns"));
        faults.extend(missing.chain(wide).map(|fault| format!("ARCHITECTURE.md:{}: {fault}", number + 1)));
    }
    faults
}

#[test]
fn missing_names_and_wide_lines_are_found() {
    let source = "struct Seeds; // a type gauge\nconst A: &str = \"dial\";";
    let files = [("src/planner/fields/seeds.rs".to_owned(), source.to_owned())];
    let fine = "`src/planner/`, `fields/seeds`, `seeds.rs`, `Seeds`, `Cargo.toml`, `c - js`, `_m`\n| a table |";
    assert_eq!(faults(fine, &files), [""; 0]);
    let found = faults("`fields/bench`\n`Seeds::Row`, `B`\n```\nleast_time\n```\n`gauge`, `dial`", &files);
    let expected = [(1, "fields/bench"), (2, "Seeds::Row"), (2, "B"), (4, "least_time"), (6, "gauge"), (6, "dial")];
    assert_eq!(found, expected.map(|(line, name)| format!("ARCHITECTURE.md:{line}: there is no `{name}`")));
    assert_eq!(faults(&"x".repeat(121), &files), ["ARCHITECTURE.md:1: lines have at most 120 columns"]);
}
