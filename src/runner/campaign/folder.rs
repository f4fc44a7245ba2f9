use std::collections::HashSet;
use std::fs::{self, File, OpenOptions, TryLockError};
use std::io::{self, BufRead, BufReader, Read, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};

use super::file::Campaign;
use super::line::RunLine;
use crate::run::{RunError, program};
use upm_core::document::{Diagnostic, reason};
use upm_core::files::write_whole;

/// Name of the file with the facts of a campaign.
const FACTS_FILE: &str = "campaign.json";
/// Most shards of a campaign.
pub const MOST_SHARDS: usize = 10_000;
/// Folder of the runs that are kept.
pub(super) const KEPT: &str = "kept";

/// The campaign and program that a folder is of.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FolderFacts {
    /// Name of the campaign.
    pub name: String,
    /// Hash of the campaign.
    pub campaign: String,
    /// Hash of the program that makes the runs.
    pub program: String,
    /// Number of shards that the runs are divided into.
    pub shards: usize,
    /// Number of all runs.
    pub runs: usize,
    /// Values of each cell.
    pub cells: Vec<String>,
    /// Command that judges the runs, where there is one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub judge: Option<String>,
}

impl FolderFacts {
    /// Facts of `campaign` in so many shards, run by this program and judged by a command.
    pub fn of(campaign: &Campaign, shards: usize, judge: Option<&str>) -> Self {
        Self {
            name: campaign.name.clone(),
            campaign: campaign.hash(),
            program: program(),
            shards,
            runs: campaign.runs(),
            cells: (0..campaign.cells()).map(|cell| campaign.cell_name(cell)).collect(),
            judge: judge.map(str::to_owned),
        }
    }

    /// Numbers, from 0, of the runs of a shard.
    pub fn runs_of(&self, shard: usize) -> std::ops::Range<usize> {
        let from = |shard: usize| (shard as u128 * self.runs as u128 / self.shards as u128) as usize;
        from(shard)..from(shard + 1)
    }

    /// The reason why lines of `other` cannot be counted with these: both hashes.
    fn differs(&self, other: &Self, file: &Path) -> Option<Diagnostic> {
        let [ours, theirs] = [self, other].map(|facts| facts.judge.clone().unwrap_or("none".into()));
        let hashes = [
            ("campaign", &self.campaign, &other.campaign),
            ("program", &self.program, &other.program),
            ("judge", &ours, &theirs),
        ];
        let (what, ours, theirs) = hashes.into_iter().find(|(_, ours, theirs)| ours != theirs)?;
        let (found, allowed) =
            (format!("runs of {what} {theirs}"), format!("those of {what} {ours}, or an empty folder"));
        Some(Diagnostic::new(&file.display().to_string(), what, found, allowed))
    }
}

/// The folder of a campaign: its facts, and a file of lines for each shard.
#[derive(Clone, Debug)]
pub struct CampaignFolder {
    path: PathBuf,
    /// Its campaign and program.
    pub facts: FolderFacts,
}

impl CampaignFolder {
    /// The folder at `path`, made if it is not there.
    ///
    /// # Errors
    /// A folder of another campaign or program, or of another number of shards, and errors of writing.
    pub fn open_or_create(path: &Path, facts: FolderFacts) -> Result<Self, RunError> {
        let file = path.join(FACTS_FILE);
        if !file.exists() {
            let text = serde_json::to_string_pretty(&facts).unwrap_or_default() + "\n";
            // processes that begin at the same time write the same
            let draft = path.join(format!("{FACTS_FILE}.{}.part", std::process::id()));
            let written = fs::create_dir_all(path).and_then(|()| write_whole(&draft, &file, text.as_bytes()));
            written.map_err(|error| RunError::write(&file, &error))?;
        }
        let found = Self::open(path)?;
        if let Some(fault) = facts.differs(&found.facts, &file) {
            return Err(fault.into());
        }
        if facts.shards != found.facts.shards {
            let allowed = format!("I/{} as in {}", found.facts.shards, file.display());
            return Err(Diagnostic::new("--shard", "$", format!("I/{}", facts.shards), allowed).into());
        }
        Ok(found)
    }

    /// The folder at `path`.
    ///
    /// # Errors
    /// No folder of a campaign.
    pub fn open(path: &Path) -> Result<Self, RunError> {
        let file = path.join(FACTS_FILE);
        let name = file.display().to_string();
        let text = fs::read_to_string(&file).map_err(|error| Diagnostic::unreadable(&name, reason(&error)))?;
        let facts = serde_json::from_str::<FolderFacts>(&text);
        let facts = facts.map_err(|error| Diagnostic::new(&name, "$", error, "what `upm campaign` wrote"))?;
        if !(1..=MOST_SHARDS).contains(&facts.shards) {
            return Err(Diagnostic::new(&name, "shards", facts.shards, format!("1 to {MOST_SHARDS}")).into());
        }
        Ok(Self { path: path.to_owned(), facts })
    }

    /// Its path.
    pub fn path(&self) -> &Path {
        &self.path
    }

