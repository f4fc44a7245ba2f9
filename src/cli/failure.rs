use std::fmt::Display;
use std::path::Path;

use super::{BAD_INPUT, NOT_REACHED};

/// Why a command ends with a status other than 0, one line a fault.
#[derive(Debug)]
pub(super) struct Failure {
    pub status: u8,
    pub lines: Vec<String>,
}

impl Failure {
    /// The command was understood and could not do its work.
    pub fn failed(line: impl Into<String>) -> Self {
        Self { status: NOT_REACHED, lines: vec![line.into()] }
    }

    /// Bad usage or a bad file.
    pub fn bad_input(line: impl Into<String>) -> Self {
        Self { status: BAD_INPUT, lines: vec![line.into()] }
    }

    /// Faults in files, one a line.
    pub fn faults<F: Display>(faults: impl IntoIterator<Item = F>) -> Self {
        Self { status: BAD_INPUT, lines: faults.into_iter().map(|fault| fault.to_string()).collect() }
    }

    /// Tells the faults on stderr; what the exit status shall be.
    pub fn complain(&self) -> u8 {
        self.lines.iter().for_each(|line| complain!("upm: {line}"));
        self.status
    }

    /// A file could not be written.
    pub fn write(path: &Path, error: impl Display) -> Self {
        Self::failed(format!("{}: cannot be written: {error}", path.display()))
    }
}
