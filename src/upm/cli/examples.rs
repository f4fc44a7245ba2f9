//! Examples on the help page of every command.

use clap::{Command, CommandFactory};

use super::args::Cli;

/// Examples, those of a command one after the other; a build without the daemon lacks some of the commands.
const EXAMPLES: &str = include_str!(concat!(env!("CARGO_MANIFEST_DIR"), "/assets/help-examples.txt"));

/// The command line with the examples below each command's options.
pub(super) fn command() -> Command {
    let name = |line: &str| line.split(' ').nth(1).unwrap_or_default().to_owned();
    let lines: Vec<&str> = EXAMPLES.lines().collect();
    lines.chunk_by(|a, b| name(a) == name(b)).fold(Cli::command(), |all, lines| {
        let with_lines = |command: Command| {
            let before = command.get_after_help().map(|text| format!("{text}\n\n")).unwrap_or_default();
            command.after_help(format!("{before}Examples:\n  {}", lines.join("\n  ")))
        };
        let name = name(lines[0]);
        if all.find_subcommand(&name).is_some() { all.mut_subcommand(name, with_lines) } else { all }
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_command_has_examples_and_takes_them() {
        let commands = command();
        for of in commands.get_subcommands() {
            let help = of.get_after_help().map(ToString::to_string).unwrap_or_default();
            assert!(help.contains(&format!("\n  upm {}", of.get_name())), "{}", of.get_name());
            for line in help.lines().filter_map(|line| line.strip_prefix("  upm ")) {
                let words = line.split(" > ").next().unwrap_or_default().replace("'coin put back'", "reason");
                let parsed = command().try_get_matches_from(format!("upm {words}").split(' '));
                assert!(parsed.is_ok(), "{line}: {}", parsed.unwrap_err());
            }
        }
    }
}
