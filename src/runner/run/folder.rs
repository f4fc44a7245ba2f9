use std::fs::{self, File};
use std::io::{self, BufWriter, Write};
use std::path::{Path, PathBuf};

use serde_json::json;

use super::error::RunError;
use super::machine::machine;
use super::setup::RunSetup;
use crate::config::JobSpec;
use upm_control::{FrameFacts, Sink};
use upm_core::document::pretty;
use upm_core::files::{sync_folder, write_whole};
use upm_core::ground_truth::{GroundTruthHandle, PartTruth};
use upm_core::units::mm_from_m;
use upm_planning::cor_library::Library;
use upm_recording::{BackgroundWriter, RecordingOptions};

/// Most folders of one name; another one is refused.
const MOST_NAMESAKES: u32 = 1000;

/// Name of the file that [`TruthLog`] writes.
pub(super) const TRUTH_FILE: &str = "truth.jsonl";

/// A run folder, which holds `effective.json`, `journal.jsonl`, `run.rrd` and `report.json`.
#[derive(Clone, Debug)]
pub struct RunFolder(PathBuf);

/// Files of a run folder. `effective.json`, written just before the run begins, and `report.json`, written when it is
/// over, are complete if present; the journal may end in an incomplete line, and the recording anywhere.
const FILES: [&str; 4] = ["effective.json", "journal.jsonl", "run.rrd", REPORT_FILE];
/// The report of a run, present once it is over.
pub(super) const REPORT_FILE: &str = "report.json";

impl RunFolder {
    /// Creates `OUT/<name>-<seed>-<utc>/`, with a number appended if that exists.
    pub fn create(out: &Path, job: &JobSpec, started_utc: &str) -> Result<Self, RunError> {
        let plain = Self::name(job, started_utc);
        fs::create_dir_all(out).map_err(|error| RunError::write(out, &error))?;
        for number in 1..MOST_NAMESAKES {
            let name = if number == 1 { plain.clone() } else { format!("{plain}-{number}") };
            let path = out.join(name);
            match fs::create_dir(&path) {
                Ok(()) => return Ok(Self(path)),
                Err(error) if error.kind() == io::ErrorKind::AlreadyExists => {}
                Err(error) => return Err(RunError::write(&path, &error)),
            }
        }
        let reason = "too many runs of this name in this second".into();
        Err(RunError::Write { path: out.join(plain).display().to_string(), reason })
    }

    /// Name of a run folder that is the first of its name.
    fn name(job: &JobSpec, started_utc: &str) -> String {
        // 64 letters may have 256 bytes, more than the name of a folder
        let name = &job.name[..job.name.floor_char_boundary(200)];
        format!("{name}-{}-{started_utc}", job.seed())
    }

    /// Removes what [`RunFolder::create`] has made in a process that was killed.
    pub(crate) fn remove(out: &Path, job: &JobSpec, started_utc: &str) {
        fs::remove_dir_all(out.join(Self::name(job, started_utc))).ok();
    }

    /// Folder of an earlier run; `None` if `path` is not a folder (a link to one is rejected).
    pub fn reopen(path: &Path) -> Option<Self> {
        fs::symlink_metadata(path).is_ok_and(|found| found.is_dir()).then(|| Self(path.to_owned()))
    }

