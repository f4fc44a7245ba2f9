//! A shell in a folder as `upm init .` makes it: it runs the commands of a page one after another.

use std::fmt::Write as _;
use std::fs;
use std::net::TcpListener;
use std::os::unix::fs::{PermissionsExt, symlink};
use std::path::{Path, PathBuf};
use std::process::Command;

use tempfile::TempDir;

/// Longest time for the commands of a page, s.
const PAGE_TIMEOUT_S: u32 = 900;

/// Pause between two commands beside a daemon, s: people do not type faster, and a queued job begins meanwhile.
const PAUSE_S: f64 = 0.5;

/// Lines of output in the report of a command that fails.
const SHOWN_LINES: usize = 15;

/// `cargo` of this shell: the programs under test take the place of a build.
const CARGO: &str = r#"#!/usr/bin/env bash
if [ "$1" = run ] && [[ " $* " == *" -- "* ]] && [[ " $* " != *" --example "* ]]; then
  program=upm
  [[ " $* " == *" -p upm-lab "* ]] && program=upm-lab
  while [ "$1" != -- ]; do shift; done
  shift
  exec $program "$@"
fi
echo "this test builds nothing: cargo $*" >&2
exit 101
"#;

/// Limits of a watchdog that bears with a computer that does other work as well.
const WATCHDOG: &str = r#"
"watchdog": {"no_part_s": 60, "blocked_s": 60}"#;

/// Functions of the script: the note of an ended command, and the wait for a daemon.
const FUNCTIONS: &str = r#"
exec 3>"$NOTES/ended"
_servers=()
_ended() {
  printf '%s %s %s\n' "$1" "$2" "$EPOCHREALTIME" >&3
  [ "$2" -eq "$3" ] || exit 1
}
_until_served() {
  until upm plates >/dev/null 2>&1; do
    kill -0 "$1" 2>/dev/null || exit 1
    sleep 0.1
  done
}
trap 'kill "${_servers[@]}" 2>/dev/null' EXIT
"#;

/// The end of the script: daemons are asked to end, and one that has ended by itself fails the page. `tests/daemon.rs`
/// holds the status with which they end.
const END: &str = r#"
for _server in "${_servers[@]}"; do
  kill "$_server" || exit 1
  wait "$_server"
done
_servers=()
exit 0
"#;

/// A command to run.
#[derive(Clone)]
pub struct Step {
    /// Page and line, for messages.
    pub place: String,
    pub text: String,
    pub expected: i32,
    pub is_background: bool,
}

/// An ended command.
pub struct CommandResult {
    pub seconds: f64,
    /// All that it printed.
    pub output: String,
}

/// A folder with programs, exit notes and a port for a daemon.
pub struct Shell {
    folder: TempDir,
    port: u16,
}

impl Shell {
    pub fn new() -> Self {
        let shell = Self { folder: TempDir::new().unwrap(), port: free_port() };
        for folder in ["bin", "notes", "typed"] {
            fs::create_dir(shell.path(folder)).unwrap();
        }
        let upm = Path::new(env!("CARGO_BIN_EXE_upm"));
        let lab = upm.with_file_name("upm-lab");
        assert!(lab.is_file(), "{} is missing: `cargo build -p upm-lab` makes it", lab.display());
        symlink(upm, shell.path("bin/upm")).unwrap();
        symlink(lab, shell.path("bin/upm-lab")).unwrap();
        let cargo = shell.path("bin/cargo");
        fs::write(&cargo, CARGO).unwrap();
        fs::set_permissions(&cargo, fs::Permissions::from_mode(0o755)).unwrap();
        let init =
            Command::new(env!("CARGO_BIN_EXE_upm")).args(["init", "."]).current_dir(shell.path("typed")).output();
        assert!(init.as_ref().is_ok_and(|output| output.status.success()), "{init:?}");
        shell.own_daemon();
        shell
    }

    fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    /// Gives the shipped daemon's file this shell's port and a patient watchdog: tests run side by side.
    fn own_daemon(&self) {
        let file = self.path("typed/configs/daemon.json");
        let shipped = fs::read_to_string(&file).unwrap();
        let own = shipped.lines().map(|line| match line.trim_start() {
            bare if bare.starts_with("\"listen\"") => format!("\"listen\": \"127.0.0.1:{}\",", self.port),
            bare if bare.starts_with("\"watchdog\"") => WATCHDOG.to_owned(),
            _ => line.to_owned(),
        });
        let own = own.collect::<Vec<_>>().join("\n");
        assert!(own.contains(&self.port.to_string()) && own.contains(WATCHDOG), "{own}");
        fs::write(file, own).unwrap();
    }

    /// Runs the commands; `Err` has the first that ends otherwise than expected.
    pub fn run(&self, steps: &[Step]) -> Result<Vec<CommandResult>, String> {
        let script = self.path("script");
        fs::write(&script, script_of(steps)).unwrap();
        let path = std::env::var("PATH").unwrap_or_default();
        let mut bash = Command::new("timeout");
        bash.args(["--kill-after=10", &PAGE_TIMEOUT_S.to_string(), "bash"])
            .arg(&script)
            .current_dir(self.path("typed"));
        bash.env("PATH", format!("{}:{path}", self.path("bin").display())).env("NOTES", self.path("notes"));
        bash.env("UPM_URL", format!("http://127.0.0.1:{}", self.port));
        bash.env_remove("UPM_TOKEN_FILE").env_remove("UPM_DATA");
        let output = bash.output().unwrap();
        let notes = self.exit_notes();
        if output.status.success() {
            return Ok((0..steps.len())
                .map(|i| CommandResult { seconds: notes[i].seconds, output: self.printed(i) })
                .collect());
        }
        let expected = |number: usize| steps.get(number).map_or(0, |step| step.expected);
        let (number, status) = match notes.last() {
            Some(last) if last.status != expected(last.number) => (last.number, last.status.to_string()),
            last => (
                last.map_or(0, |last| last.number + 1),
                format!("none within {PAGE_TIMEOUT_S} s, or the daemon ended early"),
            ),
        };
        let place = steps.get(number).map_or("the end of the page", |step| &step.place);
        let printed = tail(&(self.printed(number) + &String::from_utf8_lossy(&output.stderr)));
        Err(format!("{place}: exit status {status}, expected {}\n{printed}", expected(number)))
    }

