//! Commands of README.md, CONTRIBUTING.md, ARCHITECTURE.md and `docs/`: each is typed as a reader would type it, in the
//! order of its page, in a folder that `upm init .` made. CONTRIBUTING.md says how a page marks its commands.
#![cfg(all(feature = "daemon", feature = "lab", target_os = "linux"))]
#![allow(clippy::unwrap_used, clippy::panic)] // a test that cannot go on shall say so

#[path = "doc_commands/pages.rs"]
mod pages;
#[path = "doc_commands/reader.rs"]
mod reader;

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::Path;
use std::process::Command;
use std::sync::Mutex;
use std::thread;

use pages::{Block, Inline, Mark, Page, in_one_line};
use reader::{Ran, Reader, Step, has_words, lacking};

/// Most commands that may be marked as not run.
const MOST_LEFT_OUT: usize = 8;

/// Seconds from which a command is printed with its time.
const SLOW_S: f64 = 2.0;

fn root() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR"))
}

/// All pages but the changelog, with their commands.
fn all_pages() -> Vec<Page> {
    let mut names = BTreeSet::new();
    for folder in ["", "docs/"] {
        let entries = fs::read_dir(root().join(folder)).unwrap().map(|entry| entry.unwrap().file_name());
        let files = entries.map(|file| format!("{folder}{}", file.display()));
        names.extend(files.filter(|name| name.ends_with(".md") && name != "CHANGELOG.md"));
    }
    names.iter().map(|name| Page::read(name, &fs::read_to_string(root().join(name)).unwrap())).collect()
}

/// Inline commands that some page marks as longer than a minute.
fn long(pages: &[Page]) -> Vec<String> {
    pages.iter().flat_map(|page| page.long.clone()).collect()
}

/// Runner of a block's commands.
fn class(page: &Page, block: &Block) -> &'static str {
    match block.mark {
        Mark::Typed | Mark::Exit(_) | Mark::Background if page.is_slow => "long test",
        Mark::Typed | Mark::Exit(_) | Mark::Background => "test",
        Mark::Ci => "ci",
        Mark::Minutes => "tool",
        Mark::No(_) => "not run",
    }
}

fn inline_class(usage: Inline) -> &'static str {
    match usage {
        Inline::Prose => "inline, long test",
        Inline::Minutes => "inline, tool",
        Inline::Heavy => "inline, tool --heavy",
        Inline::Named => "inline, named",
    }
}

/// One line for each command: page, runner, command.
fn listed(pages: &[Page]) -> Vec<String> {
    let long = long(pages);
    let mut lines = Vec::new();
    for page in pages {
        for block in &page.blocks {
            let class = class(page, block);
            lines.extend(
                block.commands.iter().map(|(_, text)| format!("{}\t{class}\t{}", page.name, in_one_line(text))),
            );
        }
        let inline = page.inline(&long);
        lines.extend(inline.map(|(code, usage)| format!("{}\t{}\t{code}", page.name, inline_class(usage))));
    }
    lines
}

#[test]
fn every_command_has_a_runner_and_few_are_left_out() {
    let pages = all_pages();
    let mut faults: Vec<String> = pages.iter().flat_map(|page| page.faults.clone()).collect();
    let codes: BTreeSet<&String> = pages.iter().flat_map(|page| &page.codes).collect();
    let unknown = long(&pages).into_iter().filter(|command| !codes.contains(command));
    faults.extend(unknown.map(|command| format!("no page has the marked command `{command}`")));
    assert!(faults.is_empty(), "{}", faults.join("\n"));
    let mut counts = BTreeMap::new();
    let lines = listed(&pages);
    lines.iter().for_each(|line| *counts.entry(line.split('\t').nth(1).unwrap()).or_insert(0) += 1);
    eprintln!("commands of the pages: {counts:#?}");
    assert!(counts["test"] >= 20 && counts["long test"] >= 20, "commands are found: {counts:?}");
    assert!(counts["not run"] <= MOST_LEFT_OUT, "too many are not run: {counts:?}");
}

#[test]
fn commands_left_to_continuous_integration_are_in_its_script() {
    let script = fs::read_to_string(root().join(".ci/run")).unwrap();
    let is_there = |command: &str| command == ".ci/run" || script.lines().any(|line| has_words(line, command));
    let (mut count, mut missing) = (0, Vec::new());
    for page in all_pages() {
        let blocks = page.blocks.iter().filter(|block| block.mark == Mark::Ci);
        let commands = blocks.flat_map(|block| &block.commands).map(|(_, text)| in_one_line(text));
        for command in commands {
            count += 1;
            missing.extend((!is_there(&command)).then(|| format!("{}: {command}", page.name)));
        }
    }
    assert!(count >= 4 && missing.is_empty(), "{count} commands, not in .ci/run: {missing:#?}");
}

