//! `upm init`: writes the shipped configurations into a folder.

use std::fs;
use std::path::Path;

use serde::Serialize;

use super::args::{Common, InitArgs};
use super::output::{Failure, print};
use super::shipped::FILES;

/// Outcome for the shipped files, by relative path.
#[derive(Debug, Default, Serialize)]
struct InitReport {
    folder: String,
    written: Vec<&'static str>,
    /// Files that already had the shipped text.
    unchanged: Vec<&'static str>,
    /// Files left alone because their text differs.
    kept: Vec<&'static str>,
}

pub(super) fn init(args: &InitArgs, common: Common) -> Result<u8, Failure> {
    let mut report = InitReport { folder: args.folder.display().to_string(), ..InitReport::default() };
    for &(name, text) in FILES {
        match fs::read(args.folder.join(name)) {
            Ok(found) if found == text.as_bytes() => report.unchanged.push(name),
            Ok(_) if !args.force => report.kept.push(name),
            _ => {
                write_shipped(&args.folder, name, text)?;
                report.written.push(name);
            }
        }
    }
    print(common.json, &report, || print_report(&args.folder, &report))
}

/// Writes the shipped file `name` into `folder`, with the folders in its path.
pub(super) fn write_shipped(folder: &Path, name: &str, text: &str) -> Result<(), Failure> {
    let path = folder.join(name);
    let parent = path.parent().unwrap_or(folder);
    fs::create_dir_all(parent).map_err(|error| Failure::write(parent, error))?;
    fs::write(&path, text).map_err(|error| Failure::write(&path, error))
}

fn print_report(folder: &Path, report: &InitReport) -> Result<(), Failure> {
    let InitReport { folder: shown, written, unchanged, kept } = report;
    outln!("{shown}: {} files written, {} there already", written.len(), unchanged.len())?;
    if !kept.is_empty() {
        outln!("kept as changed since (`--force` overwrites): {}", kept.join(", "))?;
    }
    outln!("try:")?;
    if !folder.as_os_str().is_empty() && folder != Path::new(".") {
        let is_plain = !shown.starts_with('-') && shown.chars().all(|c| c.is_alphanumeric() || "/._-+".contains(c));
        let word = if is_plain { shown.clone() } else { format!("-- '{}'", shown.replace('\'', r"'\''")) };
        outln!("  cd {word}")?;
    }
    outln!("  upm run configs/plus-sign.json                  # one coin along a plus sign")?;
    outln!("  upm run                                         # the jobs there are")?;
    outln!("  upm simulate configs/simulate/rotation.json     # given pulses, without a camera")?;
    outln!("  upm serve                                       # the daemon with its page")
}
