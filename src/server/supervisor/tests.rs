mod guards;
mod standing;
mod stops;

use std::path::Path;
use std::sync::{Arc, LazyLock};
use std::time::Duration;

use super::*;
use crate::states::PauseCause;
use crate::store::{AuditEntry, JobId, JobRow, JobState, Pace, RecordingStatus, RecoveryReport, Store, SubmitOutcome};
use upm_core::rig::Trip;
use upm_core::time::MonotonicClock;
use upm_fixtures::wait::{eventually, eventually_true};
use upm_planning::cor_library::Library;
use upm_recording::{RecordingState, RerunMode};
use upm_runner::config::{DaemonSpec, PlateSpec, StandingSpec, WatchdogSpec};

const LONG: Duration = Duration::from_secs(60);
const TWO_COINS: &str = r#"{ "name": "two", "seed": 3, "parts": [{ "kind": "penny", "count": 2 }],
    "planner": "synthesized_field",
    "task": { "type": "arrange", "targets_mm": [[-40, 0], [40, 0]] } }"#;
const HOLD: &str = r#"{ "name": "hold", "seed": 3, "parts": [{ "kind": "penny", "count": 2 }],
    "task": { "type": "hold", "duration_s": 600 }, "limits": { "plate_time_s": 900 } }"#;

/// Watchdog limits for a slow machine.
const WATCHDOG: WatchdogSpec =
    WatchdogSpec { hung: Duration::from_secs(30), no_part_s: 0.5, blocked: Duration::from_secs(5) };

struct TestPlates {
    folder: tempfile::TempDir,
    store: Arc<Store>,
    standing: Option<StandingSpec>,
    allow_faults: bool,
    waits_after_jobs: bool,
}

impl TestPlates {
    fn new() -> Self {
        let folder = tempfile::tempdir().unwrap();
        let limits = crate::store::tests::limits();
        let store = Store::open(folder.path(), &[], 64, limits, jiff::Timestamp::now).unwrap().0;
        Self { folder, store: Arc::new(store), standing: None, allow_faults: false, waits_after_jobs: false }
    }

    fn open(&self, paused: Option<&str>) -> PlateSupervisor {
        self.open_with(paused, |_| {})
    }

    fn open_with(&self, paused: Option<&str>, change: impl FnOnce(&mut DaemonSpec)) -> PlateSupervisor {
        let spec = PlateSpec {
            name: "one".into(),
            rig: shipped().plates.swap_remove(1).rig,
            library: Default::default(),
            library_key: String::new(),
            waits_after_jobs: self.waits_after_jobs,
            standing: self.standing.clone(),
        };
        let paused = paused.map(|why| (spec.name.clone(), PauseCause::new("test", why, "none")));
        let recovery = RecoveryReport { paused: paused.into_iter().collect(), ..Default::default() };
        let mut daemon = DaemonSpec {
            plates: vec![spec],
            data: self.folder.path().to_owned(),
            rerun: Some(RerunMode::Off),
            watchdog: WATCHDOG,
            min_free_bytes: 0,
            allow_faults: self.allow_faults,
            pace: Pace::Max,
            ..shipped()
        };
        change(&mut daemon);
        PlateSupervisor::start(&daemon, vec![library()], &self.store, &recovery, MonotonicClock::new()).unwrap()
    }

    fn submit(&self, plate: &PlateHandle, text: &str, pace: Pace) -> JobId {
        let job = plate.rules.validated(text, pace).unwrap();
        let Ok(Some(SubmitOutcome::New(row))) = self.store.accept(&job, || true) else { panic!("not queued") };
        plate.job_queued();
        row.id
    }

    /// Runs a job that holds its parts in real time and queues another behind it.
    fn keep_busy(&self, plate: &PlateHandle) -> [JobId; 2] {
        let jobs = [self.submit(plate, HOLD, Pace::RealTime), self.submit(plate, TWO_COINS, Pace::Max)];
        until_seen(plate, &jobs[0]);
        jobs
    }

    fn row(&self, id: &JobId) -> JobRow {
        self.store.job(id).unwrap().unwrap()
    }

    /// The job once it has ended.
    fn ended(&self, id: &JobId) -> JobRow {
        eventually("the job ends", || Some(self.row(id)).filter(|row| row.state.is_final()))
    }

    fn acts(&self) -> Vec<String> {
        self.store.audit_log().into_iter().map(|(act, _)| act).collect()
    }
}

