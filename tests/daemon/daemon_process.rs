//! Test fixture: a separate daemon for each test.

use std::fs::{self, File};
use std::io::{BufRead, BufReader};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, ExitStatus, Output, Stdio};
use std::sync::mpsc::sync_channel;
use std::thread::{self, sleep};
use std::time::{Duration, Instant};

use rustix::fs::{CWD, FileType, Mode, mknodat};
use serde_json::{Value, json};
use tempfile::TempDir;

use super::http::{Answer, ask};

/// Longest wait for any condition.
const TIMEOUT: Duration = Duration::from_secs(60);

pub const LEFT: &str = "left";
pub const RIGHT: &str = "right";

/// A running daemon, killed on drop.
pub struct TestDaemon {
    child: Child,
    /// Address of the daemon.
    pub url: String,
    /// Configuration, data and files that a test writes.
    pub folder: TempDir,
}

pub fn root() -> PathBuf {
    PathBuf::from(env!("CARGO_MANIFEST_DIR"))
}

/// Configuration of two plates with one rig. The watchdog has long limits, since a test machine runs other work as
/// well.
pub fn config() -> Value {
    let rig = root().join("configs/rigs/upm-2.json");
    json!({
        "plates": [{"name": LEFT, "rig": rig}, {"name": RIGHT, "rig": rig}],
        "default_plate": LEFT,
        "watchdog": {"no_part_s": 60, "blocked_s": 60},
    })
}

impl TestDaemon {
    pub fn start() -> Self {
        Self::with(&config())
    }

    pub fn with(config: &Value) -> Self {
        let folder = TempDir::new().unwrap();
        fs::write(folder.path().join("daemon.json"), config.to_string()).unwrap();
        Self::in_folder(folder)
    }

    /// Starts a daemon with the configuration and its files in this folder.
    pub fn in_folder(folder: TempDir) -> Self {
        let (child, url) = spawn(folder.path(), "127.0.0.1:0");
        Self { child, url, folder }
    }

    /// Ends this daemon by `end` and starts another on the same folder.
    pub fn again(self, end: impl FnOnce(&mut Self)) -> Self {
        self.again_at("127.0.0.1:0", end)
    }

    /// As [`Self::again`], on the same port.
    pub fn again_there(self, end: impl FnOnce(&mut Self)) -> Self {
        let address = self.address().to_owned();
        self.again_at(&address, end)
    }

    fn again_at(mut self, listen: &str, end: impl FnOnce(&mut Self)) -> Self {
        end(&mut self);
        assert!(self.child.try_wait().unwrap().is_some(), "the daemon has ended");
        (self.child, self.url) = spawn(self.folder.path(), listen);
        self
    }

    /// Kills the daemon at once, to simulate a power cut.
    pub fn kill(&mut self) {
        self.child.kill().unwrap();
        self.child.wait().unwrap();
    }

    /// Sends SIGTERM and waits; returns the exit status.
    pub fn terminate(&mut self) -> ExitStatus {
        self.signal("-TERM");
        until("the daemon ends", || self.child.try_wait().unwrap())
    }

    /// Sends a signal, for example `-USR1`.
    pub fn signal(&self, name: &str) {
        assert!(Command::new("kill").args([name, &self.child.id().to_string()]).status().unwrap().success());
    }

    /// The complete log so far.
    pub fn log(&self) -> String {
        fs::read_to_string(self.folder.path().join("log")).unwrap()
    }

    /// Host and port of the daemon.
    pub fn address(&self) -> &str {
        self.url.strip_prefix("http://").unwrap()
    }

    pub fn ask(&self, method: &str, path: &str, headers: &[(&str, &str)], body: &str) -> Answer {
        ask(self.address(), method, path, headers, body.as_bytes())
    }

    pub fn get(&self, path: &str) -> Value {
        let answer = self.ask("GET", path, &[], "");
        assert_eq!(answer.status, 200, "{path}: {answer:?}");
        answer.json()
    }

    /// Queues a job; returns its id.
    pub fn submit(&self, job: &Value, pace: &str) -> String {
        let json = [("Content-Type", "application/json")];
        let answer = self.ask("POST", &format!("/v1/jobs?pace={pace}"), &json, &job.to_string());
        assert_eq!(answer.status, 201, "{answer:?}");
        answer.json()["id"].as_str().unwrap().to_owned()
    }

    pub fn job(&self, id: &str) -> Value {
        self.get(&format!("/v1/jobs/{id}"))
    }

    /// Waits until the job is in this state; returns the job.
    pub fn until_state(&self, id: &str, state: &str) -> Value {
        until(&format!("{id} is {state}"), || Some(self.job(id)).filter(|job| job["state"] == state))
    }

    /// Runs a short job on this plate to its end. Another plate that starts by itself has begun its oldest job by then.
    pub fn run_on(&self, plate: &str) {
        let mut job = rest("beside");
        job["plate"] = plate.into();
        let id = self.submit(&job, "max");
        self.until_state(&id, "completed");
    }

    /// Current state of a plate.
    pub fn plate(&self, name: &str) -> Value {
        let plates = self.get("/v1/plates");
        plates["plates"].as_array().unwrap().iter().find(|plate| plate["name"] == name).unwrap().clone()
    }

