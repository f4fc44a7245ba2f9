use std::error::Error;
use std::fmt::Display;
use std::io::{self, Write as _};
use std::path::Path;
use std::process::ExitCode;

use upm_runner::config::{Diagnostic, reason};

/// Failure of a command: exit status and the lines that say why.
#[derive(Debug)]
pub struct Failure {
    status: u8,
    lines: Vec<String>,
}

impl Failure {
    /// Failure of a valid command that could not be carried out.
    pub fn failed(line: impl Display) -> Self {
        Self { status: 1, lines: vec![line.to_string()] }
    }

    /// Failure by bad usage or a bad file.
    pub fn bad_input(line: impl Display) -> Self {
        Self { status: 2, lines: vec![line.to_string()] }
    }

    /// Failure by faults in files, one line each.
    pub fn of_files(faults: Vec<Diagnostic>) -> Self {
        Self { status: 2, lines: faults.iter().map(Diagnostic::to_string).collect() }
    }

    /// Failure to write a file.
    pub fn write(path: &Path, error: impl Into<Box<dyn Error>>) -> Self {
        let error = error.into();
        let why = error.downcast_ref::<io::Error>().map_or_else(|| error.to_string(), reason);
        Self::failed(format!("cannot write {}: {why}", path.display()))
    }

    /// Prints the lines on stderr; returns the exit status.
    pub fn report(self) -> ExitCode {
        for line in self.lines {
            writeln!(io::stderr(), "upm-lab: {line}").ok();
        }
        ExitCode::from(self.status)
    }
}
