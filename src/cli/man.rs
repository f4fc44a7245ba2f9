use std::fs;
use std::io::Write;
use std::path::Path;

use clap::CommandFactory;
use clap_mangen::Man;
use clap_mangen::roff::{Roff, roman};

use super::args::{Cli, ManArgs};
use super::output::Failure;

const MANUAL: &str = "Universal planar manipulator";

const EXIT_STATUS: [(&str, &str); 3] = [
    ("0", "Done."),
    ("1", "The job ran and did not reach its goal, or the command could not do its work."),
    ("2", "Bad usage or a bad file; one line a fault on stderr."),
];

/// Meaning of exit status 130 of a command; `None` for commands that do not handle Ctrl-C, and for the daemon, which
/// shuts down in order.
fn interrupted(command: &str) -> Option<&'static str> {
    match command {
        "upm" => Some("Ended by Ctrl-C."),
        "run" => Some("Interrupted: motors at zero, the run folder complete up to then."),
        "calibrate" => Some("Interrupted: no library was written."),
        "verify" => Some("Interrupted: the run was not compared to its end."),
        "submit" | "watch" => Some("No longer watching; the job goes on."),
        _ => None,
    }
}

/// Writes `upm.1` to stdout, or into a folder with one page per command, as packagers need them.
pub(super) fn man(args: &ManArgs) -> Result<u8, Failure> {
    let pages = pages().map_err(Failure::failed)?;
    let Some(folder) = &args.out else {
        // the first page is the program's
        for (_, page) in pages.iter().take(1) {
            outln!("{}", String::from_utf8_lossy(page).trim_end())?;
        }
        return Ok(0);
    };
    fs::create_dir_all(folder).map_err(|error| Failure::write(folder, error))?;
    for (name, page) in &pages {
        write(&folder.join(name), page)?;
    }
    outln!("{}: {} pages", folder.display(), pages.len())?;
    Ok(0)
}

fn write(path: &Path, page: &[u8]) -> Result<(), Failure> {
    fs::write(path, page).map_err(|error| Failure::write(path, error))
}

/// Names and contents of all pages, the program's first.
fn pages() -> std::io::Result<Vec<(String, Vec<u8>)>> {
    let mut command = Cli::command().disable_help_subcommand(true);
    command.build();
    let shown = command.get_subcommands().filter(|command| !command.is_hide_set()).cloned();
    let mut pages = Vec::new();
    for command in std::iter::once(command.clone()).chain(shown) {
        let interrupted = interrupted(command.get_name());
        let man = Man::new(command).manual(MANUAL);
        let mut page = Vec::new();
        man.render(&mut page)?;
        put_exit_status(&mut page, interrupted)?;
        pages.push((man.get_filename(), page));
    }
    Ok(pages)
}

fn put_exit_status(page: &mut dyn Write, interrupted: Option<&'static str>) -> std::io::Result<()> {
    let mut roff = Roff::new();
    roff.control("SH", ["EXIT STATUS"]);
    for (status, meaning) in EXIT_STATUS.into_iter().chain(interrupted.map(|meaning| ("130", meaning))) {
        roff.control("TP", []);
        roff.text([roman(status)]);
        roff.text([roman(meaning)]);
    }
    page.write_all(roff.to_roff().as_bytes())
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use super::*;

    #[test]
    fn every_command_that_is_shown_has_a_page() {
        let pages = pages().unwrap();
        assert_eq!(pages[0].0, "upm.1");
        let names: BTreeSet<&str> = pages.iter().map(|(name, _)| name.as_str()).collect();
        for command in Cli::command().get_subcommands() {
            let name = format!("upm-{}.1", command.get_name());
            assert_eq!(names.contains(name.as_str()), !command.is_hide_set(), "{name}");
        }
        for (name, page) in &pages {
            let page = String::from_utf8(page.clone()).unwrap();
            assert!(page.contains(".TH upm") && page.contains(".SH \"EXIT STATUS\""), "{name}: {page}");
        }
    }

    #[test]
    fn man_pages_state_the_effect_of_an_interrupt() {
        let pages = pages().unwrap();
        let page = |name: &str| {
            let (_, page) = pages.iter().find(|(of, _)| of == name).unwrap();
            String::from_utf8(page.clone()).unwrap()
        };
        for (name, meaning) in [
            ("upm-run.1", "motors at zero"),
            ("upm-submit.1", "the job goes on"),
            ("upm-watch.1", "the job goes on"),
            ("upm.1", "130"),
        ] {
            assert!(page(name).contains(meaning), "{name}");
        }
        for name in ["upm-serve.1", "upm-jobs.1"] {
            assert!(!page(name).contains("130"), "{name}");
        }
    }
}
