//! Output and exit of commands: lines on stdout and stderr, failures, exit statuses, Ctrl-C.

use std::cell::RefCell;
use std::fmt::Display;
use std::io::{self, ErrorKind, Write};
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use image::ImageError;

use super::shipped::is_shipped;
use super::signals;
use upm_runner::config::{Diagnostic, DiagnosticClass, listed, reason};

/// Exit status: the job ran and did not reach its goal.
pub(super) const NOT_REACHED: u8 = 1;
/// Exit status: bad usage or a bad file.
pub(super) const BAD_INPUT: u8 = 2;
/// Exit status: ended by Ctrl-C.
pub(super) const INTERRUPTED: u8 = 130;

/// Failure of a command: exit status and one line per fault.
#[derive(Debug)]
pub(super) struct Failure {
    pub status: u8,
    pub lines: Vec<String>,
}

impl Failure {
    /// Failure of a valid command that could not be carried out.
    pub fn failed(line: impl Display) -> Self {
        Self { status: NOT_REACHED, lines: vec![line.to_string()] }
    }

    /// Failure by bad usage or a bad file.
    pub fn bad_input(line: impl Display) -> Self {
        Self::faults([line])
    }

    /// Failure by faults in files, one line each.
    pub fn faults<F: Display>(faults: impl IntoIterator<Item = F>) -> Self {
        Self { status: BAD_INPUT, lines: faults.into_iter().map(|fault| fault.to_string()).collect() }
    }

    /// As [`Self::faults`]; for a missing shipped file it adds that `upm init` writes it.
    pub fn of_files(faults: Vec<Diagnostic>) -> Self {
        let hint = |fault: &Diagnostic| match fault.class {
            DiagnosticClass::Unreadable if is_shipped(&fault.file) => format!("{fault}; `upm init` writes it"),
            _ => fault.to_string(),
        };
        Self::faults(faults.iter().map(hint))
    }

    /// Failure to read a file.
    pub fn read_failed(path: &Path, error: &io::Error) -> Self {
        Self::bad_input(format!("cannot read {}: {}", path.display(), reason(error)))
    }

    /// Failure to write a file.
    pub fn write(path: &Path, error: impl Into<Box<dyn std::error::Error>>) -> Self {
        let error = error.into();
        let why = error.downcast_ref::<io::Error>().map_or_else(|| error.to_string(), reason);
        Self::failed(format!("cannot write {}: {why}", path.display()))
    }

    /// Failure to write a picture.
    pub fn write_picture(path: &Path, error: ImageError) -> Self {
        match error {
            ImageError::IoError(error) => Self::write(path, error),
            error => Self::write(path, error),
        }
    }

    /// Prints the lines on stderr; returns the exit status.
    pub fn report(&self) -> u8 {
        self.lines.iter().for_each(|line| errln!("upm: {line}"));
        self.status
    }
}

/// Refuses a file whose name has another ending than these.
pub(super) fn check_ending(option: &str, file: &Path, endings: &[&str]) -> Result<(), Failure> {
    let ending = file.extension().and_then(|ending| ending.to_str()).unwrap_or_default().to_lowercase();
    if endings.contains(&ending.as_str()) {
        return Ok(());
    }
    let (allowed, found) = (listed(endings), file.display());
    Err(Failure::bad_input(format!("{option}: expected a name ending in {allowed}, found {found}")))
}

/// True once the reader of stdout has gone.
static READER_LEFT: AtomicBool = AtomicBool::new(false);

/// The output of a command on this thread, and the flag that ends it, where a caller of the library takes both.
#[derive(Default)]
pub(super) struct Captured {
    pub document: String,
    pub errors: Vec<String>,
    stop: Arc<AtomicBool>,
}

thread_local!(static CAPTURED: RefCell<Option<Captured>> = const { RefCell::new(None) });

/// Runs `command` without stdout, stderr and Ctrl-C; returns what it printed.
pub(super) fn captured<T>(stop: &Arc<AtomicBool>, command: impl FnOnce() -> T) -> Captured {
    CAPTURED.set(Some(Captured { stop: Arc::clone(stop), ..Captured::default() }));
    command();
    CAPTURED.take().unwrap_or_default()
}

/// The result of `use_it` on the captured output; `None` where none is captured.
fn with_captured<T>(use_it: impl FnOnce(&mut Captured) -> T) -> Option<T> {
    CAPTURED.with_borrow_mut(|captured| captured.as_mut().map(use_it))
}

/// Writes a line to stderr, as far as that can be done.
pub(super) fn put_error(text: std::fmt::Arguments<'_>) {
    if with_captured(|captured| captured.errors.push(text.to_string())).is_none() {
        writeln!(std::io::stderr(), "{text}").ok();
    }
}

/// Writes a line to stdout. A reader that has gone is no failure: a command with an end goes on to it.
pub(super) fn put(text: std::fmt::Arguments<'_>) -> Result<(), Failure> {
    if with_captured(|captured| captured.document.push_str(&format!("{text}\n"))).is_some() {
        return Ok(());
    }
    let mut out = std::io::stdout().lock();
    match writeln!(out, "{text}").and_then(|()| out.flush()) {
        Err(error) if error.kind() == ErrorKind::BrokenPipe => {
            READER_LEFT.store(true, Ordering::Relaxed);
            Ok(())
        }
        written => written.map_err(|error| Failure::failed(format!("stdout: {}", reason(&error)))),
    }
}

/// True once the reader of stdout has gone, for commands that print until then.
#[cfg(feature = "daemon")]
pub(super) fn reader_left() -> bool {
    READER_LEFT.load(Ordering::Relaxed)
}

/// Prints a result as one JSON document.
pub(super) fn print_json(value: &impl serde::Serialize) -> Result<(), Failure> {
    let text = serde_json::to_string_pretty(value).map_err(Failure::failed)?;
    outln!("{text}")
}

/// Prints a result as a JSON document or by `text`; returns exit status 0.
pub(super) fn print(
    json: bool,
    value: &impl serde::Serialize,
    text: impl FnOnce() -> Result<(), Failure>,
) -> Result<u8, Failure> {
    if json { print_json(value) } else { text() }?;
    Ok(0)
}

/// Flag that Ctrl-C sets; a second Ctrl-C ends the process at once.
pub(super) fn stop_on_interrupt() -> Arc<AtomicBool> {
    if let Some(stop) = with_captured(|captured| Arc::clone(&captured.stop)) {
        return stop;
    }
    let stop = Arc::new(AtomicBool::new(false));
    let flag = Arc::clone(&stop);
    signals::attend(signals::ending(), move || {
        if flag.swap(true, Ordering::Relaxed) {
            std::process::exit(i32::from(INTERRUPTED));
        }
    });
    stop
}
