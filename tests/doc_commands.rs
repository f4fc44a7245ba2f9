//! Commands of README.md, CONTRIBUTING.md, ARCHITECTURE.md and `docs/`: each is run as written, in the order of its
//! page, in a folder that `upm init .` made. CONTRIBUTING.md says how a page marks its commands.
#![cfg(all(feature = "daemon", target_os = "linux"))]
#![allow(clippy::unwrap_used, clippy::panic)] // a test that cannot go on shall say so

#[path = "doc_commands/pages.rs"]
mod pages;
#[path = "doc_commands/pages_tests.rs"]
mod pages_tests;
#[path = "doc_commands/shell.rs"]
mod shell;

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::Path;
use std::process::Command;
use std::sync::Mutex;
use std::thread;

use pages::{Block, Inline, Mark, Page, in_one_line};
use shell::{CommandResult, Shell, Step, missing_lines};

/// Most commands that may be marked as not run.
const MAX_NOT_RUN: usize = 8;

/// Fewest blocks whose output is compared.
const MIN_OUTPUTS: usize = 10;

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
        Mark::Ci => "ci",
        Mark::Minutes => "tool",
        Mark::No(_) => "not run",
        _ if page.is_slow => "long test",
        _ => "test",
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
fn every_command_is_run_by_a_test_or_tool() {
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
    assert!(counts["not run"] <= MAX_NOT_RUN, "too many are not run: {counts:?}");
    let blocks = pages.iter().flat_map(|page| &page.blocks);
    let outputs = blocks.filter(|block| block.is_typed() && block.output.is_some()).count();
    assert!(outputs >= MIN_OUTPUTS, "outputs are compared: {outputs}");
}

/// True when a line of `.ci/run` is a step that runs `command`: its words are words of the line, in that order, and
/// neither or both run the ignored tests.
fn is_step(line: &str, command: &str) -> bool {
    let has_ignored = |text: &str| text.split_whitespace().any(|word| word == "--ignored");
    let is_in = |step: &str| {
        let mut words = step.split_whitespace();
        command.split_whitespace().all(|word| words.any(|other| other == word))
    };
    line.strip_prefix("step ").is_some_and(|step| is_in(step) && has_ignored(step) == has_ignored(command))
}

#[test]
fn steps_of_the_script_are_distinguished() {
    assert!(is_step("step cargo run --locked -- run a.json --out b", "cargo run -- run a.json"));
    assert!(is_step("step cargo test --locked -- --ignored", "cargo test -- --ignored"));
    for (line, command) in [
        ("step cargo test", "cargo test --workspace"),
        ("step cargo test --locked -- --ignored", "cargo test"),
        ("step cargo test --locked", "cargo test -- --ignored"),
        ("# step cargo test", "cargo test"),
        ("cargo test", "cargo test"),
    ] {
        assert!(!is_step(line, command), "{line}: {command}");
    }
}

#[test]
fn commands_left_to_continuous_integration_are_in_its_script() {
    let script = fs::read_to_string(root().join(".ci/run")).unwrap();
    let is_there = |command: &str| command == ".ci/run" || script.lines().any(|line| is_step(line, command));
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

/// Runs the steps of a page in a shell; `Err` has the fault of the first that fails.
fn run_steps(steps: &[Step]) -> Result<Vec<CommandResult>, String> {
    let results = Shell::new().run(steps)?;
    for (step, result) in steps.iter().zip(&results).filter(|(_, result)| result.seconds >= SLOW_S) {
        eprintln!("{:6.1} s  {}", result.seconds, step.place);
    }
    Ok(results)
}

/// Runs the typed blocks of a page; returns failed commands and lines that were not printed.
fn faults_of(page: &Page) -> Vec<String> {
    let blocks: Vec<&Block> = page.blocks.iter().filter(|block| block.is_typed()).collect();
    let steps: Vec<Step> = blocks.iter().flat_map(|block| steps_of(page, block)).collect();
    let mut results = match run_steps(&steps) {
        Ok(results) => results.into_iter(),
        Err(fault) => return vec![fault],
    };
    let mut faults = Vec::new();
    for block in blocks {
        let printed: String = results.by_ref().take(block.commands.len()).map(|result| result.output).collect();
        let missing = missing_lines(block.output.as_deref().unwrap_or_default(), &printed).into_iter();
        faults.extend(missing.map(|line| format!("{}:{}: not printed: {line}", page.name, block.line)));
    }
    faults
}

/// Runs pages by `faults_of`, two at a time.
#[track_caller]
fn run_pages<T: Send>(pages: Vec<T>, faults_of: impl Fn(T) -> Vec<String> + Sync) {
    let (waiting, faults) = (Mutex::new(pages), Mutex::new(Vec::new()));
    let work = || {
        while let Some(page) = { waiting.lock().unwrap().pop() } {
            let found = faults_of(page);
            faults.lock().unwrap().extend(found);
        }
    };
    thread::scope(|scope| {
        scope.spawn(work);
        scope.spawn(work);
    });
    let faults = faults.into_inner().unwrap();
    assert!(faults.is_empty(), "{}", faults.join("\n"));
}

#[test]
fn commands_of_the_pages_run_as_typed() {
    run_pages(all_pages().into_iter().filter(|page| !page.is_slow).collect(), |page| faults_of(&page));
}

#[test]
#[ignore = "long: `cargo test -- --ignored` runs it"]
fn commands_of_slow_pages_run_as_typed() {
    run_pages(all_pages().into_iter().filter(|page| page.is_slow).collect(), |page| faults_of(&page));
}

#[test]
#[ignore = "long: `cargo test -- --ignored` runs it"]
fn complete_commands_in_the_prose_run_as_typed() {
    let pages = all_pages();
    let (long, mut seen) = (long(&pages), BTreeSet::new());
    let mut steps_of = |page: &Page| -> Vec<Step> {
        let complete = page.inline(&long).filter(|(_, usage)| *usage == Inline::Prose).map(|(code, _)| code.to_owned());
        let first = complete.filter(|code| seen.insert(code.clone()));
        let step = |text| Step { place: format!("{}: {text}", page.name), text, expected: 0, is_background: false };
        first.map(step).collect()
    };
    let steps: Vec<Vec<Step>> = pages.iter().map(&mut steps_of).filter(|steps| !steps.is_empty()).collect();
    assert!(steps.iter().map(Vec::len).sum::<usize>() >= 20, "commands are found: {}", steps.len());
    run_pages(steps, |steps| run_steps(&steps).err().into_iter().collect());
}

#[test]
fn tool_and_test_list_equal_commands() {
    let output =
        Command::new("python3").args(["tools/doc_commands.py", "--list"]).current_dir(root()).output().unwrap();
    let printed = String::from_utf8(output.stdout).unwrap();
    let (found, expected): (Vec<&str>, Vec<String>) = (printed.lines().collect(), listed(&all_pages()));
    assert_eq!(found, expected);
}