    /// Files of a run that the folder has.
    pub fn files(&self) -> Vec<&'static str> {
        let has = |name: &&str| fs::symlink_metadata(self.0.join(name)).is_ok_and(|found| found.is_file());
        FILES.into_iter().filter(has).collect()
    }

    /// Path of the folder.
    pub fn path(&self) -> &Path {
        &self.0
    }

    pub(super) fn write_error(&self, name: &str, error: &io::Error) -> RunError {
        RunError::write(&self.0.join(name), error)
    }

    /// Writes `effective.json`: version, machine, camera, and the job with rig, library and all defaults written out.
    pub(super) fn write_effective(&self, job: &JobSpec, library: &Library) -> Result<(), RunError> {
        let (version, mut effective) = (env!("CARGO_PKG_VERSION"), job.effective());
        // a run can be repeated from it without any other file
        effective["library"] = serde_json::to_value(library).unwrap_or_default();
        let effective = json!({ "version": version, "machine": machine(), "camera": job.camera, "job": effective });
        self.write_text("effective.json", pretty(&effective))
    }

    pub(super) fn journal(&self, recording_options: &RecordingOptions) -> Result<BackgroundWriter, RunError> {
        File::create(self.0.join("journal.jsonl"))
            .and_then(|file| {
                sync_folder(&self.0).ok();
                BackgroundWriter::start(
                    file,
                    recording_options.journal_overflow,
                    recording_options.has_clock,
                    recording_options.clock,
                    recording_options.journal.clone(),
                )
            })
            .map_err(|error| self.write_error("journal.jsonl", &error))
    }

    /// Writes `value` into a file, whole and with its name safe over a power cut, on a disk that can.
    pub(super) fn write_json(&self, name: &str, value: &impl serde::Serialize) -> Result<(), RunError> {
        let text = serde_json::to_string_pretty(value).map_err(|error| self.write_error(name, &error.into()))?;
        self.write_text(name, text)
    }

    fn write_text(&self, name: &str, text: String) -> Result<(), RunError> {
        // atomic: a file under its final name is complete and on the disk
        let draft = self.0.join(format!("{name}.part"));
        let written = write_whole(&draft, &self.0.join(name), (text + "\n").as_bytes());
        written.map_err(|error| self.write_error(name, &error))?;
        sync_folder(&self.0).ok();
        Ok(())
    }
}

/// Log of the true positions in a run with faults, one line per frame, for checks that share no code with the run:
/// `{"at_s", "parts": [[x_mm, y_mm, 1 while on the plate]]}`, in the order of the report.
#[derive(Debug)]
pub(super) struct TruthLog(io::Result<Option<(GroundTruthHandle, BufWriter<File>)>>);

impl TruthLog {
    /// Log for `setup`; writes nothing if it has no faults.
    pub(super) fn of(setup: &RunSetup, folder: &RunFolder) -> Result<Self, RunError> {
        if setup.faults.is_empty() {
            return Ok(Self(Ok(None)));
        }
        let file =
            File::create(folder.path().join(TRUTH_FILE)).map_err(|error| folder.write_error(TRUTH_FILE, &error))?;
        Ok(Self(Ok(Some((setup.truth.clone(), BufWriter::new(file))))))
    }

    /// Flushes the file; `Err` has the first error of any write.
    pub(super) fn finish(self) -> io::Result<()> {
        self.0?.map_or(Ok(()), |(_, mut file)| file.flush())
    }
}

impl Sink for TruthLog {
    fn frame(&mut self, _: &FrameFacts<'_>) {
        let Ok(Some((truth, file))) = &mut self.0 else { return };
        let truth = truth.read();
        let rounded = |m: f64| (mm_from_m(m) * 1e4).round() * 1e-4;
        let place = |part: &PartTruth| {
            let p_m = part.part_in_table.position_m;
            json!([rounded(p_m.x), rounded(p_m.y), u8::from(part.on_plate)])
        };
        let line = json!({ "at_s": truth.at.secs(), "parts": truth.parts.iter().map(place).collect::<Vec<_>>() });
        if let Err(error) = writeln!(file, "{line}") {
            self.0 = Err(error);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_a_folder_is_opened_again() {
        let out = tempfile::TempDir::new().unwrap();
        assert!(RunFolder::reopen(&out.path().join("none")).is_none());
        fs::write(out.path().join("file"), "").unwrap();
        assert!(RunFolder::reopen(&out.path().join("file")).is_none());
        #[cfg(unix)]
        {
            std::os::unix::fs::symlink("/", out.path().join("link")).unwrap();
            assert!(RunFolder::reopen(&out.path().join("link")).is_none());
        }
    }
}
