//! Shutdown on SIGTERM, with clients that keep their connections open and a log without a reader.

use std::fs;
use std::io::{BufRead, BufReader, PipeReader, PipeWriter, Read, Write, pipe};
use std::net::TcpStream;
use std::process::{Child, Command};
use std::thread;
use std::time::{Duration, Instant};

use rustix::fs::{OFlags, fcntl_setfl};
use tempfile::TempDir;

use super::daemon_process::{LEFT, TestDaemon, config, moving, serve, until};
use super::http::{ask, connect, head};

fn watcher(served: &TestDaemon, id: &str) -> TcpStream {
    let mut stream = connect(served.address());
    let request = head(served.address(), "GET", &format!("/v1/jobs/{id}/events"), &[("Last-Event-ID", "0")]);
    stream.write_all(format!("{request}\r\n").as_bytes()).unwrap();
    stream
}

#[test]
fn sigterm_closes_everything_in_time_despite_frozen_clients() {
    let mut served = TestDaemon::start();
    let id = served.submit(&moving("running", 600.0), "real-time");
    served.until_moving("running", &id);

    let (mut live, frozen): (Vec<_>, Vec<_>) =
        (0..55).map(|_| watcher(&served, &id)).enumerate().partition(|(i, _)| *i < 50);
    let readers: Vec<_> = live
        .drain(..)
        .map(|(_, mut stream)| {
            thread::spawn(move || {
                let mut text = String::new();
                stream.read_to_string(&mut text).map(|_| text)
            })
        })
        .collect();
    let half: Vec<TcpStream> = (0..5)
        .map(|_| {
            let mut stream = connect(served.address());
            stream.write_all(b"POST /v1/jobs HTTP/1.1\r\nHost: 127").unwrap();
            stream
        })
        .collect();
    until("all watchers are there", || {
        let metrics = served.ask("GET", "/metrics", &[], "");
        String::from_utf8(metrics.body).unwrap().contains("upm_event_streams 55").then_some(())
    });

    assert_eq!(served.terminate().code(), Some(0), "all was closed within the time there is for it");
    for reader in readers {
        let text = reader.join().unwrap().unwrap();
        assert!(text.contains("event: job\n") && text.ends_with("0\r\n\r\n"), "{text}");
    }
    drop((frozen, half));

    let run = served.run_folder("running");
    assert!(run.join("journal.jsonl").exists());
    let report = fs::read_to_string(run.join("report.json")).unwrap();
    assert!(report.contains("\"cancelled\""), "{report}");
    let journal = fs::read_to_string(run.join("journal.jsonl")).unwrap();
    assert!(journal.ends_with('\n'), "the last line is whole");

    let served = served.again(|_| {});
    let job = served.job(&id);
    assert_eq!(job["state"], "interrupted", "{job}");
    if cfg!(feature = "rerun") {
        assert!(run.join("run.rrd").exists());
        assert_eq!(job["recording"], "whole", "{job}");
    }
}

/// A pipe whose buffer is full.
fn full_pipe() -> (PipeReader, PipeWriter) {
    let (reader, mut writer) = pipe().unwrap();
    fcntl_setfl(&writer, OFlags::NONBLOCK).unwrap();
    for size in [4096, 1] {
        while matches!(writer.write(&vec![b'x'; size]), Ok(1..)) {}
    }
    fcntl_setfl(&writer, OFlags::empty()).unwrap();
    (reader, writer)
}

/// A child process that is killed on drop.
struct Killed(Child);

impl Drop for Killed {
    fn drop(&mut self) {
        self.0.kill().ok();
        self.0.wait().ok();
    }
}

#[test]
fn unread_log_delays_neither_a_stop_nor_the_shutdown() {
    let folder = TempDir::new().unwrap();
    fs::write(folder.path().join("daemon.json"), config().to_string()).unwrap();
    let (reader, writer) = full_pipe();
    let mut daemon = Killed(serve(folder.path(), "127.0.0.1:0").arg("-vv").stderr(writer).spawn().unwrap());
    let mut line = String::new();
    BufReader::new(daemon.0.stdout.take().unwrap()).read_line(&mut line).unwrap();
    let address = line.trim_end().strip_prefix("http://").unwrap();
    for _ in 0..3 {
        assert_eq!(ask(address, "POST", &format!("/v1/plates/{LEFT}/estop"), &[], b"").status, 200);
    }
    let asked_at = Instant::now();
    assert!(Command::new("kill").args(["-TERM", &daemon.0.id().to_string()]).status().unwrap().success());
    let status = until("the daemon ends", || daemon.0.try_wait().unwrap());
    assert_eq!(status.code(), Some(0), "it ended in order");
    assert!(asked_at.elapsed() < Duration::from_secs(2), "{:?}", asked_at.elapsed());
    drop(reader);
}
