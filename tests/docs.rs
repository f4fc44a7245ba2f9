//! Commands, links and names in the documentation: commands run as typed, every relative link leads to a file and to a
//! heading in it, and commands, options and scripts that a page names exist.
#![allow(clippy::unwrap_used, clippy::panic)] // a test that cannot go on shall say so

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

use std::process::Command;

#[cfg(all(feature = "daemon", target_os = "linux"))]
#[path = "docs/commands.rs"]
mod commands;
#[path = "docs/pages.rs"]
#[allow(dead_code)] // marks, in a build that runs no commands
mod pages;

use pages::Page;

/// Most lines of the front page, which a newcomer should read in three minutes.
const README_LINES: usize = 150;
const README_WORDS: usize = 1200;

/// Destinations of the inline links in a page.
fn links(page: &Page) -> Vec<String> {
    let after_brackets = page.prose.split("](").skip(1);
    after_brackets.filter_map(|rest| rest.split_once(')')).map(|(target, _)| target.to_owned()).collect()
}

/// Anchors of a page's headings by GitHub's rules.
fn anchors(page: &Page) -> BTreeSet<String> {
    let headings = page.prose.lines().filter(|line| line.starts_with('#'));
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
    for page in pages::files() {
        for link in links(&Page::read(&page)).iter().filter(|link| !link.contains("://")) {
            let (path, anchor) = link.split_once('#').unwrap_or((link, ""));
            let target = if path.is_empty() { page.clone() } else { page.parent().unwrap().join(path) };
            let has_anchor = || anchor.is_empty() || anchors(&Page::read(&target)).contains(anchor);
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
    let readme = std::fs::read_to_string(root.join("README.md")).unwrap();
    assert!(readme.lines().count() <= README_LINES && readme.split_whitespace().count() <= README_WORDS);
    let linked = links(&Page::read(&root.join("README.md")));
    let docs = pages::files().into_iter().filter(|page| page.parent().is_some_and(|folder| folder.ends_with("docs")));
    let unlinked = docs.filter(|page| !linked.contains(&format!("docs/{}", page.file_name().unwrap().display())));
    assert_eq!(unlinked.collect::<Vec<_>>(), Vec::<std::path::PathBuf>::new(), "pages that the README does not name");
}

/// Commands that a page has in blocks and inline code, each without what `&&`, a comment or `&` separates from it.
fn commands(page: &Page) -> Vec<String> {
    let blocks = page.blocks.iter().filter(|block| block.info == "sh").map(|block| block.text.replace("\\\n", " "));
    let typed: Vec<String> = blocks.flat_map(|text| text.lines().map(str::to_owned).collect::<Vec<_>>()).collect();
    let all = page.codes().into_iter().chain(typed);
    let parts = |text: String| -> Vec<String> {
        let bare = text.split(" #").next().unwrap_or_default();
        bare.split(" && ").map(|part| part.trim_end_matches('&').trim().to_owned()).collect()
    };
    all.flat_map(parts).collect()
}

/// The words after `upm` in a command; `None` for other commands, and where `upm` has no subcommand.
fn words_of_upm(command: &str) -> Option<&str> {
    let words = command.strip_prefix("upm ").or_else(|| command.strip_prefix("cargo run -- "))?;
    words.starts_with(|c: char| c.is_ascii_lowercase()).then_some(words)
}

/// The script in `tools/` that a command runs.
fn script_of(command: &str) -> Option<&str> {
    command.strip_prefix("python3 ")?.split([' ', '\'']).next().filter(|script| script.starts_with("tools/"))
}

/// Output of `upm COMMAND --help`, and of its subcommand if it has one; empty where there is no such command.
fn help_of(command: &str) -> String {
    let help = |words: &[&str]| {
        let output = Command::new(env!("CARGO_BIN_EXE_upm")).args(words).arg("--help").output().unwrap();
        if output.status.success() { String::from_utf8(output.stdout).unwrap() } else { String::new() }
    };
    help(&[command]) + &help(&[command, "merge"])
}

#[test]
fn commands_that_pages_name_exist_with_their_options_and_tools_are_there() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let (mut helps, mut faults) = (BTreeMap::new(), Vec::new());
    for page in pages::all() {
        let commands = commands(&page);
        for called in commands.iter().filter_map(|command| words_of_upm(command)) {
            let mut words = called.split_whitespace();
            let command = words.next().unwrap().trim_end_matches([',', ';']).to_owned();
            let help: &String = helps.entry(command.clone()).or_insert_with(|| help_of(&command));
            let options = words.filter(|word| word.starts_with("--")).map(|word| word.split('=').next().unwrap());
            let is_there = |option: &str| help.split([' ', ',', '\n']).any(|word| word == option);
            let missing: Vec<&str> = options.filter(|option| !is_there(option)).collect();
            if help.is_empty() || !missing.is_empty() {
                faults.push(format!("{}: upm {called}: {missing:?}", page.name));
            }
        }
        let scripts = commands.iter().filter_map(|command| script_of(command));
        let missing = scripts.filter(|script| !root.join(script).exists());
        faults.extend(missing.map(|script| format!("{}: {script}", page.name)));
    }
    assert!(helps.len() > 15, "commands are found: {:?}", helps.keys());
    assert!(faults.is_empty(), "{}", faults.join("\n"));
}
