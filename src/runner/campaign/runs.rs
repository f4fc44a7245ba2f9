use std::collections::HashMap;
use std::collections::hash_map::Entry;
use std::fs;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, AtomicUsize, Ordering};

use parking_lot::Mutex;

use super::file::{Campaign, hash_of};
use super::folder::{CampaignFolder, KEPT, ShardFile};
use super::judge::Judge;
use super::line::RunLine;
use crate::config::{JobSpec, LibraryRef};
use crate::run::{
    InMemoryRun, OwnParts, PacingStats, RunError, RunFolder, RunOptions, job_library, library_faults, run,
};
use upm_core::background::on_threads;
use upm_core::coded_enum;
use upm_core::document::Diagnostic;
use upm_core::job::Outcome;
use upm_core::rig::RigModel;
use upm_core::time::{Clock, MonotonicClock};
use upm_planning::cor_library::Library;
use upm_recording::{Fanout, RecordingOptions, Report, RerunMode};

coded_enum! {
    /// Run folders that stay.
    #[derive(Default)]
    pub enum Keep {
        /// None.
        #[default]
        Nothing = "nothing",
        /// Those of runs without success.
        Failures = "failures",
        /// All.
        All = "all",
    }
}

/// Makes the runs of a campaign, on several threads.
pub struct CampaignRunner<'a> {
    /// The campaign.
    pub campaign: &'a Campaign,
    /// Its folder.
    pub folder: &'a CampaignFolder,
    /// Threads; 0 is one for each core that the process may use.
    pub threads: usize,
    /// Run folders that stay.
    pub keep: Keep,
    /// Their recordings: off or saved.
    pub rerun: RerunMode,
    /// Largest size of all run folders that stay, bytes: of runs after that only the lines stay.
    pub most_kept_bytes: u64,
    /// Command that judges each run folder; success is reaching the goal if `None`.
    pub judge: Option<&'a str>,
    /// Code of a guard that is switched off, in builds with the feature `mutants`.
    pub without_guard: Option<upm_core::job::Finding>,
    /// Set to end early: runs under way are not counted.
    pub stop: &'a AtomicBool,
}

/// A shard that is under way: its file from its first run to its last.
struct OpenShard {
    shard: usize,
    file: Mutex<Option<ShardFile>>,
    left: AtomicUsize,
}

