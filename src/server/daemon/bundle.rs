//! The support bundle: one tar archive for remote diagnosis. It is made with or without a running daemon, does not
//! disturb it, and holds no secrets.

mod folder;
mod redact;
mod rows;
#[cfg(test)]
mod tests;

use std::io;
use std::path::Path;

use jiff::Timestamp;
use serde_json::{Value, json};
use tar::{Builder, Header};

use self::folder::{BundledRun, latches, listed, runs, tail};
use crate::store::{InspectLimits, JobId, inspect};
use upm_runner::config::{DaemonSpec, Diagnostic, reason};

/// Folder within the archive.
const ROOT: &str = "upm-support";

const MOST: InspectLimits = InspectLimits { jobs: 200, events: 1000, audit: 200 };

/// Newest run folders that are listed, and those of them whose journals are included.
const LISTED_RUNS: usize = 200;
const SHOWN_RUNS: usize = 5;

const README: &str = "\
Made by `upm support-bundle`. Everything is text; jobs, events and audit stand newest first.

about.json     the program, and what could not be read
config.json    the configuration with every default; paths and names of hosts removed
jobs.json      the newest jobs, how many there are of each plate in each state, which plates are paused
events.jsonl   the newest events of jobs
audit.jsonl    the last lines of the audit log
data.json      sizes of the files in the data folder, the latches of the plates
runs.json      the newest run folders and their sizes
journals/      the last lines of the journals of the newest runs

Tokens are never read. In texts that people or programs wrote, paths, values after words such as password, and
random-looking strings are replaced by [removed]. A passphrase of ordinary words in the name of a job cannot be
distinguished from a name: look through the files before you send them.

Logs are not in here. Under systemd, read them with
    journalctl -u upm --since -1d > upm.log
and otherwise they went to stderr of `upm serve`.
";

/// Inputs of a bundle.
#[derive(Clone, Copy, Debug)]
pub struct BundleSources<'a> {
    /// The program's version.
    pub version: &'a str,
    /// Build target, as `x86_64-linux`.
    pub target: &'a str,
    /// Time the bundle is made.
    pub now: Timestamp,
    /// The configuration, or its faults.
    pub config: Result<&'a DaemonSpec, &'a [Diagnostic]>,
    /// The data folder; `None` where it is unknown.
    pub data: Option<&'a Path>,
}

/// A support bundle.
#[derive(Clone, Debug)]
pub struct Bundle {
    /// The tar archive.
    pub tar: Vec<u8>,
    /// Names of the files in it.
    pub files: Vec<String>,
    /// Sources that could not be read, a sentence each.
    pub missing: Vec<String>,
}

/// Makes a bundle. Sources that cannot be read are listed in it. Writes nothing and takes none of the daemon's locks.
pub fn bundle(sources: &BundleSources<'_>) -> io::Result<Bundle> {
    let mut made =
        BundleBuilder { tar: Builder::new(Vec::new()), at: sources.now, files: Vec::new(), missing: Vec::new() };
    made.add("README.txt", README.as_bytes())?;
    made.add_config(sources.config)?;
    match sources.data {
        Some(data) => {
            let known = made.add_store(data)?;
            made.add_data(data)?;
            made.add_runs(&data.join("runs"), &known)?;
        }
        None => made.missing.push("data folder: no --data and no --config was given".to_owned()),
    }
    made.add_about(sources)?;
    Ok(Bundle { tar: made.tar.into_inner()?, files: made.files, missing: made.missing })
}

struct BundleBuilder {
    tar: Builder<Vec<u8>>,
    at: Timestamp,
    files: Vec<String>,
    missing: Vec<String>,
}

impl BundleBuilder {
    fn add(&mut self, name: &str, content: &[u8]) -> io::Result<()> {
        let name = format!("{ROOT}/{name}");
        let mut header = Header::new_ustar();
        header.set_mode(0o600);
        header.set_mtime(self.at.as_second().max(0).unsigned_abs());
        header.set_size(content.len() as u64);
        self.tar.append_data(&mut header, &name, content)?;
        self.files.push(name);
        Ok(())
    }