    fn shard_path(&self, shard: usize) -> PathBuf {
        self.path.join(format!("shard-{:03}.jsonl", shard + 1))
    }

    /// Opens the file of a shard for appending, for this process alone. A line that was not finished is cut off.
    pub(super) fn shard(&self, shard: usize) -> Result<ShardFile, RunError> {
        let path = self.shard_path(shard);
        let opened = OpenOptions::new().create(true).read(true).append(true).open(&path);
        let mut file = opened.map_err(|error| RunError::write(&path, &error))?;
        match file.try_lock() {
            Ok(()) => {}
            Err(TryLockError::WouldBlock) => {
                let name = path.display().to_string();
                return Err(
                    Diagnostic::new(&name, "$", "a shard that another process runs", "one that none runs").into()
                );
            }
            // a file system without locks: the caller's engine sees to it
            Err(TryLockError::Error(error)) => tracing::debug!("{}: no lock: {error}", path.display()),
        }
        let mut bytes = Vec::new();
        file.read_to_end(&mut bytes).map_err(|error| unreadable(&path, &error))?;
        let whole = bytes.iter().rposition(|byte| *byte == b'\n').map_or(0, |end| end + 1);
        file.set_len(whole as u64).map_err(|error| RunError::write(&path, &error))?;
        let lines = bytes[..whole].split(|byte| *byte == b'\n').map(serde_json::from_slice::<RunLine>);
        let present = lines.filter_map(Result::ok).map(|line| (line.run, line.key)).collect();
        Ok(ShardFile { file, path, length: whole as u64, present })
    }

    /// The whole lines of a shard, in the order of their runs, from this folder and `others` of the same campaign, each
    /// run once, and the number of lines that repeat another one. Damaged lines are left out: their runs are missing,
    /// and are made again.
    ///
    /// # Errors
    /// Two lines of one run with different jobs, and errors of reading.
    pub fn lines_of(&self, shard: usize, others: &[Self]) -> Result<(Vec<RunLine>, usize), RunError> {
        let mut lines: Vec<RunLine> = Vec::new();
        std::iter::once(self).chain(others).try_for_each(|folder| folder.read_lines(shard, &mut lines))?;
        lines.sort_by_key(|line| line.run);
        let all = lines.len();
        if let Some([a, b]) = lines.array_windows().find(|[a, b]| a.run == b.run && a.key != b.key) {
            let (found, allowed) = (format!("run {} of job {}", b.run, b.key), format!("of job {}", a.key));
            return Err(Diagnostic::new(&self.shard_path(shard).display().to_string(), "key", found, allowed).into());
        }
        lines.dedup_by_key(|line| line.run);
        let doubled = all - lines.len();
        Ok((lines, doubled))
    }

    fn read_lines(&self, shard: usize, lines: &mut Vec<RunLine>) -> Result<(), RunError> {
        let path = self.shard_path(shard);
        let file = match File::open(&path) {
            Ok(file) => file,
            Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(()),
            Err(error) => return Err(unreadable(&path, &error)),
        };
        let (mut reader, mut bytes) = (BufReader::with_capacity(1 << 18, file), Vec::new());
        loop {
            bytes.clear();
            reader.read_until(b'\n', &mut bytes).map_err(|error| unreadable(&path, &error))?;
            // the last line may be under way
            if bytes.last() != Some(&b'\n') {
                return Ok(());
            }
            lines.extend(serde_json::from_slice::<RunLine>(&bytes));
        }
    }

    /// Fails if `other` is of another campaign or another program.
    ///
    /// # Errors
    /// Both hashes.
    pub fn check_same(&self, other: &Self) -> Result<(), RunError> {
        self.facts.differs(&other.facts, &other.path.join(FACTS_FILE)).map_or(Ok(()), |fault| Err(fault.into()))
    }
}

fn unreadable(path: &Path, error: &io::Error) -> RunError {
    Diagnostic::unreadable(&path.display().to_string(), reason(error)).into()
}

/// The lines of a shard, locked for one process.
#[derive(Debug)]
pub(super) struct ShardFile {
    file: File,
    path: PathBuf,
    length: u64,
    present: HashSet<(usize, String)>,
}

impl ShardFile {
    /// True if there is a line of this run with its job and program.
    pub fn has(&self, line: &RunLine) -> bool {
        self.present.contains(&(line.run, line.key.clone()))
    }

    /// Appends a line by one write. Where that fails, the lines so far stay whole.
    pub fn append(&mut self, line: &RunLine) -> Result<(), RunError> {
        let text = line.to_text();
        let written = self.file.write(text.as_bytes());
        let written =
            written.and_then(|n| if n == text.len() { Ok(()) } else { Err(io::ErrorKind::StorageFull.into()) });
        if let Err(error) = written {
            self.file.set_len(self.length).ok();
            self.file.seek(SeekFrom::End(0)).ok();
            return Err(RunError::write(&self.path, &error));
        }
        self.length += text.len() as u64;
        self.present.insert((line.run, line.key.clone()));
        Ok(())
    }
}
