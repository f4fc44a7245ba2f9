//! Refusals as exceptions.

use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

use upm::run::RunError;

pyo3::create_exception!(upm, UpmError, PyValueError, "A refusal, in the words of the command line, a line each.");

/// The exception of a refusal.
pub fn refusal(lines: Vec<String>) -> PyErr {
    let lines: Vec<&str> = lines.iter().map(|line| line.strip_prefix("upm: ").unwrap_or(line)).collect();
    UpmError::new_err(lines.join("\n"))
}

/// The exception of a job that cannot be run.
pub fn said(error: RunError) -> PyErr {
    refusal(error.lines())
}
