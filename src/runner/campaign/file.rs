use serde_json::{Value, json};
use sha2::{Digest, Sha256};

use super::draws::{self, Axis};
use super::seeds::Seeds;
use crate::config::{CampaignFile, JobSpec, Origin, RigSpec};
use upm_core::document::{Diagnostic, Diagnostics, Path, one_of, parse_and_build, shown, text_of};
use upm_core::job::CameraMode;
use upm_core::random::Streams;

/// Most runs of a campaign.
const MOST_RUNS: usize = 10_000_000;
/// Most cells: the first job of each is checked at the start.
const MOST_CELLS: usize = 1000;
/// Longest name of a cell's value, characters.
const LONGEST_NAME: usize = 40;

/// A campaign, read: the job of each of its runs.
#[derive(Clone, Debug)]
pub struct Campaign {
    /// Name of the campaign.
    pub name: String,
    /// Pictures or positions from the simulated camera.
    pub camera: CameraMode,
    seeds: Vec<u64>,
    axes: Vec<Axis>,
    job: Value,
    /// Values put into the job of each run, by their places.
    changes: Vec<(String, Value)>,
    /// Origin of the job, which its relative paths are relative to.
    origin: Origin,
}

impl Campaign {
    /// Reads the campaign at `path` and the job that it names.
    ///
    /// # Errors
    /// Every fault of the file and its draws; then those of the first run of each cell.
    pub fn load(path: &std::path::Path) -> Result<Self, Vec<Diagnostic>> {
        Self::from_json(&text_of(path)?, &Origin::of_file(path), &[])
    }

    /// As [`Self::load`], for the campaign in `text`, with `changes` of the job of each run, values by their places;
    /// `camera` is the campaign's.
    ///
    /// # Errors
    /// As [`Self::load`], and of a change whose place there cannot be.
    pub fn from_json(text: &str, origin: &Origin, changes: &[(String, Value)]) -> Result<Self, Vec<Diagnostic>> {
        let campaign = parse_and_build(text, &origin.file, |mut file: CampaignFile, faults| {
            let (of_camera, changes): (Vec<_>, Vec<_>) = changes.iter().cloned().partition(|(key, _)| key == "camera");
            for (key, value) in of_camera {
                let code = value.as_str().unwrap_or_default();
                let known = CameraMode::ALL.map(CameraMode::code);
                faults.require(known.contains(&code), key, shown(&value), one_of(code, &known));
                file.camera = CameraMode::of_code(code).unwrap_or_default();
            }
            let seeds: Result<Seeds, String> = file.seeds.parse();
            let said = seeds.as_ref().err().cloned().unwrap_or_default();
            let allowed = said.split(", found").next().unwrap_or_default().trim_start_matches("expected ");
            faults.require(seeds.is_ok(), "seeds", format!("{:?}", file.seeds), allowed);
            let (mut job, origin) = job_of(file.job, origin, faults)?;
            extend_rigs(&mut job, &Path::root(), &origin, faults);
            let axes = draws::axes(&job, &Path::root(), faults);
            let (name, camera, seeds) = (file.name, file.camera, seeds.ok()?.as_slice().to_vec());
            let cells = axes.iter().try_fold(1usize, |cells, axis| cells.checked_mul(axis.values.len()));
            let fits = cells.is_some_and(|cells| cells <= MOST_CELLS && cells * seeds.len() <= MOST_RUNS);
            let allowed = format!("up to {MOST_CELLS} cells and {MOST_RUNS} runs");
            faults.require(fits, "seeds", "too many runs", allowed);
            Some(Self { name, camera, seeds, axes, job, changes, origin })
        })?;
        (0..campaign.cells()).try_for_each(|cell| campaign.job(cell).map(drop))?;
        Ok(campaign)
    }

    /// A campaign of one job with these seeds.
    pub fn of_job(name: &str, job: Value, origin: Origin, seeds: &Seeds, camera: CameraMode) -> Self {
        let seeds = seeds.as_slice().to_vec();
        Self { name: name.to_owned(), camera, seeds, axes: Vec::new(), job, changes: Vec::new(), origin }
    }

    /// Number of cells: all combinations of the values that each `$each` has.
    pub fn cells(&self) -> usize {
        self.axes.iter().map(|axis| axis.values.len()).product()
    }

    /// Number of runs: each cell with each seed.
    pub fn runs(&self) -> usize {
        self.cells() * self.seeds.len()
    }

    /// Cell and seed of a run: runs of one seed follow one another.
    pub fn cell_and_seed(&self, run: usize) -> (usize, u64) {
        (run % self.cells(), self.seeds[run / self.cells() % self.seeds.len()])
    }