/// Waits until the parts of the job have been observed on the plate.
fn until_seen(plate: &PlateHandle, job: &JobId) {
    eventually_true("parts are observed", || {
        let snapshot = plate.snapshot();
        snapshot.job == Some(job.to_string()) && snapshot.age_s.is_some()
    });
}

fn root() -> &'static Path {
    Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../.."))
}

fn library() -> Arc<Library> {
    static LIBRARY: LazyLock<Arc<Library>> =
        LazyLock::new(|| Arc::new(Library::load(&root().join("assets/libraries/upm-2.json")).unwrap()));
    Arc::clone(&LIBRARY)
}

/// The shipped configuration of a daemon.
fn shipped() -> DaemonSpec {
    static SHIPPED: LazyLock<DaemonSpec> =
        LazyLock::new(|| DaemonSpec::load(&root().join("configs/daemon.json")).unwrap());
    SHIPPED.clone()
}

/// Returns once the plate's worker has checked for work and found none.
fn idles(plate: &PlateHandle) {
    let idled = || plate.idled.load(std::sync::atomic::Ordering::SeqCst);
    // the first of the two may have begun before this
    let enough = idled() + 2;
    while idled() < enough {
        plate.wake();
        std::thread::yield_now();
    }
}

fn caller(operator: &str) -> AuditEntry {
    AuditEntry { operator: operator.into(), reason: "a test".into(), ..AuditEntry::default() }
}

/// Takes back the stop that holds now.
fn reset(plate: &PlateHandle, operator: &str) -> Result<(), ResetError> {
    plate.reset(plate.emergency_stop.held()?, caller(operator), || true)
}

#[test]
fn job_runs_to_its_end_and_leaves_its_files() {
    let test_plates = TestPlates::new();
    let plates = test_plates.open(None);
    let plate = plates.get("one").unwrap();
    let id = test_plates.submit(plate, TWO_COINS, Pace::Max);
    let row = test_plates.ended(&id);
    assert_eq!((row.state, row.reason.as_str()), (JobState::Completed, "every part is at its place"));
    assert_eq!(row.recording, RecordingStatus::None);
    assert!(row.report.as_ref().unwrap().contains_key("max_error_mm"));
    let folder = test_plates.store.runs().join(row.folder.as_ref().unwrap());
    for file in ["effective.json", "journal.jsonl", "report.json"] {
        assert!(folder.join(file).exists(), "{file}");
    }
    let Observation { positions_mm, targets_mm, progress, phase, .. } = plate.snapshot().observation;
    assert_eq!((positions_mm.len(), targets_mm.len(), progress, phase.as_str()), (2, 0, 0.0, ""), "the job is over");
    assert_eq!(plates.alive(), Ok(()));
    assert_eq!(plates.shutdown(LONG), Vec::<String>::new());
}

#[test]
fn a_plate_that_waits_between_jobs_runs_one_for_each_resume() {
    let test_plates = TestPlates { waits_after_jobs: true, ..TestPlates::new() };
    let plates = test_plates.open(None);
    let plate = plates.get("one").unwrap();
    let jobs = [(); 2].map(|()| test_plates.submit(plate, TWO_COINS, Pace::Max));
    for (id, queued) in [(&jobs[0], JobState::Queued), (&jobs[1], JobState::Completed)] {
        assert_eq!(test_plates.ended(id).state, JobState::Completed);
        idles(plate);
        let Plate { state, pause, .. } = plate.snapshot();
        assert_eq!((state, pause.unwrap().code.as_str()), (PlateState::Paused, "between_jobs"));
        assert_eq!(test_plates.row(&jobs[1]).state, queued);
        assert!(plate.resume(caller("ann")));
    }
    assert_eq!(plate.snapshot().state, PlateState::Idle);
}

