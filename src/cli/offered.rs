//! Shell completions for the values of arguments.

use std::ffi::OsStr;

use clap::builder::{PossibleValue, StringValueParser, TypedValueParser};
use clap::{Arg, Command, Error};
use clap_complete::Shell;

use upm_runner::config::schema_names;

/// Files of a run folder that have a schema; the journal's is that of a line.
const FILES_OF_RUNS: [&str; 2] = ["journal", "report"];

/// The modes of a recording.
const RERUN_MODES: [&str; 4] = ["off", "save", "connect", "spawn"];

/// Value parser that accepts any text and completes these names. The command itself refuses other names, with its own
/// message.
#[derive(Clone, Debug)]
pub struct CompletableName(Vec<&'static str>);

impl CompletableName {
    pub fn names(&self) -> &[&'static str] {
        &self.0
    }
}

impl TypedValueParser for CompletableName {
    type Value = String;

    fn parse_ref(&self, command: &Command, arg: Option<&Arg>, value: &OsStr) -> Result<String, Error> {
        StringValueParser::new().parse_ref(command, arg, value)
    }

    fn possible_values(&self) -> Option<Box<dyn Iterator<Item = PossibleValue> + '_>> {
        Some(Box::new(self.0.iter().map(|&name| PossibleValue::new(name))))
    }
}

/// The names of schemas.
pub fn schemas() -> CompletableName {
    CompletableName(schema_names().iter().copied().chain(FILES_OF_RUNS).collect())
}

/// Values of `--rerun` for completions.
pub fn rerun_modes() -> CompletableName {
    CompletableName(RERUN_MODES.to_vec())
}

/// The script of completions for a shell.
pub fn completions(shell: Shell, command: &mut Command) -> String {
    let mut script = Vec::new();
    clap_complete::generate(shell, command, "upm", &mut script);
    let mut script = String::from_utf8_lossy(&script).into_owned();
    if shell == Shell::Fish {
        // clap leaves out the values of positional arguments there
        let names = schemas().names().join(" ");
        script += &format!("complete -c upm -n \"__fish_upm_using_subcommand schema\" -f -a \"{names}\"\n");
    }
    script
}
