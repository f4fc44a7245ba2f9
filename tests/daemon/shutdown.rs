//! The end on SIGTERM, with clients that do not let go.

use std::fs;
use std::io::{Read, Write};
use std::net::TcpStream;
use std::thread;
use std::time::Duration;

use super::served::{Served, in_real_time, moving};
use super::wire::{connect, head};

fn watcher(served: &Served, id: &str) -> TcpStream {
    let mut stream = connect(served.address());
    let request = head(served.address(), "GET", &format!("/v1/jobs/{id}/events"), &[("Last-Event-ID", "0")]);
    stream.write_all(format!("{request}\r\n").as_bytes()).unwrap();
    stream
}

#[test]
fn sigterm_closes_everything_in_time_whatever_clients_do() {
    in_real_time(|| {
        let mut served = Served::start();
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
        thread::sleep(Duration::from_millis(500));

        assert_eq!(served.terminate().code(), Some(0), "all was closed within the time there is for it");
        for reader in readers {
            let text = reader.join().unwrap().unwrap();
            assert!(text.contains("event: snapshot") && text.contains("event: bye"), "{text}");
        }
        drop((frozen, half));

        let run = served.run_folder("running");
        assert!(run.join("journal.jsonl").exists() && !run.join("run.rrd.part").exists());
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
    });
}
