//! Examples on the help page of every command.

use clap::{Command, CommandFactory};

use super::args::Cli;

/// Commands with their examples; a build without the daemon lacks some of them.
const EXAMPLES: [(&str, &[&str]); 25] = [
    ("init", &["upm init", "upm init upm-jobs --force"]),
    ("run", &["upm run configs/letters-16.json --movie letters.gif", "upm run configs/sort-8.json --seeds 1..20"]),
    ("campaign", &["upm campaign configs/campaigns/two-planners.json", "upm campaign merge campaigns/two-planners"]),
    ("calibrate", &["upm calibrate --rig configs/rigs/upm-2.json --out library.json"]),
    ("render", &["upm render configs/arrange-4.json --out frame.png --truth truth.json"]),
    ("locate", &["upm locate table.jpg --coins eu --plate-side-mm 203.2", "upm locate table.jpg --rectangle 297x210"]),
    ("simulate", &["upm simulate configs/simulate/rotation.json --json"]),
    ("replay", &["upm replay last"]),
    ("verify", &["upm verify last", "upm verify arrange-4 --out runs", "upm verify data-set"]),
    ("benchmark", &["upm benchmark arrange-8 --seeds 1..5 > rows.jsonl", "upm benchmark --check rows.jsonl"]),
    ("export", &["upm export last --csv", "upm export runs/x-* --lerobot x", "upm export last --mcap x.mcap"]),
    ("serve", &["upm serve", "upm serve --config configs/daemon.json --check"]),
    ("submit", &["upm submit job.json --plate upm-2 --watch"]),
    ("jobs", &["upm jobs --state failed"]),
    ("show", &["upm show last", "upm show arrange-4"]),
    ("watch", &["upm watch last"]),
    ("run-next", &["upm run-next arrange-4"]),
    ("cancel", &["upm cancel last"]),
    ("plates", &["upm plates", "upm plates --json"]),
    ("estop", &["upm estop", "upm estop upm-2"]),
    ("reset", &["upm reset upm-2 --operator Ann --reason 'coin put back'"]),
    ("resume", &["upm resume upm-2", "upm resume upm-2 --operator Ann"]),
    ("check", &["upm check job.json --plan --picture plan.svg", "upm check job.json --plan --seeds 1..20"]),
    ("schema", &["upm schema job > job-schema.json"]),
    ("completions", &["upm completions bash > ~/.local/share/bash-completion/completions/upm"]),
];

/// The command line with the examples below each command's options.
pub(super) fn command() -> Command {
    let has = |command: &Command, name: &str| command.find_subcommand(name).is_some();
    EXAMPLES.iter().fold(Cli::command(), |all, (name, lines)| {
        let with_lines = |command: Command| {
            let before = command.get_after_help().map(|text| format!("{text}\n\n")).unwrap_or_default();
            command.after_help(format!("{before}Examples:\n  {}", lines.join("\n  ")))
        };
        if has(&all, name) { all.mut_subcommand(name, with_lines) } else { all }
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
