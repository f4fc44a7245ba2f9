//! Shell completions for the values of arguments.

use std::ffi::OsStr;

use clap::builder::{PossibleValue, StringValueParser, TypedValueParser};
use clap::{Arg, Command, Error};

use upm_runner::config::schema_names;

/// Files of a run folder that have a schema; the journal's is that of a line.
const FILES_OF_RUNS: [&str; 2] = ["journal", "report"];

/// The modes of a recording.
const RERUN_MODES: [&str; 4] = ["off", "save", "connect", "spawn"];

/// Value parser that accepts any text and completes these names. The command itself refuses other names, with its own
/// message.
#[derive(Clone, Debug)]
pub struct Offered(Vec<&'static str>);

impl Offered {
    pub fn names(&self) -> &[&'static str] {
        &self.0
    }
}

impl TypedValueParser for Offered {
    type Value = String;

    fn parse_ref(&self, command: &Command, arg: Option<&Arg>, value: &OsStr) -> Result<String, Error> {
        StringValueParser::new().parse_ref(command, arg, value)
    }

    fn possible_values(&self) -> Option<Box<dyn Iterator<Item = PossibleValue> + '_>> {
        Some(Box::new(self.0.iter().map(|&name| PossibleValue::new(name))))
    }
}

/// The names of schemas.
pub fn schemas() -> Offered {
    Offered(schema_names().iter().copied().chain(FILES_OF_RUNS).collect())
}

/// The modes of `--rerun`.
pub fn rerun_modes() -> Offered {
    Offered(RERUN_MODES.to_vec())
}

/// The experiments of `upm lab`.
pub fn experiments() -> Offered {
    #[cfg(feature = "lab")]
    let names = upm_lab::EXPERIMENTS.iter().map(|experiment| experiment.name).chain(["all"]);
    #[cfg(not(feature = "lab"))]
    let names = std::iter::empty();
    Offered(names.collect())
}

/// The families of drawn scenes.
pub fn scenes() -> Offered {
    #[cfg(feature = "lab")]
    let names = upm_scene::Difficulty::ALL.iter().map(|difficulty| difficulty.name());
    #[cfg(not(feature = "lab"))]
    let names = std::iter::empty();
    Offered(names.collect())
}