impl CampaignRunner<'_> {
    /// Makes those of the runs in `range`, from 0, and in `shards` that have no line yet. `watch` gets each result,
    /// `None` for one that is there.
    ///
    /// # Errors
    /// The first failure that is no run's own: a shard that another process runs, a full disk, a judge that ends.
    pub fn run(
        &self,
        shards: std::ops::Range<usize>,
        range: std::ops::Range<usize>,
        watch: &(dyn Fn(Option<&RunLine>) + Sync),
    ) -> Result<(), RunError> {
        let facts = &self.folder.facts;
        let of = |shard| {
            let runs = facts.runs_of(shard);
            runs.start.max(range.start)..runs.end.min(range.end)
        };
        let open: Vec<OpenShard> = shards
            .map(|shard| OpenShard { shard, file: Mutex::new(None), left: AtomicUsize::new(of(shard).len()) })
            .collect();
        let runs: Vec<(&OpenShard, usize)> =
            open.iter().flat_map(|shard| of(shard.shard).map(move |run| (shard, run))).collect();
        let state = State {
            kept_bytes: AtomicU64::new(size_of(&self.folder.path().join(KEPT))),
            libraries: Mutex::default(),
            judges: Mutex::default(),
            clock: MonotonicClock::new(),
        };
        let failure = Mutex::new(None);
        on_threads(self.threads, runs.into_iter(), &|_| (), |(shard, run)| {
            if failure.lock().is_some() || self.stop.load(Ordering::Relaxed) {
                return;
            }
            let done = self.one(shard, run, &state);
            if shard.left.fetch_sub(1, Ordering::AcqRel) == 1 {
                *shard.file.lock() = None;
            }
            match done {
                Ok(line) => watch(line.as_ref()),
                Err(error) => {
                    failure.lock().get_or_insert(error);
                }
            }
        });
        failure.into_inner().map_or(Ok(()), Err)
    }

    /// Makes a run and appends its line; `None` if it was there or was stopped.
    fn one(&self, shard: &OpenShard, run: usize, state: &State) -> Result<Option<RunLine>, RunError> {
        let job = self.campaign.job(run);
        let (cell, seed) = self.campaign.cell_and_seed(run);
        let (document, library) = match &job {
            Ok(job) => {
                let library = state.library(job);
                let hash = library.as_ref().map(|(_, hash)| hash.clone()).unwrap_or_default();
                (effective(job, &hash), library.map(|(library, _)| library))
            }
            Err(faults) => (self.campaign.document(run).unwrap_or_default().to_string(), Err(faults.clone())),
        };
        let guard = self.without_guard.map(|guard| format!(" without {}", guard.code())).unwrap_or_default();
        let key = format!("{}-{}", hash_of(&(document + &guard)), self.folder.facts.program);
        let mut line = RunLine { run: run + 1, key, cell, seed, ..RunLine::default() };
        {
            let mut file = shard.file.lock();
            if file.is_none() {
                *file = Some(self.folder.shard(shard.shard)?);
            }
            if file.as_ref().is_some_and(|file| file.has(&line)) {
                return Ok(None);
            }
        }
        let begun = state.clock.elapsed();
        match (job, library) {
            (Ok(mut job), Ok(library)) => {
                job.without_guard = self.without_guard;
                let made = catch_unwind(AssertUnwindSafe(|| self.made(&job, &library, line.clone(), state)));
                line = match made {
                    Ok(Ok(Some(made))) => made,
                    Ok(Ok(None)) => return Ok(None),
                    Ok(Err(RunError::Input(faults))) => refused(line, &faults),
                    Ok(Err(error)) => return Err(error),
                    Err(panic) => {
                        let said = panic.downcast_ref::<String>().cloned();
                        let said = said.or_else(|| panic.downcast_ref::<&str>().map(|&text| text.to_owned()));
                        let reason = format!("panic: {}", said.unwrap_or_default());
                        RunLine { outcome: "panicked".into(), reason, ..line }
                    }
                };
            }
            (Err(faults), _) | (_, Err(faults)) => line = refused(line, &faults),
        }
        line.figures.wall_time_s = Some(((state.clock.elapsed() - begun).as_secs_f64() * 1e4).round() / 1e4);
        if let Some(file) = shard.file.lock().as_mut() {
            file.append(&line)?;
        }
        Ok(Some(line))
    }

    /// The run of a job, judged; `None` if it was stopped.
    fn made(
        &self,
        job: &JobSpec,
        library: &Arc<Library>,
        line: RunLine,
        state: &State,
    ) -> Result<Option<RunLine>, RunError> {
        let has_folder = self.judge.is_some() || self.keep == Keep::All;
        let (report, folder) = if has_folder {
            self.in_folder(job, library, line.run)?
        } else {
            let run = InMemoryRun::with_library(job, Arc::clone(library))?;
            (run.run_until(self.stop, &mut Fanout::default()), PathBuf::new())
        };
        if self.stop.load(Ordering::Relaxed) && report.outcome == Outcome::Cancelled {
            fs::remove_dir_all(&folder).ok();
            return Ok(None);
        }
        let mut line = line.with_report(&report);
        if let Some(judge) = self.judge {
            line.violations = state.judged(judge, &folder)?;
            line.success = line.violations.is_empty();
        }
        if line.success {
            line.reason.clear();
        }
        let stays = self.keep == Keep::All || self.keep == Keep::Failures && !line.success;
        if stays && state.kept_bytes.load(Ordering::Relaxed) < self.most_kept_bytes {
            let folder = if has_folder { folder } else { self.in_folder(job, library, line.run)?.1 };
            if self.stop.load(Ordering::Relaxed) && !has_folder {
                // the second time it may have been stopped
                fs::remove_dir_all(&folder).ok();
                return Ok(None);
            }
            state.kept_bytes.fetch_add(size_of(&folder), Ordering::Relaxed);
            line.folder = folder.strip_prefix(self.folder.path()).ok().map(|path| path.display().to_string());
        } else if has_folder {
            fs::remove_dir_all(&folder).map_err(|error| RunError::write(&folder, &error))?;
        }
        Ok(Some(line))
    }

    /// Runs a job into a folder, which replaces one that an earlier process left.
    fn in_folder(
        &self,
        job: &JobSpec,
        library: &Arc<Library>,
        run_number: usize,
    ) -> Result<(Report, PathBuf), RunError> {
        let (clock, pacing) = (MonotonicClock::new(), PacingStats::default());
        let options = RunOptions {
            out: self.folder.path().join(KEPT),
            started_utc: format!("run-{run_number:07}"),
            rerun: self.rerun.clone(),
            real_time: false,
            recording_options: RecordingOptions::lossless(clock),
        };
        RunFolder::remove(&options.out, job, &options.started_utc);
        let (library, mut nobody) = (Arc::clone(library), Fanout::default());
        let made = run(job, library, (&options, OwnParts::default()), &clock, self.stop, &pacing, &mut nobody)?;
        Ok((made.report, made.folder))
    }
}

