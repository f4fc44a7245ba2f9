//! Names that arguments accept, for their checks and for shell completions.

use clap::Command;
use clap::builder::PossibleValuesParser;
use clap_complete::Shell;

use upm_runner::config::schema_names;

/// Files of a run folder that have a schema; the journal's is that of a line.
const FILES_OF_RUNS: [&str; 2] = ["journal", "report"];

/// The names of schemas.
pub fn schemas() -> PossibleValuesParser {
    PossibleValuesParser::new(names_of_schemas())
}

fn names_of_schemas() -> impl Iterator<Item = &'static str> {
    schema_names().iter().copied().chain(FILES_OF_RUNS)
}

/// The script of completions for a shell.
pub fn completions(shell: Shell, command: &mut Command) -> String {
    let mut script = Vec::new();
    clap_complete::generate(shell, command, "upm", &mut script);
    let mut script = String::from_utf8_lossy(&script).into_owned();
    if shell == Shell::Fish {
        // clap leaves out the values of positional arguments there
        let names = names_of_schemas().collect::<Vec<_>>().join(" ");
        script += &format!("complete -c upm -n \"__fish_upm_using_subcommand schema\" -f -a \"{names}\"\n");
    }
    script
}