#[test]
fn an_emergency_stop_ends_the_job_and_holds_until_reset_and_resume() {
    let test_plates = TestPlates::new();
    let plates = test_plates.open(None);
    let plate = plates.get("one").unwrap();
    let [first, second] = test_plates.keep_busy(plate);
    let Plate { state, recording, .. } = plate.snapshot();
    assert_eq!((state, recording), (PlateState::Running, Some(RecordingState::Off)));
    assert_eq!(plate.emergency_stop.interlock.stop_times(), None);
    assert!(plate.estop() && !plate.estop());
    assert_eq!(plate.record_estop(caller("ann")).iter().collect::<Vec<_>>(), [true]);
    let ended = test_plates.ended(&first);
    assert_eq!(ended.state, JobState::Cancelled);
    assert!(ended.reason.starts_with("emergency stop"), "{}", ended.reason);
    let Plate { state, recording, estops, .. } = plate.snapshot();
    assert_eq!((state, recording, estops), (PlateState::Stopped, None, 1));
    let times = plate.emergency_stop.interlock.stop_times().unwrap();
    assert!(times.motors_off_at.secs_since(times.requested_at) < 0.02, "{times:?}");
    assert!(!plate.resume(caller("bob")), "a stop holds");

    eventually_true("a reset", || reset(plate, "bob") != Err(ResetError::StillStopping));
    assert_eq!(reset(plate, "bob"), Err(ResetError::NotStopped));
    assert_eq!(plate.snapshot().state, PlateState::Paused);
    idles(plate);
    assert_eq!(test_plates.row(&second).state, JobState::Queued, "a reset starts nothing");
    assert!(plate.resume(caller("bob")));
    assert_eq!(test_plates.ended(&second).state, JobState::Completed);
    let act = |act: &str, operator: &str| (act.to_owned(), operator.to_owned());
    let acts = [act("estop", "ann"), act("reset", "bob"), act("pause", ""), act("resume", "bob")];
    assert_eq!(test_plates.store.audit_log(), acts);
}

#[test]
fn run_ended_by_the_interlock_before_the_latch_counts_as_stopped() {
    let test_plates = TestPlates::new();
    let plates = test_plates.open(None);
    let plate = plates.get("one").unwrap();
    let [first, second] = test_plates.keep_busy(plate);
    // the first step of an emergency stop
    plate.emergency_stop.interlock.trip(Trip::EStop);
    plate.wake();
    let ended = test_plates.ended(&first);
    assert_eq!((ended.state, ended.reason.as_str()), (JobState::Cancelled, "emergency stop"));
    idles(plate);
    assert_eq!((plate.snapshot().state, test_plates.row(&second).state), (PlateState::Stopped, JobState::Queued));
    assert!(!plate.resume(caller("bob")));
}

#[test]
fn a_stop_outlives_the_daemon() {
    let test_plates = TestPlates::new();
    let plates = test_plates.open(None);
    plates.get("one").unwrap().estop();
    assert_eq!(plates.get("one").unwrap().record_estop(caller("ann")).iter().collect::<Vec<_>>(), [true]);
    assert_eq!(plates.shutdown(LONG), Vec::<String>::new());
    let plates = test_plates.open(None);
    let plate = plates.get("one").unwrap();
    assert_eq!(plate.snapshot().state, PlateState::Stopped);
    let id = test_plates.submit(plate, TWO_COINS, Pace::Max);
    idles(plate);
    assert_eq!(test_plates.row(&id).state, JobState::Queued);
    assert_eq!(reset(plate, "ann"), Ok(()));
    let pause = plate.paused().unwrap();
    assert_eq!((pause.code.as_str(), pause.why.as_str()), ("reset", "reset after an emergency stop"));
    assert_eq!(plate.snapshot().why, "reset after an emergency stop");
}

#[cfg(target_os = "linux")]
#[test]
fn job_with_an_unwritable_journal_is_stopped_and_reports_it() {
    let test_plates = TestPlates::new();
    let plates = test_plates.open(Some("not yet"));
    let plate = plates.get("one").unwrap();
    let id = test_plates.submit(plate, HOLD, Pace::RealTime);
    let folder = test_plates.folder.path().join("runs").join(format!("hold-{id}"));
    std::fs::create_dir_all(&folder).unwrap();
    std::os::unix::fs::symlink("/dev/full", folder.join("journal.jsonl")).unwrap();
    plate.resume(caller("ann"));
    let ended = test_plates.ended(&id);
    assert_eq!(ended.state, JobState::Failed);
    assert!(ended.reason.contains("journal.jsonl: the disk is full"), "{}", ended.reason);
}

#[test]
fn run_observer_has_no_blocking_call() {
    let source = include_str!("run_observer.rs");
    for waits in ["lock(", "recv", ".join(", "park", "sleep", "std::fs", "File", "rustix"] {
        assert!(!source.contains(waits), "run_observer.rs is called by the control loop and has `{waits}`");
    }
}