/// The commands of a block as steps.
fn steps_of(page: &Page, block: &Block) -> Vec<Step> {
    let last = block.commands.len().saturating_sub(1);
    let step = |(i, (offset, text)): (usize, &(usize, String))| Step {
        place: format!("{}:{}: {}", page.name, block.line + offset, in_one_line(text)),
        text: text.clone(),
        expected: if let Mark::Exit(status) = block.mark
            && i == last
        {
            status
        } else {
            0
        },
        is_background: block.mark == Mark::Background,
    };
    block.commands.iter().enumerate().map(step).collect()
}

/// Prints the commands that took long.
fn print_slow(steps: &[Step], ran: &[Ran]) {
    for (step, ran) in steps.iter().zip(ran).filter(|(_, ran)| ran.seconds >= SLOW_S) {
        eprintln!("{:6.1} s  {}", ran.seconds, step.place);
    }
}

/// Types a page's commands; returns what is wrong with them.
fn wrong_with(page: &Page) -> Vec<String> {
    let is_typed = |block: &&Block| matches!(block.mark, Mark::Typed | Mark::Exit(_) | Mark::Background);
    let blocks: Vec<&Block> = page.blocks.iter().filter(is_typed).collect();
    let steps: Vec<Step> = blocks.iter().flat_map(|block| steps_of(page, block)).collect();
    let ran = match Reader::new().types(&steps) {
        Ok(ran) => ran,
        Err(fault) => return vec![fault],
    };
    print_slow(&steps, &ran);
    let (mut wrong, mut ran) = (Vec::new(), ran.into_iter());
    for block in blocks {
        let printed: String = ran.by_ref().take(block.commands.len()).map(|ran| ran.output).collect();
        let shown = block.output.as_deref().unwrap_or_default();
        let lines = lacking(shown, &printed).into_iter();
        wrong.extend(lines.map(|line| format!("{}:{}: not printed: {line}", page.name, block.line)));
    }
    wrong
}

/// Types the commands of these pages, two pages at a time.
fn all_run(pages: Vec<Page>) {
    let (waiting, wrong) = (Mutex::new(pages), Mutex::new(Vec::new()));
    let type_pages = || {
        while let Some(page) = { waiting.lock().unwrap().pop() } {
            let found = wrong_with(&page);
            wrong.lock().unwrap().extend(found);
        }
    };
    thread::scope(|scope| {
        scope.spawn(type_pages);
        scope.spawn(type_pages);
    });
    let wrong = wrong.into_inner().unwrap();
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

#[test]
fn commands_of_the_pages_run_as_typed() {
    all_run(all_pages().into_iter().filter(|page| !page.is_slow).collect());
}

#[test]
#[ignore = "long: `cargo test -- --ignored` runs it"]
fn commands_of_slow_pages_run_as_typed() {
    all_run(all_pages().into_iter().filter(|page| page.is_slow).collect());
}

#[test]
#[ignore = "long: `cargo test -- --ignored` runs it"]
fn complete_commands_in_the_prose_run_as_typed() {
    let pages = all_pages();
    let (long, mut seen) = (long(&pages), BTreeSet::new());
    let mut steps = Vec::new();
    for page in &pages {
        let complete = page.inline(&long).filter(|(_, usage)| *usage == Inline::Prose);
        for (code, _) in complete.filter(|(code, _)| seen.insert(code.to_owned())) {
            let place = format!("{}: {code}", page.name);
            steps.push(Step { place, text: code.to_owned(), expected: 0, is_background: false });
        }
    }
    assert!(steps.len() >= 20, "commands are found: {}", steps.len());
    let ran = Reader::new().types(&steps).unwrap_or_else(|fault| panic!("{fault}"));
    print_slow(&steps, &ran);
}

#[test]
#[ignore = "long: `cargo test -- --ignored` runs it"]
fn tool_finds_the_same_commands() {
    let output =
        Command::new("python3").args(["tools/doc_commands.py", "--list"]).current_dir(root()).output().unwrap();
    let printed = String::from_utf8(output.stdout).unwrap();
    let (found, expected): (Vec<&str>, Vec<String>) = (printed.lines().collect(), listed(&all_pages()));
    assert_eq!(found, expected);
}
