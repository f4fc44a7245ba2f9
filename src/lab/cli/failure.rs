use std::error::Error;
use std::fmt::Display;
use std::io::{self, Write as _};
use std::path::Path;
use std::process::ExitCode;

use upm_runner::config::{Diagnostic, reason};

/// Failure of a command: exit status, and what is printed on stderr.
#[derive(Debug)]
pub struct Failure(u8, String);

impl Failure {
    /// Failure of a valid command that could not be carried out.
    pub fn failed(line: impl Display) -> Self {
        Self(1, format!("upm-lab: {line}"))
    }

    /// Failure by bad usage or a bad file.
    pub fn bad_input(line: impl Display) -> Self {
        Self(2, format!("upm-lab: {line}"))
    }

    /// Failure by faults in files, one line each.
    pub fn of_files(faults: Vec<Diagnostic>) -> Self {
        Self::bad_input(faults.iter().map(Diagnostic::to_string).collect::<Vec<_>>().join("\nupm-lab: "))
    }

    /// Failure to write a file.
    pub fn write(path: &Path, error: impl Into<Box<dyn Error>>) -> Self {
        let error = error.into();
        let why = error.downcast_ref::<io::Error>().map_or_else(|| error.to_string(), reason);
        Self::failed(format!("cannot write {}: {why}", path.display()))
    }

    /// Prints it on stderr; returns the exit status.
    pub fn report(self) -> ExitCode {
        writeln!(io::stderr(), "{}", self.1).ok();
        ExitCode::from(self.0)
    }
}