    /// Exit notes in the order of the commands.
    fn exit_notes(&self) -> Vec<ExitNote> {
        let notes = fs::read_to_string(self.path("notes/ended")).unwrap_or_default();
        let mut before_s = None;
        let note = |line: &str| {
            let mut words = line.split(' ');
            let number = words.next()?.parse().ok()?;
            let (status, at_s) = (words.next()?.parse().ok()?, words.next()?.replace(',', ".").parse::<f64>().ok()?);
            let seconds = at_s - before_s.replace(at_s).unwrap_or(at_s);
            Some(ExitNote { number, status, seconds })
        };
        // the first note is that of the start
        notes.lines().filter_map(note).skip(1).collect()
    }

    fn printed(&self, number: usize) -> String {
        let bytes = fs::read(self.path("notes").join(number.to_string())).unwrap_or_default();
        String::from_utf8_lossy(&bytes).into_owned()
    }
}

/// A line that the script writes when a command has ended.
struct ExitNote {
    number: usize,
    status: i32,
    seconds: f64,
}

/// The script that types the commands and notes each with its status.
fn script_of(steps: &[Step]) -> String {
    let mut script = format!("{FUNCTIONS}\n_ended 0 0 0\n");
    let pause_s = if steps.iter().any(|step| step.is_background) { PAUSE_S } else { 0.0 };
    for (i, step) in steps.iter().enumerate() {
        let (text, expected) = (&step.text, step.expected);
        writeln!(script, "sleep {pause_s}\nexec >\"$NOTES/{i}\" 2>&1").unwrap();
        if step.is_background {
            let bare = text.split(" #").next().unwrap_or_default().trim_end().trim_end_matches('&');
            writeln!(script, "{bare} &\n_servers+=($!)\n_until_served $!\n_ended {i} 0 0").unwrap();
        } else {
            writeln!(script, "{text}\n_ended {i} $? {expected}").unwrap();
        }
    }
    script + END
}

fn free_port() -> u16 {
    TcpListener::bind("127.0.0.1:0").unwrap().local_addr().unwrap().port()
}

/// The last lines of a text.
fn tail(text: &str) -> String {
    let lines: Vec<&str> = text.lines().collect();
    lines[lines.len().saturating_sub(SHOWN_LINES)..].iter().map(|line| format!("  {line}\n")).collect()
}

/// Lines of `shown` that `printed` lacks, both read in order. A line of the page holds up to an ellipsis, or to figures
/// of the wall clock.
pub fn missing_lines<'a>(shown: &'a str, printed: &str) -> Vec<&'a str> {
    let lasting =
        |line: &'a str| line.split('…').next().unwrap_or_default().split(", run in ").next().unwrap_or_default();
    let mut left = printed.lines();
    let mut is_missing = |line: &&str| {
        let mut ahead = left.clone();
        let is_found = ahead.any(|other| other.starts_with(line));
        if is_found {
            left = ahead;
        }
        !is_found
    };
    let lines = shown.lines().map(lasting).filter(|line| !line.trim().is_empty());
    lines.filter(|line| is_missing(line)).collect()
}

fn step(text: &str, expected: i32) -> Step {
    Step { place: format!("page: {text}"), text: text.to_owned(), expected, is_background: false }
}

#[test]
fn unexpected_exit_status_names_the_command() {
    let shell = Shell::new();
    let fine = shell.run(&[step("cd configs", 0), step("ls # all", 0), step("upm check nothing.json", 2)]).unwrap();
    assert!(fine[1].output.contains("arrange-2.json") && fine[2].output.contains("nothing.json"), "{}", fine[1].output);
    let wrong = shell.run(&[step("true", 0), step("echo so; false", 0), step("true", 0)]).err().unwrap();
    assert_eq!(wrong, "page: echo so; false: exit status 1, expected 0\n  so\n");
    let built = shell.run(&[step("cargo test", 0)]).err().unwrap();
    assert!(built.contains("exit status 101") && built.contains("builds nothing"), "{built}");
}

#[test]
fn daemon_that_ends_early_fails_the_page() {
    let serve = |text: &str| Step { is_background: true, ..step(text, 0) };
    // stands in for `upm plates`
    let client = step("upm() { true; }", 0);
    assert!(Shell::new().run(&[client.clone(), serve("sleep 60 &  # serves"), step("true", 0)]).is_ok());
    let fault = Shell::new().run(&[client, serve("sleep 0.1 &"), step("sleep 0.5", 0)]).err().unwrap();
    assert!(fault.starts_with("the end of the page: exit status none"), "{fault}");
}

#[test]
fn output_of_a_page_holds_in_order_and_up_to_an_ellipsis() {
    let printed = "job: done\n  plate time   5.2 s, run in 0.3 s\n  work  3\n";
    let missing = |shown| missing_lines(shown, printed);
    assert_eq!(missing("job: …\n  plate time   5.2 s, run in 9 s\n…\n"), [""; 0]);
    assert_eq!(missing("job: done\n  work  4\n  work\n"), ["  work  4"]);
    assert_eq!(missing("  work  3\njob: done\n"), ["job: done"]);
}
