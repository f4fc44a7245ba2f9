use crate::states::{JobState, PlateState, RecordingStatus};
use std::fs::File;
use std::path::PathBuf;
use std::sync::Mutex;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;
use upm_core::job::Pace;

use bytes::Bytes;

use crate::api::*;
use crate::http::{Caller, Reason};

/// Id of the only job, id of a missing job, and name of the only plate.
pub(super) const JOB: &str = "019a0000000070008000000000000001";
pub(super) const NO_JOB: &str = "019a0000000070008000000000000002";
pub(super) const PLATE: &str = "left";

/// A job that is valid on the fake backend's plate.
pub(super) const HOLD: &str =
    r#"{"name": "rest", "parts": [{"kind": "penny"}], "task": {"type": "hold", "duration_s": 1}}"#;

/// A backend with one plate and one job. The next request is answered with `refusal`, once.
#[derive(Default)]
pub(super) struct FakeBackend {
    pub refusal: Mutex<Option<Refusal>>,
    pub asked: Mutex<Vec<String>>,
    /// State of the job; completed without one.
    pub state: Mutex<Option<JobState>>,
    /// File of the job's journal.
    pub journal: Mutex<Option<PathBuf>>,
    pub recording: Mutex<Vec<u8>>,
    pub failures: Mutex<Vec<Reason>>,
    /// True when the store never answers.
    pub hangs: AtomicBool,
}

impl FakeBackend {
    pub fn refuse(&self, refusal: Refusal) {
        *self.refusal.lock().unwrap() = Some(refusal);
    }

    fn reply<T: Send + 'static>(&self, asked: String, known: bool, answer: T) -> Pending<T> {
        self.asked.lock().unwrap().push(asked);
        ready(match self.refusal.lock().unwrap().take() {
            Some(refusal) => Err(refusal),
            None if known => Ok(answer),
            None => Err(Refusal::Unknown("there is no such thing".to_owned())),
        })
    }
}

pub(super) fn job() -> Job {
    Job {
        id: JOB.to_owned(),
        name: "rest".to_owned(),
        state: JobState::Queued,
        plate: PLATE.to_owned(),
        submitted_at: "2026-11-22T05:14:00Z".to_owned(),
        started_at: None,
        finished_at: None,
        progress: 0.0,
        report: None,
        reason: String::new(),
        seed: 1,
        pace: Pace::RealTime,
        recording: RecordingStatus::None,
        standing: false,
        turn: 0,
    }
}

fn plate() -> Plate {
    Plate {
        name: PLATE.to_owned(),
        state: PlateState::Idle,
        pause: None,
        conditions: Vec::new(),
        why: String::new(),
        job: None,
        standing_job: None,
        queued: 0,
        at_s: 0.0,
        age_s: None,
        side_mm: 203.2,
        kinds: Vec::new(),
        positions_mm: vec![[1.0, 2.0]],
        radii_mm: vec![9.525],
        targets_mm: Vec::new(),
        progress: 0.0,
        phase: String::new(),
        deadline_misses: 0,
        behind_s: 0.0,
        recording_mb: None,
        live: None,
    }
}

impl Backend for FakeBackend {
    fn submit(&self, order: Submission) -> Pending<JobCreated> {
        let replayed = order.key.as_deref() == Some("again");
        self.reply(format!("submit {:?}", order.pace), true, JobCreated { job: job(), replayed })
    }

    fn check(&self, _: String) -> Pending<Checked> {
        self.reply("check".to_owned(), true, Checked::default())
    }

    fn job(&self, id: &str) -> Pending<Job> {
        let state = self.state.lock().unwrap().unwrap_or(JobState::Completed);
        self.reply(format!("job {id}"), id == JOB, Job { state, ..job() })
    }

    fn jobs(&self, query: JobsQuery) -> Pending<JobsPage> {
        self.reply(format!("jobs {}", query.limit), true, JobsPage { jobs: vec![job()], next: Some(JOB.to_owned()) })
    }

    fn run_next(&self, id: &str, caller: Caller) -> Pending<Job> {
        self.reply(format!("run next {id} by {}", caller.name), id == JOB, job())
    }

    fn cancel(&self, id: &str, caller: Caller) -> Pending<Job> {
        self.reply(format!("cancel {id} by {}", caller.name), id == JOB, job())
    }

    fn delete(&self, id: &str, caller: Caller) -> Pending<()> {
        self.reply(format!("delete {id} by {}", caller.name), id == JOB, ())
    }

    fn plates(&self) -> Pending<Plates> {
        if self.hangs.load(Ordering::Relaxed) {
            return Box::pin(std::future::pending());
        }
        self.reply("plates".to_owned(), true, Plates { plates: vec![plate()], stop_listen: None })
    }

    fn plates_as_counted(&self) -> Plates {
        Plates { plates: vec![Plate { queued: 7, ..plate() }], stop_listen: None }
    }

    fn estop(&self, name: &str, caller: Caller) -> Pending<EStopped> {
        if name == "endless" {
            self.asked.lock().unwrap().push("estop endless".to_owned());
            return Box::pin(std::future::pending());
        }
        let stopped = EStopped {
            plate: name.to_owned(),
            silent: true,
            persisted: true,
            requested_at_s: Some(1.0),
            silent_at_s: Some(1.00005),
            wall_s: Some(0.0001),
        };
        self.reply(format!("estop {name} by {}", caller.name), name == PLATE, stopped)
    }

    fn reset(&self, name: &str, request: ResetRequest, _: Caller) -> Pending<Plate> {
        self.reply(format!("reset {name} by {}: {}", request.operator, request.reason), name == PLATE, plate())
    }

    fn resume(&self, name: &str, _: Caller) -> Pending<Plate> {
        self.reply(format!("resume {name}"), name == PLATE, plate())
    }

    fn liveness_failures(&self) -> Vec<Reason> {
        self.failures.lock().unwrap().clone()
    }

    fn readiness_failures(&self) -> Vec<Reason> {
        self.liveness_failures()
    }

    fn metrics(&self) -> String {
        "# EOF\n".to_owned()
    }

    fn journal(&self, id: &str) -> Pending<Option<File>> {
        let file = self.journal.lock().unwrap().as_ref().and_then(|path| File::open(path).ok());
        self.reply(format!("journal {id}"), id == JOB, file)
    }

    fn frame(&self, id: &str) -> Pending<CameraPicture> {
        let picture = CameraPicture { png: Bytes::from_static(b"\x89PNG"), age: Duration::from_micros(12_900) };
        self.reply(format!("frame {id}"), id == JOB, picture)
    }

    fn layout(&self, id: &str) -> Pending<LayoutView> {
        self.reply(format!("layout {id}"), id == JOB, LayoutView::default())
    }

    fn recording(&self, id: &str) -> Pending<Recording> {
        use std::io::{Seek, Write};
        let bytes = self.recording.lock().unwrap().clone();
        let mut file = tempfile::tempfile().unwrap();
        file.write_all(&bytes).unwrap();
        file.rewind().unwrap();
        let recording = Recording { file, bytes: bytes.len() as u64, name: "rest.rrd".to_owned() };
        self.reply(format!("recording {id}"), id == JOB, recording)
    }
}
