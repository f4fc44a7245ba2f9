//! Commands of README.md, CONTRIBUTING.md, ARCHITECTURE.md and `docs/`: each is run as written, in the order of its
//! page, in a folder that `upm init .` made. CONTRIBUTING.md says how a page marks its commands.

use std::net::TcpListener;
use std::path::Path;
use std::process::Command;
use std::sync::Mutex;
use std::thread;

use tempfile::TempDir;

use super::pages::{self, Block, Page};

/// True for a block of commands that the test runs.
fn is_run(block: &Block) -> bool {
    block.info == "sh" && !block.mark.starts_with("no: ")
}

/// The commands of a page, each on its line of the page; the last one of a block marked `exit N` ends with that status.
fn script_of(page: &Page) -> String {
    let mut lines: Vec<String> = Vec::new();
    for block in page.blocks.iter().filter(|block| is_run(block)) {
        lines.resize(block.line, String::new());
        lines.extend(block.text.lines().map(str::to_owned));
        if let (Some(status), Some(last)) = (block.mark.strip_prefix("exit "), lines.last_mut()) {
            let command = last.split(" #").next().unwrap_or_default();
            *last = format!("{command} && false || [ $? -eq {status} ]");
        }
    }
    lines.join("\n")
}

/// Runs a script in a new folder; returns all that it prints, and its fault if a command fails.
fn run(name: &str, script: &str) -> (String, Option<String>) {
    let folder = TempDir::new().unwrap();
    let port = TcpListener::bind("127.0.0.1:0").unwrap().local_addr().unwrap().port().to_string();
    let path = Path::new(env!("CARGO_BIN_EXE_upm")).parent().unwrap().display().to_string();
    let path = format!("{path}:{}", std::env::var("PATH").unwrap_or_default());
    let prelude = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/docs/prelude.sh");
    let file = folder.path().join("page.sh");
    std::fs::write(&file, script).unwrap();
    let mut bash = Command::new("timeout");
    bash.args(["--kill-after=10", "900", "bash"]).arg(&file).current_dir(folder.path());
    bash.envs([("BASH_ENV", prelude), ("PATH", &path), ("PORT", &port)]).env_remove("UPM_TOKEN_FILE");
    let output = bash.env_remove("UPM_DATA").output().unwrap();
    let printed = String::from_utf8_lossy(&output.stdout).into_owned();
    let fault = (!output.status.success()).then(|| format!("{name}: {}\n{printed}", output.status));
    (printed, fault)
}

/// First line of `shown` that `printed` lacks, both read in order. A line of the page holds up to an ellipsis, or to
/// times of the wall clock.
fn missing_line<'a>(shown: &'a str, printed: &mut std::str::Lines) -> Option<&'a str> {
    let lasting = |line: &'a str| line.split(['…']).next().and_then(|line| line.split(", run in ").next());
    let mut lines = shown.lines().filter_map(lasting).filter(|line| !line.trim().is_empty());
    lines.find(|line| !printed.any(|other| other.starts_with(line)))
}

/// Runs the commands of a page, and compares the `text` blocks directly below them.
fn faults_of(page: &Page) -> Option<String> {
    let (printed, fault) = run(&page.name, &script_of(page));
    let mut lines = printed.lines();
    let below = page.blocks.windows(2).filter(|pair| is_run(&pair[0]) && pair[1].info == "text");
    let mut below = below.filter(|pair| pair[1].line <= pair[0].line + pair[0].text.lines().count() + 3);
    fault.or_else(|| {
        let missing = below.find_map(|pair| missing_line(&pair[1].text, &mut lines));
        missing.map(|line| format!("{}: not printed: {line}\n{printed}", page.name))
    })
}

#[track_caller]
fn assert_runs(pages: impl Iterator<Item = Page> + Send) {
    // each page has a folder and a port of its own
    let pages = Mutex::new(pages);
    let next = || pages.lock().unwrap().next();
    let work = || std::iter::from_fn(next).filter_map(|page| faults_of(&page)).collect::<Vec<_>>();
    let faults = thread::scope(|scope| {
        let threads = [(); 2].map(|()| scope.spawn(work));
        threads.map(|thread| thread.join().unwrap()).concat()
    });
    assert!(faults.is_empty(), "{}", faults.join("\n"));
}

fn is_slow(page: &Page) -> bool {
    page.marks.iter().any(|mark| mark == "slow")
}

#[test]
fn commands_of_the_pages_run_as_typed() {
    assert_runs(pages::all().into_iter().filter(|page| !is_slow(page)));
}

#[test]
#[ignore = "long: `cargo test -- --ignored` runs it"]
fn commands_of_slow_pages_run_as_typed() {
    assert_runs(pages::all().into_iter().filter(is_slow));
}
