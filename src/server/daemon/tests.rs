mod jobs;

use std::future::Future;
use std::io::Read;
use std::path::Path;
use std::pin::pin;
use std::sync::Arc;
use std::task::{Context, Poll, Wake, Waker};
use std::thread::{self, Thread};
use std::time::Duration;

use jiff::Timestamp;

use super::backend::DaemonBackend;
use super::start::Daemon;
use super::{StartFault, prepare};
use crate::api::{Backend, EStopped, Job, JobCreated, JobsQuery, Pending, Plate, Refusal, ResetRequest, Submission};
use crate::http::Caller;
use crate::states::{JobState, PlateState};
use upm_core::job::Pace;
use upm_core::time::MonotonicClock;
use upm_fixtures::wait::{eventually, eventually_true};
use upm_runner::config::{DaemonSpec, WatchdogSpec};

const REST: &str = r#""name": "rest", "parts": [{"kind": "penny"}], "task": {"type": "hold", "duration_s": 0.2}"#;

/// Watchdog limits that a slow machine does not reach: these tests are not about the watchdog.
const PATIENT: WatchdogSpec =
    WatchdogSpec { hung: Duration::from_secs(600), no_part_s: 60.0, blocked: Duration::from_secs(60) };
/// Longest wait of a test.
const TIMEOUT: Duration = Duration::from_secs(20);

struct Unpark(Thread);

impl Wake for Unpark {
    fn wake(self: Arc<Self>) {
        self.0.unpark();
    }
}

/// Waits for a promise.
fn kept<T>(pending: impl Future<Output = T>) -> T {
    let mut pending = pin!(pending);
    let waker = Waker::from(Arc::new(Unpark(thread::current())));
    let mut context = Context::from_waker(&waker);
    loop {
        if let Poll::Ready(value) = pending.as_mut().poll(&mut context) {
            return value;
        }
        thread::park();
    }
}

fn spec(data: &Path) -> DaemonSpec {
    let file = Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../..")).join("configs/daemon.json");
    let mut spec = DaemonSpec::load(&file).unwrap();
    spec.data = data.to_owned();
    spec.listen = "127.0.0.1:0".parse().unwrap();
    spec.live_history_bytes = None;
    spec.queue = 3;
    spec.watchdog = PATIENT;
    // these tests are about submitted jobs
    spec.plates.iter_mut().for_each(|plate| plate.standing = None);
    spec
}

fn start(spec: DaemonSpec) -> Result<Daemon, StartFault> {
    let prepared = prepare(&spec).unwrap();
    Daemon::start(spec, prepared, MonotonicClock::new(), Timestamp::now, "1.2.3")
}

/// A running daemon without network, reached only through its backend.
struct RunningDaemon {
    backend: Arc<DaemonBackend>,
    _data: tempfile::TempDir,
}

impl RunningDaemon {
    fn new() -> Self {
        let data = tempfile::tempdir().unwrap();
        Self { backend: start(spec(data.path())).unwrap().backend, _data: data }
    }

    fn order(&self, text: &str, pace: Pace, key: Option<&str>) -> Result<JobCreated, Refusal> {
        let key = key.map(str::to_owned);
        kept(self.backend.submit(Submission { text: text.to_owned(), pace: Some(pace), key, caller: caller() }))
    }

    fn submit(&self, text: &str) -> Result<Job, Refusal> {
        self.order(text, Pace::Max, None).map(|submitted| submitted.job)
    }

    /// Stops plate upm-1, so that its jobs stay queued.
    fn pause(&self) {
        self.stopped();
        assert_eq!(kept(self.reset()).unwrap().state, PlateState::Paused);
    }

    /// Requests a reset of plate upm-1.
    fn reset(&self) -> Pending<Plate> {
        let request = ResetRequest { operator: "A. Person".into(), reason: "test".into() };
        self.backend.reset("upm-1", request, caller())
    }

    /// Stops plate upm-1; repeats until motors and disk have confirmed.
    fn stopped(&self) -> EStopped {
        eventually("the stop is seen through", || {
            let stopped = kept(self.backend.estop("upm-1", caller())).unwrap();
            (stopped.silent && stopped.persisted).then_some(stopped)
        })
    }

