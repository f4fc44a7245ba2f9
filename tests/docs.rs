//! Links of the documentation: every relative link in a Markdown file leads to a file and to a heading in it.
#![allow(clippy::unwrap_used, clippy::panic)] // a test that cannot go on shall say so

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::{Path, PathBuf};

use assert_cmd::Command;

/// Most lines of the front page, which a newcomer should read in three minutes.
const README_LINES: usize = 150;
const README_WORDS: usize = 1200;

/// Markdown files of the project: those at the top and in `docs/`.
fn pages() -> Vec<PathBuf> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let entries = [root.to_owned(), root.join("docs")].into_iter().flat_map(|folder| fs::read_dir(folder).unwrap());
    let mut pages: Vec<PathBuf> = entries.map(|entry| entry.unwrap().path()).collect();
    pages.retain(|path| path.extension().is_some_and(|extension| extension == "md"));
    pages.sort();
    pages
}

/// Lines of a page outside fenced code.
fn prose(text: &str) -> impl Iterator<Item = &str> {
    let mut is_code = false;
    text.lines().filter(move |line| {
        is_code ^= line.trim_start().starts_with("```");
        !is_code
    })
}

/// Destinations of the inline links in a page.
fn links(text: &str) -> Vec<String> {
    let after_brackets = prose(text).flat_map(|line| line.split("](").skip(1));
    after_brackets.filter_map(|rest| rest.split_once(')')).map(|(target, _)| target.to_owned()).collect()
}

/// Anchors of a page's headings by GitHub's rules.
fn anchors(text: &str) -> BTreeSet<String> {
    let headings = prose(text).filter(|line| line.starts_with('#'));
    let anchor = |heading: &str| -> String {
        let title = heading.trim_start_matches('#').trim().to_lowercase();
        let kept = title.chars().filter(|c| c.is_alphanumeric() || " -_".contains(*c));
        kept.map(|c| if c == ' ' { '-' } else { c }).collect()
    };
    headings.map(anchor).collect()
}

#[test]
fn relative_links_lead_to_files_and_headings() {
    let mut broken = Vec::new();
    for page in pages() {
        let text = fs::read_to_string(&page).unwrap();
        for link in links(&text).iter().filter(|link| !link.contains("://")) {
            let (path, anchor) = link.split_once('#').unwrap_or((link, ""));
            let target = if path.is_empty() { page.clone() } else { page.parent().unwrap().join(path) };
            let has_anchor = || anchor.is_empty() || anchors(&fs::read_to_string(&target).unwrap()).contains(anchor);
            if !target.exists() || !has_anchor() {
                broken.push(format!("{}: {link}", page.display()));
            }
        }
    }
    assert!(broken.is_empty(), "{}", broken.join("\n"));
}

#[test]
fn readme_is_short_and_leads_to_every_page_of_the_docs() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let readme = fs::read_to_string(root.join("README.md")).unwrap();
    assert!(readme.lines().count() <= README_LINES && readme.split_whitespace().count() <= README_WORDS);
    let linked = links(&readme);
    let docs = pages().into_iter().filter(|page| page.parent().is_some_and(|folder| folder.ends_with("docs")));
    let unlinked = docs.filter(|page| !linked.contains(&format!("docs/{}", page.file_name().unwrap().display())));
    assert_eq!(unlinked.collect::<Vec<_>>(), Vec::<PathBuf>::new(), "pages that the README does not name");
}

/// Commands of `upm` that a page names: lines of code blocks and inline code.
fn commands(text: &str) -> Vec<String> {
    let inline = prose(text).flat_map(|line| line.split('`').skip(1).step_by(2));
    let prompt = |line| str::trim_start_matches(line, "$ ");
    let typed = text.lines().map(prompt).flat_map(|line| line.split(" && "));
    let of_upm = |code: &str| -> Option<String> {
        let code = code.split(" #").next()?.trim_end_matches('&').trim();
        let words = code.strip_prefix("upm ").or_else(|| code.strip_prefix("cargo run -- "))?;
        words.starts_with(|c: char| c.is_ascii_lowercase()).then(|| words.to_owned())
    };
    inline.chain(typed).filter_map(of_upm).collect()
}

/// Scripts in `tools/` that a page names.
fn scripts(text: &str) -> BTreeSet<String> {
    let after_python = text.split("python3 ").skip(1).filter_map(|rest| rest.split([' ', '`', '\n', '\'']).next());
    after_python.filter(|script| script.starts_with("tools/")).map(str::to_owned).collect()
}

/// Output of `upm COMMAND --help`; empty where there is no such command.
fn help_of(command: &str) -> String {
    let output = Command::cargo_bin("upm").unwrap().args([command, "--help"]).output().unwrap();
    if output.status.success() { String::from_utf8(output.stdout).unwrap() } else { String::new() }
}

#[test]
fn commands_that_pages_name_exist_with_their_options_and_tools_are_there() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let (mut helps, mut wrong) = (BTreeMap::new(), Vec::new());
    for page in pages().into_iter().filter(|page| !page.ends_with("CHANGELOG.md")) {
        let text = fs::read_to_string(&page).unwrap();
        for typed in commands(&text) {
            let mut words = typed.split_whitespace();
            let command = words.next().unwrap().trim_end_matches([',', ';']).to_owned();
            let help: &String = helps.entry(command.clone()).or_insert_with(|| help_of(&command));
            let options = words.filter(|word| word.starts_with("--")).map(|word| word.split('=').next().unwrap());
            let is_there = |option: &str| help.split([' ', ',', '\n']).any(|word| word == option);
            let lacking: Vec<&str> = options.filter(|option| !is_there(option)).collect();
            if help.is_empty() || !lacking.is_empty() {
                wrong.push(format!("{}: upm {typed}: {lacking:?}", page.display()));
            }
        }
        let missing = scripts(&text).into_iter().filter(|script| !root.join(script).exists());
        wrong.extend(missing.map(|script| format!("{}: {script}", page.display())));
    }
    assert!(helps.len() > 15, "commands are found: {:?}", helps.keys());
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}
