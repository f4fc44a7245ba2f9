//! The API of a daemon whose plates run, without a socket.

mod contract;
mod input;
mod jobs;
mod recordings;
mod streams;

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Duration;

use axum::Router;
use axum::body::Body;
use axum::http::{HeaderMap, Request};
use bytes::Bytes;
use http_body_util::BodyExt;
use jiff::Timestamp;
use serde_json::Value;
use tokio::runtime::{Builder, Runtime};
use tower::ServiceExt;

use super::start::Daemon;
use super::{StartError, prepare};
use crate::api::{DaemonState, app};
use crate::http::{BLOCKING_THREADS, ProblemDocument};
use crate::store::{JobRow, JobState, Pace, RecordingStatus, SubmitOutcome};
use crate::supervisor::PlateHandle;
use upm_core::time::MonotonicClock;
use upm_fixtures::wait::eventually;
use upm_runner::config::{DaemonSpec, WatchdogSpec};

const REST: &str = r#"{"plate": "upm-1", "name": "rest", "parts": [{"kind": "penny"}],
    "task": {"type": "hold", "duration_s": 0.2}}"#;

/// Watchdog limits that a slow machine does not reach: these tests are not about the watchdog.
const PATIENT: WatchdogSpec =
    WatchdogSpec { hung: Duration::from_secs(600), no_part_s: 60.0, blocked: Duration::from_secs(60) };
/// Longest wait of a test.
const TIMEOUT: Duration = Duration::from_secs(20);

struct TestApi {
    runtime: Runtime,
    app: Router,
    daemon: Arc<DaemonState>,
    _data: tempfile::TempDir,
}

struct ApiAnswer {
    status: u16,
    headers: HeaderMap,
    body: Bytes,
}

fn spec(data: &Path) -> DaemonSpec {
    let file = Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../..")).join("configs/daemon.json");
    let mut spec = DaemonSpec::load(&file).unwrap();
    spec.data = data.to_owned();
    spec.listen = "127.0.0.1:0".parse().unwrap();
    spec.queue = 3;
    spec.watchdog = PATIENT;
    // these tests are about submitted jobs
    spec.plates.iter_mut().for_each(|plate| plate.standing = None);
    spec
}

fn start(spec: DaemonSpec) -> Result<Daemon, StartError> {
    let prepared = prepare(&spec).unwrap();
    Daemon::start(spec, prepared, MonotonicClock::new(), Timestamp::now, "0.0.0")
}

impl TestApi {
    fn new() -> Self {
        Self::with(|_| ())
    }

    /// With a changed configuration.
    fn with(change: impl FnOnce(&mut DaemonSpec)) -> Self {
        let data = tempfile::tempdir().unwrap();
        let mut spec = spec(data.path());
        change(&mut spec);
        let Daemon { state: daemon, .. } = start(spec).unwrap();
        let app = app(Arc::clone(&daemon));
        let runtime =
            Builder::new_current_thread().enable_all().max_blocking_threads(BLOCKING_THREADS).build().unwrap();
        Self { runtime, app, daemon, _data: data }
    }

    /// With plate upm-1 stopped, so that jobs of tests stay as they are.
    fn stopped() -> Self {
        let api = Self::new();
        assert!(api.plate().estop());
        api
    }

    fn plate(&self) -> &Arc<PlateHandle> {
        self.daemon.plates.get("upm-1").unwrap()
    }

    async fn open(&self, request: Request<Body>) -> (u16, HeaderMap, Body) {
        let (parts, body) = self.app.clone().oneshot(request).await.unwrap().into_parts();
        (parts.status.as_u16(), parts.headers, body)
    }

    async fn answer(&self, request: Request<Body>) -> ApiAnswer {
        let (status, headers, body) = self.open(request).await;
        let body = body.collect().await.unwrap().to_bytes();
        if status >= 400 {
            let document: ProblemDocument = serde_json::from_slice(&body).unwrap();
            assert_eq!(document.status, status);
            assert!(!document.title.is_empty() && document.instance.is_some(), "{document:?}");
        }
        ApiAnswer { status, headers, body }
    }

    fn ask(&self, request: Request<Body>) -> ApiAnswer {
        self.runtime.block_on(self.answer(request))
    }

    fn get(&self, path: &str) -> ApiAnswer {
        self.ask(request("GET", path, &[], ""))
    }

    fn post(&self, path: &str, body: &str) -> ApiAnswer {
        self.ask(request("POST", path, &[("content-type", "application/json")], body.to_owned()))
    }

    /// Submits a job that must be accepted; its id.
    fn submit(&self, text: &str) -> String {
        let seen = self.post("/v1/jobs?pace=max", text);
        assert_eq!(seen.status, 201, "{:?}", seen.body);
        seen.json()["id"].as_str().unwrap().to_owned()
    }

    /// The job once it has ended.
    fn ended(&self, id: &str) -> Value {
        eventually("the job ends", || {
            let job = self.get(&format!("/v1/jobs/{id}")).json();
            (!["queued", "running"].contains(&job["state"].as_str().unwrap())).then_some(job)
        })
    }

    /// Queues a job on the stopped plate.
    fn queue(&self) -> JobRow {
        let job = self.plate().rules.validated(REST, Pace::Max).unwrap();
        let Ok(Some(SubmitOutcome::New(row))) = self.daemon.store.accept(&job, || true) else { panic!("not queued") };
        row
    }

    /// Begins the queued job as its plate would, but runs nothing; its run folder.
    fn begin(&self) -> PathBuf {
        let store = &self.daemon.store;
        store.runs().join(store.claim("upm-1").unwrap().unwrap().folder.unwrap())
    }

    fn end(&self, row: &JobRow, state: JobState, recording: RecordingStatus) {
        let mut row = self.daemon.store.job(&row.id).unwrap().unwrap();
        row.job.set_end(state, "");
        row.job.recording = recording;
        self.daemon.store.finish(&row).unwrap();
    }
}

impl Drop for TestApi {
    fn drop(&mut self) {
        assert_eq!(self.daemon.plates.shutdown(TIMEOUT), [""; 0]);
        self.daemon.store.close(Duration::from_secs(5));
    }
}

impl ApiAnswer {
    fn json(&self) -> Value {
        serde_json::from_slice(&self.body).unwrap()
    }

    fn header(&self, name: &str) -> &str {
        self.headers.get(name).map_or("", |value| value.to_str().unwrap())
    }
}

fn request(method: &str, path: &str, headers: &[(&str, &str)], body: impl Into<Body>) -> Request<Body> {
    let builder = Request::builder().method(method).uri(path).header("host", "localhost:8750");
    let builder = headers.iter().fold(builder, |builder, (name, value)| builder.header(*name, *value));
    builder.body(body.into()).unwrap()
}