    fn ended(&self, id: &str) -> Job {
        eventually("the job ends", || {
            let job = kept(self.backend.job(id)).unwrap();
            (!matches!(job.state, JobState::Queued | JobState::Running)).then_some(job)
        })
    }
}

impl Drop for RunningDaemon {
    fn drop(&mut self) {
        assert_eq!(self.backend.state.plates.shutdown(TIMEOUT), [""; 0]);
        self.backend.state.store.close(Duration::from_secs(5));
    }
}

fn caller() -> Caller {
    Caller { name: "test".to_owned(), remote: None }
}

fn on(plate: &str) -> String {
    format!(r#"{{"plate": "{plate}", {REST}}}"#)
}

#[test]
fn a_job_goes_where_it_asks_to_or_where_its_rig_is() {
    let running = RunningDaemon::new();
    assert_eq!(running.submit(&on("upm-1")).unwrap().plate, "upm-1");
    assert_eq!(running.submit(&format!("{{{REST}}}")).unwrap().plate, "upm-2", "the default");
    let rig = std::fs::read_to_string(
        Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../..")).join("configs/rigs/upm-1.json"),
    )
    .unwrap();
    assert_eq!(running.submit(&format!(r#"{{"rig": {rig}, {REST}}}"#)).unwrap().plate, "upm-1");
    let lines = |refusal: Refusal| match refusal {
        Refusal::Invalid(faults) => faults.iter().map(ToString::to_string).collect(),
        other => vec![format!("{other:?}")],
    };
    let nowhere = lines(running.submit(&on("upm-3")).unwrap_err());
    assert_eq!(nowhere, [r#"job: plate: expected one of upm-1, upm-2, upm-2-evening, found "upm-3""#]);
    assert!(matches!(running.submit("{"), Err(Refusal::Malformed(faults)) if faults.len() == 1));
    assert!(matches!(running.submit("[]"), Err(Refusal::Invalid(_))));
}

#[test]
fn repeated_key_returns_the_first_answer_on_a_stopped_plate() {
    let running = RunningDaemon::new();
    running.pause();
    let text = on("upm-1");
    let first = running.order(&text, Pace::Max, Some("k")).unwrap();
    assert!(!first.replayed);
    kept(running.backend.estop("upm-1", caller())).unwrap();
    assert!(matches!(running.submit(&text), Err(Refusal::Conflict(_))), "the plate is stopped");
    let again = running.order(&text, Pace::Max, Some("k")).unwrap();
    assert!(again.replayed && again.job.id == first.job.id);
    let key_reused = |text: &str, pace| running.order(text, pace, Some("k")).unwrap_err() == Refusal::KeyReused;
    assert!(key_reused(&text, Pace::RealTime), "another pace is another order");
    assert!(key_reused(&text.replace("rest", "other"), Pace::Max));
}

#[test]
fn full_queue_refuses_jobs_and_runs_after_resume() {
    let running = RunningDaemon::new();
    running.pause();
    let jobs: Vec<Job> = (0..3).map(|_| running.submit(&on("upm-1")).unwrap()).collect();
    let full = running.submit(&on("upm-1")).unwrap_err();
    assert!(matches!(full, Refusal::QueueFull { queued: 3, retry_after_s: 1.. }), "{full:?}");
    let cancelled = kept(running.backend.cancel(&jobs[1].id, caller())).unwrap();
    assert_eq!(cancelled.state, JobState::Cancelled);
    assert!(kept(running.backend.journal(&jobs[0].id)).unwrap().is_none(), "it has not begun");
    assert!(matches!(kept(running.backend.cancel(&jobs[1].id, caller())), Err(Refusal::Conflict(_))));
    assert_eq!(kept(running.backend.plates()).unwrap().plates[0].queued, 2);
    kept(running.backend.resume("upm-1", caller())).unwrap();
    for job in [&jobs[0], &jobs[2]] {
        let ended = running.ended(&job.id);
        assert_eq!((ended.state, ended.reason.as_str()), (JobState::Completed, "every part held for 0.2 s"));
        assert_eq!(ended.report.unwrap()["outcome"], "completed");
        let mut journal = String::new();
        kept(running.backend.journal(&job.id)).unwrap().unwrap().read_to_string(&mut journal).unwrap();
        assert!(journal.starts_with(r#"{"type":"localised""#), "{journal}");
    }
}

#[test]
fn emergency_stop_cancels_the_running_job_and_bars_resume() {
    let running = RunningDaemon::new();
    let long = on("upm-1").replace("0.2", "60");
    let id = running.order(&long, Pace::RealTime, None).unwrap().job.id;
    eventually("a frame comes", || kept(running.backend.plates()).unwrap().plates[0].age_s);
    let stopped = running.stopped();
    assert!(stopped.silent_at_s.unwrap() - stopped.requested_at_s.unwrap() <= 0.02);
    let ended = running.ended(&id);
    assert_eq!((ended.state, ended.reason.as_str()), (JobState::Cancelled, "emergency stop"));
    assert!(matches!(kept(running.backend.resume("upm-1", caller())), Err(Refusal::Conflict(_))));
    assert!(matches!(kept(running.backend.estop("upm-9", caller())), Err(Refusal::Unknown(_))));
    assert!(running.backend.liveness_failures().is_empty() && running.backend.readiness_failures().is_empty());
    assert!(running.backend.metrics().contains("upm_estops_total{plate=\"upm-1\"} 1"), "{}", running.backend.metrics());
}

#[test]
fn waiting_reset_undoes_no_later_stop_and_is_dropped_with_its_caller() {
    let running = RunningDaemon::new();
    running.stopped();
    let held = running.backend.state.store.hold();
    let earlier = [running.reset(), running.reset()];
    drop(running.backend.estop("upm-1", caller()));
    let (given_up, last) = (running.reset(), running.reset());
    drop(given_up);
    drop(held);
    for reset in earlier {
        // the last reset may come before these
        assert!(matches!(kept(reset), Err(Refusal::Conflict(_))), "the plate was stopped again");
    }
    assert_eq!(kept(last).unwrap().state, PlateState::Paused, "it was for this one to do");
    assert!(matches!(kept(running.reset()), Err(Refusal::Conflict(_))), "the plate is not stopped");
}

fn all_jobs(running: &RunningDaemon) -> Vec<Job> {
    kept(running.backend.jobs(JobsQuery { state: None, limit: 100, cursor: None })).unwrap().jobs
}

#[test]
fn non_loopback_address_requires_a_long_token() {
    let data = tempfile::tempdir().unwrap();
    let lines = |spec: &DaemonSpec| match prepare(spec) {
        Ok(_) => Vec::new(),
        Err(faults) => faults.iter().map(|fault| format!("{}: {}", fault.path, fault.expected)).collect(),
    };
    let mut open = spec(data.path());
    open.listen = "0.0.0.0:0".parse().unwrap();
    let alone = "an address of this machine alone, as 127.0.0.1:8750, or a `token_file`: others can reach this one";
    assert_eq!(lines(&open), [format!("listen: {alone}")]);
    let token = data.path().join("token");
    open.token_file = Some(token.clone());
    let wanted = "a file that holds one token: at least 32 visible ASCII characters";
    for (text, held) in [(None, false), (Some("short"), false), (Some("0123456789abcdef0123456789abcdef\n"), true)] {
        text.into_iter().for_each(|text| std::fs::write(&token, text).unwrap());
        let expected = if held { Vec::new() } else { vec![format!("token_file: {wanted}")] };
        assert_eq!(lines(&open), expected, "{text:?}");
    }
    open.data = token;
    assert_eq!(lines(&open), ["data: a folder that can be written, or made"]);
}

#[test]
fn one_daemon_has_the_data() {
    let data = tempfile::tempdir().unwrap();
    let first = start(spec(data.path())).unwrap();
    assert!(matches!(start(spec(data.path())), Err(StartFault::Store(..))));
    assert!(first.backend.state.plates.shutdown(TIMEOUT).is_empty());
}