    fn add_json(&mut self, name: &str, value: &Value) -> io::Result<()> {
        self.add(name, format!("{value:#}\n").as_bytes())
    }

    fn add_lines(&mut self, name: &str, lines: impl IntoIterator<Item = Value>) -> io::Result<()> {
        let lines: String = lines.into_iter().map(|line| format!("{line}\n")).collect();
        self.add(name, lines.as_bytes())
    }

    fn add_about(&mut self, sources: &BundleSources<'_>) -> io::Result<()> {
        let about = json!({
            "version": sources.version,
            "target": sources.target,
            "rerun": upm_viewer::BUILT_IN,
            "made_at": sources.now.to_string(),
            "missing": self.missing,
        });
        self.add_json("about.json", &about)
    }

    /// Adds the configuration. The faults of an invalid one are listed without the values found, which may be secrets.
    fn add_config(&mut self, config: Result<&DaemonSpec, &[Diagnostic]>) -> io::Result<()> {
        match config {
            Ok(spec) => self.add_json("config.json", &redact::configuration(spec.effective())),
            Err(faults) => {
                self.missing.push(format!("the configuration has {} faults", faults.len()));
                let shown = |fault: &Diagnostic| json!({"path": redact::scrub(&fault.path), "allowed": redact::scrub(&fault.expected)});
                let faults: Vec<Value> = faults.iter().map(shown).collect();
                self.add_json("config.json", &json!({ "faults": faults }))
            }
        }
    }

    /// Adds the contents of the store; returns the ids of its jobs.
    fn add_store(&mut self, data: &Path) -> io::Result<Vec<JobId>> {
        let snapshot = match inspect(data, MOST) {
            Ok(snapshot) => snapshot,
            Err(fault) => {
                self.missing.push(redact::scrub(&fault.to_string()));
                return Ok(Vec::new());
            }
        };
        self.add_json("jobs.json", &rows::jobs(&snapshot))?;
        self.add_lines("events.jsonl", snapshot.events.iter().map(|(job, event)| rows::event(job, event)))?;
        self.add_lines("audit.jsonl", snapshot.audit.iter().map(rows::act))?;
        Ok(snapshot.jobs.iter().map(|row| row.id).collect())
    }

    fn add_data(&mut self, data: &Path) -> io::Result<()> {
        let files = self.read("the data folder", listed(data));
        let latches = self.read("the latches", latches(data));
        self.add_json("data.json", &json!({"files": files, "latches": latches}))
    }

    fn add_runs(&mut self, folder: &Path, known: &[JobId]) -> io::Result<()> {
        let mut runs: Vec<BundledRun> = self.read("the run folders", runs(folder));
        let (count, bytes) = (runs.len(), runs.iter().map(|run| run.bytes).sum::<u64>());
        runs.truncate(LISTED_RUNS);
        for (number, run) in (1..).zip(runs.iter_mut().take(SHOWN_RUNS)) {
            let name = format!("journals/{number}.jsonl");
            match tail(&run.path.join("journal.jsonl")) {
                Ok(lines) => self.add_lines(&name, lines)?,
                Err(error) => {
                    self.missing.push(format!("{name}: {}", reason(&error)));
                    continue;
                }
            }
            run.journal = Some(name);
        }
        let listed: Vec<Value> = runs.iter().map(|run| run.json(known)).collect();
        self.add_json("runs.json", &json!({"count": count, "bytes": bytes, "newest": listed}))
    }

    /// The value that was read; on an error the default, with the error noted as missing.
    fn read<T: Default>(&mut self, what: &str, read: io::Result<T>) -> T {
        read.unwrap_or_else(|error| {
            self.missing.push(format!("{what}: {}", reason(&error)));
            T::default()
        })
    }
}
