//! `upm init`: writes the shipped configurations into a folder.

use std::fs::{self, File};
use std::io::{ErrorKind, Write};
use std::path::{Path, PathBuf};

use serde_json::json;

use super::args::{Common, InitArgs};
use super::output::{Failure, print};
use super::shipped::FILES;

/// Outcome for the shipped files, by relative path.
#[derive(Debug, Default)]
struct InitReport {
    written: Vec<&'static str>,
    /// Files that already had the shipped text.
    unchanged: Vec<&'static str>,
    /// Files left alone because their text differs.
    kept: Vec<&'static str>,
}

pub(super) fn init(args: &InitArgs, common: Common) -> Result<u8, Failure> {
    let mut laid = InitReport::default();
    for &(name, text) in FILES {
        let list = match lay(&args.folder.join(name), text, args.force)? {
            FileOutcome::Written => &mut laid.written,
            FileOutcome::Unchanged => &mut laid.unchanged,
            FileOutcome::Kept => &mut laid.kept,
        };
        list.push(name);
    }
    let InitReport { written, unchanged, kept } = &laid;
    let folder = args.folder.display().to_string();
    let value = json!({ "folder": folder, "written": written, "unchanged": unchanged, "kept": kept });
    print(common.json, &value, || say_laid(&args.folder, &laid))
}

enum FileOutcome {
    Written,
    Unchanged,
    Kept,
}

/// Writes one file. Without `force`, an existing file is left as it is.
fn lay(path: &Path, text: &str, force: bool) -> Result<FileOutcome, Failure> {
    let failed = |error| Failure::write(path, error);
    if let Some(folder) = path.parent() {
        fs::create_dir_all(folder).map_err(|error| Failure::write(folder, error))?;
    }
    match File::create_new(path) {
        Ok(mut file) => file.write_all(text.as_bytes()).map(|()| FileOutcome::Written).map_err(failed),
        Err(error) if error.kind() == ErrorKind::AlreadyExists => {
            if fs::read(path).is_ok_and(|there| there == text.as_bytes()) {
                Ok(FileOutcome::Unchanged)
            } else if force {
                fs::write(path, text).map(|()| FileOutcome::Written).map_err(failed)
            } else {
                Ok(FileOutcome::Kept)
            }
        }
        Err(error) => Err(failed(error)),
    }
}

fn say_laid(folder: &Path, laid: &InitReport) -> Result<(), Failure> {
    let InitReport { written, unchanged, kept } = laid;
    let shown = folder.display();
    let there = if unchanged.is_empty() { String::new() } else { format!(", {} there already", unchanged.len()) };
    outln!("{shown}: {} written{there}", files(written.len()))?;
    for (folder, count) in by_folder(written) {
        outln!("  {:20} {}", format!("{}/", folder.display()), files(count))?;
    }
    if !kept.is_empty() {
        outln!(
            "{} changed since, kept as {} (`--force` overwrites): {}",
            files(kept.len()),
            are(kept.len()),
            kept.join(", ")
        )?;
    }
    outln!("try:")?;
    if !folder.as_os_str().is_empty() && folder != Path::new(".") {
        outln!("  cd {}", quoted(&shown.to_string()))?;
    }
    outln!("  upm run configs/plus-sign.json                  # one coin along a plus sign")?;
    outln!("  upm run                                         # the jobs there are")?;
    outln!("  upm simulate configs/simulate/rotation.json     # given pulses, without a camera")?;
    outln!("  upm serve                                       # the daemon with its page")
}

fn files(count: usize) -> String {
    if count == 1 { "1 file".to_owned() } else { format!("{count} files") }
}

fn are(count: usize) -> &'static str {
    if count == 1 { "it is" } else { "they are" }
}

/// Folders of `names`, which are sorted, with the number of files in each.
fn by_folder(names: &[&str]) -> Vec<(PathBuf, usize)> {
    let mut folders: Vec<(PathBuf, usize)> = Vec::new();
    for name in names {
        let folder = Path::new(name).parent().unwrap_or(Path::new(""));
        match folders.iter_mut().find(|(known, _)| known == folder) {
            Some((_, count)) => *count += 1,
            None => folders.push((folder.to_owned(), 1)),
        }
    }
    folders
}

/// Quotes a word for a shell.
fn quoted(word: &str) -> String {
    let is_plain = |c: char| c.is_alphanumeric() || "/._-+".contains(c);
    if !word.is_empty() && !word.starts_with('-') && word.chars().all(is_plain) {
        word.to_owned()
    } else {
        format!("-- '{}'", word.replace('\'', "'\\''"))
    }
}