    /// The values of a cell by their paths, as `planner=moving_field parts[0].count=8`; empty for the only one.
    pub fn cell_name(&self, cell: usize) -> String {
        let named = self.choices(cell).map(|(axis, choice)| {
            let value = &axis.values[choice];
            let name =
                value.as_str().or_else(|| value.get("name")?.as_str()).map_or_else(|| shown(value), str::to_owned);
            let name: String = name.chars().take(LONGEST_NAME).collect();
            let last = axis.path.rsplit('.').next().filter(|path| *path != "$");
            last.map_or(name.clone(), |last| format!("{last}={name}"))
        });
        named.collect::<Vec<_>>().join(" ")
    }

    fn choices(&self, cell: usize) -> impl Iterator<Item = (&Axis, usize)> {
        // the last axis varies fastest
        let mut below = self.cells();
        self.axes.iter().map(move |axis| {
            below /= axis.values.len();
            (axis, cell / below % axis.values.len())
        })
    }

    /// The job file of a run.
    ///
    /// # Errors
    /// Draws that cannot be made.
    pub fn document(&self, run: usize) -> Result<Value, Vec<Diagnostic>> {
        let (cell, seed) = self.cell_and_seed(run);
        let mut faults = Diagnostics::of(&self.origin.file);
        let choices: Vec<_> = self.choices(cell).collect();
        let mut job = draws::drawn(&self.job, &choices, Streams::new(seed), &mut faults);
        if let Some(members) = job.as_object_mut() {
            members.entry("name").or_insert_with(|| json!(self.name));
            members.insert("seed".into(), seed.into());
        }
        for (key, value) in &self.changes {
            let put = put(&mut job, key, value.clone());
            faults.require(put.is_some(), key, "no such place in the job", "one as limits.plate_time_s");
        }
        faults.into_result(Some(job))
    }

    /// The job of a run.
    ///
    /// # Errors
    /// Draws that cannot be made, and the faults of the job.
    pub fn job(&self, run: usize) -> Result<JobSpec, Vec<Diagnostic>> {
        let text = self.document(run)?.to_string();
        Ok(JobSpec::from_json(&text, &self.origin, None)?.with_camera(self.camera))
    }

    /// Hash of all that the runs are made from but the files that the job names.
    pub fn hash(&self) -> String {
        hash_of(&json!([self.name, self.seeds, self.camera, self.job, self.changes]).to_string())
    }
}

/// The first 16 digits of the SHA-256 of `text`.
pub(super) fn hash_of(text: &str) -> String {
    let mut hash = format!("{:x}", Sha256::digest(text.as_bytes()));
    hash.truncate(16);
    hash
}

/// The job of a campaign, written out or read from its file, and where it is from.
fn job_of(job: Value, origin: &Origin, faults: &mut Diagnostics) -> Option<(Value, Origin)> {
    let Value::String(named) = &job else { return Some((job, origin.clone())) };
    let path = origin.named_file(named, &Path::root().key("job"), faults)?;
    let text = text_of(&path).map_err(|list| faults.append_named(list, &format!("{}: job", origin.file))).ok()?;
    let file = path.display().to_string();
    let read = serde_json::from_str(&text).map_err(|error| faults.append(vec![Diagnostic::syntax(&file, &error)]));
    Some((read.ok()?, Origin::of_file(&path)))
}

/// Writes out every rig in `value` that extends another, so that its members may be draws.
fn extend_rigs(value: &mut Value, at: &Path, origin: &Origin, faults: &mut Diagnostics) {
    if value.get("extends").is_some() {
        let made = RigSpec::extended_within(value.take(), origin, at, faults);
        made.into_iter().for_each(|made| *value = made);
    } else {
        draws::members_mut(value, at, &mut |member, at| extend_rigs(member, at, origin, faults));
    }
}

/// Puts `value` at `key` of a job, as `parts[0].count`. Objects on the way that are missing are made. `None` where
/// there can be no such place.
pub fn put(document: &mut Value, key: &str, value: Value) -> Option<()> {
    let mut at = document;
    for step in key.replace('[', ".").replace(']', "").split('.') {
        if at.is_null() {
            *at = json!({});
        }
        at = match at {
            Value::Array(items) => items.get_mut(step.parse::<usize>().ok()?)?,
            Value::Object(members) if !step.is_empty() => members.entry(step).or_insert(Value::Null),
            _ => return None,
        };
    }
    *at = value;
    Some(())
}
