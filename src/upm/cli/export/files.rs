//! Files of run folders as they are read, and files under another name until they are whole.

use std::fmt::Display;
use std::fs::{self, File};
use std::io::{self, BufRead, BufReader, Read};
use std::path::{Path, PathBuf};

use serde_json::{Value, json};
use sha2::{Digest, Sha256};

use crate::cli::output::Failure;
use upm_recording::Report;
use upm_runner::config::reason;
use upm_runner::run::maker_of;

pub(super) const JOURNAL: &str = "journal.jsonl";
const EXPECTED: &str = "expected what `upm run` left in a run folder";

/// Largest report that is read, bytes.
const MOST_REPORT_BYTES: u64 = 16 << 20;
/// Longest line that is read, bytes; a cycle of some hundred pulses is far shorter.
const LONGEST_LINE: u64 = 16 << 20;

/// Files and folders that are not whole yet; those that are left are removed.
#[derive(Default)]
pub(crate) struct Drafts(pub Vec<PathBuf>);

impl Drop for Drafts {
    fn drop(&mut self) {
        for draft in &self.0 {
            if draft.is_dir() { fs::remove_dir_all(draft) } else { fs::remove_file(draft) }.unwrap_or_default();
        }
    }
}

/// Name of the file or folder `path` until it is whole.
pub(super) fn draft_of(path: &Path) -> PathBuf {
    path.with_added_extension("part")
}

pub(super) fn read_failed(path: &Path, error: &io::Error) -> Failure {
    Failure::bad_input(format!("cannot read {}: {}; {EXPECTED}", path.display(), reason(error)))
}

/// Report of the run; `None` for a run that never ended.
pub(super) fn report_of(run: &Path) -> Result<Option<Report>, Failure> {
    let path = run.join("report.json");
    let file = match File::open(&path) {
        Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(None),
        opened => opened.map_err(|error| Failure::read_failed(&path, &error))?,
    };
    let report = serde_json::from_reader(BufReader::new(file.take(MOST_REPORT_BYTES)));
    report.map(Some).map_err(|error| Failure::bad_input(format!("{}: {EXPECTED}, found {error}", path.display())))
}

/// A line of a journal.
#[derive(Default)]
pub(super) struct Line {
    pub kind: String,
    pub content: Value,
    place: String,
}

impl Line {
    /// Failure by something in this line that `upm run` never writes.
    pub fn fault(&self, found: impl Display) -> Failure {
        Failure::bad_input(format!("{}: {EXPECTED}, found {found}", self.place))
    }
}

/// Calls `take` with each line of the journal in folder `run`, to which it adds the report's `parts`. An incomplete
/// last line, as a killed run leaves it, counts as its end.
pub(super) fn read_lines(run: &Path, mut take: impl FnMut(Line) -> Result<(), Failure>) -> Result<(), Failure> {
    let parts = report_of(run)?.map_or(Value::Null, |report| json!(report.parts));
    let path = run.join(JOURNAL);
    let mut journal = BufReader::new(File::open(&path).map_err(|error| read_failed(&path, &error))?);
    let mut bytes = Vec::new();
    for number in 1.. {
        bytes.clear();
        let read = journal.by_ref().take(LONGEST_LINE).read_until(b'\n', &mut bytes);
        let read = read.map_err(|error| read_failed(&path, &error))?;
        let mut line = Line { place: format!("{}: line {number}", path.display()), ..Line::default() };
        if read as u64 == LONGEST_LINE && !bytes.ends_with(b"\n") {
            return Err(line.fault(format!("more than {LONGEST_LINE} bytes")));
        }
        if !bytes.ends_with(b"\n") {
            if read > 0 {
                tracing::warn!("{}: ends in half a line: the run was killed", path.display());
            }
            break;
        }
        line.content = serde_json::from_slice(&bytes).map_err(|error| line.fault(error))?;
        let kind = line.content.get("type").and_then(Value::as_str);
        line.kind = kind.ok_or_else(|| line.fault("no type"))?.to_owned();
        line.content["parts"] = parts.clone();
        take(line)?;
    }
    Ok(())
}

/// Where the run in folder `run` comes from, and by what its repetition is known: `seed`, `program` (with the hash of
/// its build), `journal_sha256`, and the effective `job` without its library, which `effective.json` has.
pub(super) fn provenance(run: &Path) -> Result<Value, Failure> {
    let read = |name: &str| fs::read(run.join(name)).map_err(|error| read_failed(&run.join(name), &error));
    let mut effective: Value = serde_json::from_slice(&read("effective.json")?).unwrap_or_default();
    let job = effective.get_mut("job").and_then(Value::as_object_mut);
    let Some((job, program)) = job.zip(maker_of(run)) else {
        return Err(Failure::bad_input(format!("{}: {EXPECTED}, found another effective.json", run.display())));
    };
    job.remove("library");
    let hash: String = Sha256::digest(read(JOURNAL)?).iter().map(|byte| format!("{byte:02x}")).collect();
    Ok(json!({ "seed": job["seed"], "program": program, "journal_sha256": hash, "job": job }))
}
