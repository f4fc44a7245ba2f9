use std::fs::{self, DirEntry, File, Metadata};
use std::io::{self, Read, Seek, SeekFrom};
use std::path::{Path, PathBuf};

use jiff::Timestamp;
use serde_json::{Value, json};

use super::redact::{REMOVED, scrub, scrubbed};
use super::rows::folder_name;
use crate::store::JobId;

/// Longest part of a journal that is read, from its end, bytes.
const TAIL_BYTES: u64 = 256 << 10;
/// Most lines of it that are kept.
const TAIL_LINES: usize = 50;

/// Folder of the latches in the data folder.
const LATCHES: &str = "latch";

/// Longest part of a latch file that is read, bytes; valid ones are shorter.
const LATCH_BYTES: u64 = 64;

#[derive(Debug)]
pub(super) struct BundledRun {
    pub path: PathBuf,
    pub bytes: u64,
    pub files: Vec<Value>,
    pub changed_at: Option<Timestamp>,
    /// Name of the bundle's file with its journal.
    pub journal: Option<String>,
}

impl BundledRun {
    pub fn json(&self, known: &[JobId]) -> Value {
        json!({
            "folder": self.path.file_name().map(|name| folder_name(&name.to_string_lossy(), known)),
            "bytes": self.bytes,
            "changed_at": self.changed_at.map(|at| at.to_string()),
            "files": self.files,
            "journal": self.journal,
        })
    }
}

/// Names and sizes of the entries directly in `folder`, by name.
pub(super) fn listed(folder: &Path) -> io::Result<Vec<Value>> {
    let entries = entries(folder)?;
    Ok(entries.iter().map(|(name, _, found)| json!({"name": scrub(name), "bytes": bytes_of(found)})).collect())
}

/// The contents of each plate's latch file.
pub(super) fn latches(data: &Path) -> io::Result<Vec<Value>> {
    let said = |(name, path, _): (String, PathBuf, Metadata)| {
        let mut text = String::new();
        let read = File::open(path).and_then(|file| file.take(LATCH_BYTES).read_to_string(&mut text));
        let says = if read.is_ok() { scrub(text.trim_end()) } else { REMOVED.to_owned() };
        json!({"plate": scrub(&name), "says": says})
    };
    Ok(entries(&data.join(LATCHES))?.into_iter().filter(|(_, _, found)| found.is_file()).map(said).collect())
}

/// The run folders, the last changed first.
pub(super) fn runs(folder: &Path) -> io::Result<Vec<BundledRun>> {
    let run = |(_, path, found): (String, PathBuf, Metadata)| {
        let within = entries(&path).unwrap_or_default();
        let changed_at = found.modified().ok().and_then(|at| Timestamp::try_from(at).ok());
        let file =
            |(name, _, found): &(String, PathBuf, Metadata)| json!({"name": scrub(name), "bytes": bytes_of(found)});
        BundledRun {
            bytes: within.iter().filter_map(|(_, _, found)| bytes_of(found)).sum(),
            files: within.iter().map(file).collect(),
            path,
            changed_at,
            journal: None,
        }
    };
    let mut runs: Vec<BundledRun> =
        entries(folder)?.into_iter().filter(|(_, _, found)| found.is_dir()).map(run).collect();
    runs.sort_by(|a, b| b.changed_at.cmp(&a.changed_at).then_with(|| a.path.cmp(&b.path)));
    Ok(runs)
}

/// The last lines of a journal. A line that is not valid JSON, such as a torn last one, is replaced by [`REMOVED`].
pub(super) fn tail(path: &Path) -> io::Result<Vec<Value>> {
    if !fs::symlink_metadata(path)?.is_file() {
        return Err(io::Error::new(io::ErrorKind::InvalidInput, "it is no file"));
    }
    let mut file = File::open(path)?;
    let begin = file.metadata()?.len().saturating_sub(TAIL_BYTES);
    file.seek(SeekFrom::Start(begin))?;
    let mut bytes = Vec::new();
    file.take(TAIL_BYTES).read_to_end(&mut bytes)?;
    let text = String::from_utf8_lossy(&bytes);
    // the first line began before the part that was read
    let lines: Vec<&str> = text.lines().skip(usize::from(begin > 0)).collect();
    let last = lines.iter().skip(lines.len().saturating_sub(TAIL_LINES));
    Ok(last.map(|line| serde_json::from_str(line).map_or(Value::from(REMOVED), scrubbed)).collect())
}

/// The entries of a folder, by name; links are not followed.
fn entries(folder: &Path) -> io::Result<Vec<(String, PathBuf, Metadata)>> {
    let one = |entry: io::Result<DirEntry>| {
        let entry = entry.ok()?;
        let found = fs::symlink_metadata(entry.path()).ok()?;
        Some((entry.file_name().to_string_lossy().into_owned(), entry.path(), found))
    };
    let mut entries: Vec<_> = fs::read_dir(folder)?.filter_map(one).collect();
    entries.sort_by(|(a, ..), (b, ..)| a.cmp(b));
    Ok(entries)
}

fn bytes_of(found: &Metadata) -> Option<u64> {
    found.is_file().then_some(found.len())
}
