//! The `upm-lab` command; all of its code is in the library.

use std::process::ExitCode;

fn main() -> ExitCode {
    upm_lab::main()
}
