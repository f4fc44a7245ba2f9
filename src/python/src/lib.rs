//! The Python module: arguments in, results out. Their meaning is in the crate `upm`.

mod job;
mod own;
mod plates;
mod refusal;
mod run;
mod waiting;

use std::ffi::OsString;

use pyo3::prelude::*;

use refusal::refusal;

/// The compiled half of `upm`.
#[pymodule(name = "_upm")]
mod upm_module {
    #[pymodule_export]
    use super::job::Job;
    #[pymodule_export]
    use super::own::SimulatedPlate;
    #[pymodule_export]
    use super::plates::Plates;
    #[pymodule_export]
    use super::refusal::UpmError;
    #[pymodule_export]
    use super::run::run;
    #[pymodule_export]
    use super::{answer, main, shipped_files};
}

/// The command line: runs `args`, the program's name first, and returns the exit status.
#[pyfunction]
fn main(py: Python<'_>, args: Vec<OsString>) -> u8 {
    py.detach(|| upm::cli::main_with(args))
}

/// Runs a command that answers with JSON, and returns that.
#[pyfunction]
fn answer(py: Python<'_>, args: Vec<OsString>) -> PyResult<String> {
    waiting::until_done(py, move |stop| upm::cli::answer(args, stop))?.map_err(refusal)
}

/// Path and text of each shipped file.
#[pyfunction]
fn shipped_files() -> Vec<(&'static str, &'static str)> {
    upm::cli::shipped_files().to_vec()
}