fn refused(line: RunLine, faults: &[Diagnostic]) -> RunLine {
    let reason = faults.first().map(ToString::to_string).unwrap_or_default();
    RunLine { outcome: "refused".into(), reason, ..line }
}

/// All that the results of a run of `job` depend on, but the program.
fn effective(job: &JobSpec, library_hash: &str) -> String {
    let mut document = job.effective();
    // where the library lies is of no account, what is in it is
    document["rig"]["library"] = serde_json::Value::Null;
    document["library"] = library_hash.into();
    format!("{} {document}", job.camera.code())
}

/// Size of a folder with all that is in it, bytes.
fn size_of(folder: &Path) -> u64 {
    let entries = fs::read_dir(folder).into_iter().flatten().flatten();
    entries.map(|entry| entry.metadata().map_or(0, |m| if m.is_dir() { size_of(&entry.path()) } else { m.len() })).sum()
}

/// A library with its hash, or the faults of its file.
type Loaded = Result<(Arc<Library>, String), Vec<Diagnostic>>;

/// A library with its hash, and model and fingerprint of the last rig that it was found to fit.
type KnownLibrary = (Arc<Library>, String, (RigModel, String));

/// State that threads share.
struct State {
    kept_bytes: AtomicU64,
    /// Libraries by their files.
    libraries: Mutex<HashMap<PathBuf, KnownLibrary>>,
    /// Judges that wait for a run.
    judges: Mutex<Vec<Judge>>,
    clock: MonotonicClock,
}

impl State {
    /// The library of a job; one of a file is read once.
    fn library(&self, job: &JobSpec) -> Loaded {
        let hashed = |library: Arc<Library>| {
            let hash = hash_of(&library.to_json());
            (library, hash)
        };
        let Some(LibraryRef::File(path)) = &job.library else { return job_library(job).map(hashed) };
        let mut libraries = self.libraries.lock();
        let rig = || (job.rig.model.clone(), job.rig.fingerprint.clone());
        let (library, hash, fits) = match libraries.entry(path.clone()) {
            Entry::Occupied(known) => known.into_mut(),
            Entry::Vacant(new) => {
                let (library, hash) = job_library(job).map(hashed)?;
                new.insert((library, hash, rig()))
            }
        };
        if *fits != rig() {
            let faults = library_faults(library, &path.display().to_string(), &job.rig);
            if !faults.is_empty() {
                return Err(faults);
            }
            *fits = rig();
        }
        Ok((Arc::clone(library), hash.clone()))
    }

    /// Violations that a judge finds in the run in `folder`.
    fn judged(&self, command: &str, folder: &Path) -> Result<Vec<String>, RunError> {
        let waiting = self.judges.lock().pop();
        let mut judge = waiting.map_or_else(|| Judge::start(command), Ok)?;
        let said = judge.ask(folder)?;
        self.judges.lock().push(judge);
        Ok(said)
    }
}