    /// Run folder of the job.
    pub fn run_folder(&self, job: &str) -> PathBuf {
        let runs = self.folder.path().join("data/runs");
        let named = |path: &PathBuf| path.file_name().unwrap().to_str().unwrap().starts_with(&format!("{job}-"));
        let found: Vec<PathBuf> =
            fs::read_dir(&runs).unwrap().map(|entry| entry.unwrap().path()).filter(named).collect();
        assert_eq!(found.len(), 1, "{job} in {}", runs.display());
        found[0].clone()
    }

    /// Number of complete lines in the job's journal.
    pub fn journal_lines(&self, job: &str) -> usize {
        let text = fs::read(self.run_folder(job).join("journal.jsonl")).unwrap_or_default();
        text.iter().filter(|&&byte| byte == b'\n').count()
    }

    /// Waits until the job on this plate has written a few cycles.
    pub fn until_moving(&self, job: &str, id: &str) {
        self.until_state(id, "running");
        until("the job moves parts", || {
            let moves = self.journal_lines(job) >= 4;
            assert!(moves || self.job(id)["state"] == "running", "{}", self.job(id));
            moves.then_some(())
        });
    }

    /// `upm` with arguments that address this daemon.
    pub fn upm(&self, args: &[&str]) -> Command {
        let mut command = Command::new(env!("CARGO_BIN_EXE_upm"));
        command.args(args).env("UPM_URL", &self.url).env_remove("UPM_TOKEN_FILE").current_dir(self.folder.path());
        command
    }

    /// Runs `upm`, expects this exit status, returns stdout and stderr.
    pub fn status(&self, args: &[&str], expected: i32) -> (String, String) {
        status_of(&self.upm(args).output().unwrap(), args, expected)
    }
}

impl Drop for TestDaemon {
    fn drop(&mut self) {
        self.child.kill().ok();
        self.child.wait().ok();
        if std::thread::panicking() {
            let log = fs::read_to_string(self.folder.path().join("log")).unwrap_or_default();
            eprintln!("the daemon's log:\n{log}");
        }
    }
}

/// Starts a daemon in this folder and reads its address from stdout.
fn spawn(folder: &Path, listen: &str) -> (Child, String) {
    let mut child = serve(folder, listen).spawn().unwrap();
    let mut stdout = BufReader::new(child.stdout.take().unwrap());
    let (sender, first) = sync_channel(1);
    thread::spawn(move || {
        let mut line = String::new();
        sender.send(stdout.read_line(&mut line).map(|_| line))
    });
    // a start that hangs fails its test
    let line = first.recv_timeout(TIMEOUT).map(Result::unwrap).unwrap_or_default();
    if !line.starts_with("http://") {
        child.kill().ok();
        child.wait().ok();
        panic!("first line {line:?}; log:\n{}", fs::read_to_string(folder.join("log")).unwrap_or_default());
    }
    (child, line.trim_end().to_owned())
}

/// `upm serve` in this folder.
pub fn serve(folder: &Path, listen: &str) -> Command {
    let log = File::options().create(true).append(true).open(folder.join("log")).unwrap();
    let mut command = Command::new(env!("CARGO_BIN_EXE_upm"));
    let config = folder.join("daemon.json");
    command.arg("serve").arg("--listen").arg(listen).arg("--data").arg(folder.join("data")).arg("--config").arg(config);
    command.stdin(Stdio::null()).stdout(Stdio::piped()).stderr(log);
    command
}

pub fn status_of(output: &Output, args: &[&str], expected: i32) -> (String, String) {
    let text = |bytes: &[u8]| String::from_utf8(bytes.to_vec()).unwrap();
    let (stdout, stderr) = (text(&output.stdout), text(&output.stderr));
    assert_eq!(output.status.code(), Some(expected), "{args:?}\nstdout: {stdout}\nstderr: {stderr}");
    assert!(!stderr.contains("panicked"), "{stderr}");
    (stdout, stderr)
}

/// Polls `look` until it returns a value.
pub fn until<T>(what: &str, mut look: impl FnMut() -> Option<T>) -> T {
    let from = Instant::now();
    loop {
        if let Some(found) = look() {
            return found;
        }
        assert!(from.elapsed() < TIMEOUT, "waited too long: {what}");
        sleep(Duration::from_millis(10));
    }
}

/// Replaces the file at `path` by a FIFO.
pub fn put_fifo(path: &Path) {
    fs::remove_file(path).ok();
    mknodat(CWD, path, FileType::Fifo, Mode::RUSR | Mode::WUSR, 0).unwrap();
}

/// A job of a short hold, done in a moment at any pace.
pub fn rest(name: &str) -> Value {
    of_penny(name, json!({"type": "hold", "duration_s": 0.2}), 60.0)
}

/// A job that moves a part until its plate time limit.
pub fn moving(name: &str, plate_time_s: f64) -> Value {
    of_penny(name, json!({"type": "plus_sign", "laps": 0}), plate_time_s)
}

/// A job of one penny with the planner that is ready soonest.
fn of_penny(name: &str, task: Value, plate_time_s: f64) -> Value {
    let limits = json!({"plate_time_s": plate_time_s});
    json!({"name": name, "parts": [{"kind": "penny"}], "planner": "synthesized_field", "task": task, "limits": limits})
}
