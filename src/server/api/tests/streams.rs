use std::fs::{self, OpenOptions};
use std::io::{Read, Write};
use std::net::{TcpListener, TcpStream};
use std::path::Path;
use std::time::Duration;

use axum::body::Body;
use http_body_util::BodyExt;
use serde_json::json;

use super::fake::{JOB, job};
use super::{TestApi, request};
use crate::api::{EVENT_STREAMS, Job, Refusal};
use crate::http::{ShutdownReport, serve};
use crate::states::JobState;

/// A backend whose job is in this state and has this journal.
fn with_journal(folder: &Path, state: JobState, text: &str) -> TestApi {
    let path = folder.join("journal.jsonl");
    fs::write(&path, text).unwrap();
    let asked = TestApi::new();
    *asked.backend.state.lock().unwrap() = Some(state);
    *asked.backend.journal.lock().unwrap() = Some(path);
    asked
}

async fn watch(asked: &TestApi, after: &str) -> Body {
    let headers = if after.is_empty() { vec![] } else { vec![("last-event-id", after)] };
    let (status, headers, body) = asked.open(request("GET", &format!("/v1/jobs/{JOB}/events"), &headers, "")).await;
    assert_eq!(status, 200);
    assert_eq!(headers["cache-control"], "no-store");
    body
}

async fn all(body: Body) -> String {
    String::from_utf8(body.collect().await.unwrap().to_bytes().to_vec()).unwrap()
}

/// The next event of the stream, heartbeats skipped; empty at its end.
async fn next(body: &mut Body) -> String {
    loop {
        let Some(frame) = body.frame().await else { return String::new() };
        let text = String::from_utf8(frame.unwrap().into_data().unwrap().to_vec()).unwrap();
        if !text.starts_with(':') {
            return text;
        }
    }
}

fn job_event(state: JobState, id: Option<u64>) -> String {
    let id = id.map(|id| format!("id: {id}\n")).unwrap_or_default();
    format!("event: job\ndata: {}\n{id}\n", json!(Job { state, ..job() }))
}

fn line(id: u64, text: &str) -> String {
    format!("id: {id}\ndata: {text}\n\n")
}

/// Text with the members of every JSON object in one order.
fn sorted(text: &str) -> Vec<String> {
    let line = |line: &str| match line.strip_prefix("data: ") {
        Some(data) => serde_json::from_str::<serde_json::Value>(data).unwrap().to_string(),
        None => line.to_owned(),
    };
    let mut events: Vec<Vec<String>> = text.split("\n\n").map(|event| event.lines().map(line).collect()).collect();
    events.iter_mut().for_each(|event: &mut Vec<String>| event.sort());
    events.into_iter().map(|event| event.join("\n")).collect()
}

#[tokio::test]
async fn stream_of_an_ended_job_resumes_at_any_line_and_ends_with_the_job() {
    let folder = tempfile::tempdir().unwrap();
    let asked = with_journal(folder.path(), JobState::Completed, "{\"a\":1}\n{\"b\":22}\n{\"cut");
    let (first, second, end) = (line(8, "{\"a\":1}"), line(17, "{\"b\":22}"), job_event(JobState::Completed, None));
    for (after, wanted) in [
        ("0", format!("{first}{second}{end}")),
        ("8", format!("{second}{end}")),
        ("17", end.clone()),
        ("9", format!("{first}{second}{end}")),
        ("999", format!("{first}{second}{end}")),
        ("", end.clone()),
    ] {
        assert_eq!(sorted(&all(watch(&asked, after).await).await), sorted(&wanted), "{after}");
    }
    *asked.backend.journal.lock().unwrap() = None;
    assert_eq!(sorted(&all(watch(&asked, "0").await).await), sorted(&end), "the run folder is gone");
}

#[tokio::test]
async fn stream_follows_a_job_from_the_queue_to_its_end() {
    let folder = tempfile::tempdir().unwrap();
    let asked = with_journal(folder.path(), JobState::Queued, "");
    let mut body = watch(&asked, "").await;
    assert_eq!(sorted(&next(&mut body).await), sorted(&job_event(JobState::Queued, Some(0))));
    let append = |text: &str| {
        let mut file = OpenOptions::new().append(true).open(folder.path().join("journal.jsonl")).unwrap();
        file.write_all(text.as_bytes()).unwrap();
    };
    append("{\"a\":1}\n{\"b\"");
    *asked.backend.state.lock().unwrap() = Some(JobState::Running);
    assert_eq!(sorted(&next(&mut body).await), sorted(&job_event(JobState::Running, None)));
    assert_eq!(sorted(&next(&mut body).await), sorted(&line(8, "{\"a\":1}")));
    let mut late = watch(&asked, "").await;
    assert_eq!(sorted(&next(&mut late).await), sorted(&job_event(JobState::Running, Some(8))), "from now on");
    append(":2}\n");
    for body in [&mut body, &mut late] {
        assert_eq!(sorted(&next(body).await), sorted(&line(16, "{\"b\":2}")), "whole lines alone");
    }
    append("{\"c\":3}\n");
    *asked.backend.state.lock().unwrap() = Some(JobState::Cancelled);
    assert_eq!(sorted(&next(&mut body).await), sorted(&line(24, "{\"c\":3}")), "every line before the end");
    assert_eq!(sorted(&next(&mut body).await), sorted(&job_event(JobState::Cancelled, None)));
    assert_eq!(next(&mut body).await, "");
}

#[tokio::test]
async fn long_journal_is_sent_whole() {
    let folder = tempfile::tempdir().unwrap();
    let text: String = (0..200_000).map(|number| format!("{{\"n\":{number}}}\n")).collect();
    let asked = with_journal(folder.path(), JobState::Completed, &text);
    let seen = all(watch(&asked, "0").await).await;
    assert_eq!(seen.matches("\"n\":").count(), 200_000);
    assert!(seen.contains(&format!("id: {}\n", text.len())));
}

#[tokio::test]
async fn unanswering_store_ends_the_stream_and_it_can_be_resumed() {
    let folder = tempfile::tempdir().unwrap();
    let asked = with_journal(folder.path(), JobState::Running, "{\"a\":1}\n");
    let mut body = watch(&asked, "0").await;
    next(&mut body).await;
    assert_eq!(sorted(&next(&mut body).await), sorted(&line(8, "{\"a\":1}")));
    asked.backend.refuse(Refusal::Busy { why: "the job store is busy".to_owned(), retry_after_s: 1 });
    assert_eq!(next(&mut body).await, "");
    assert_eq!(sorted(&next(&mut watch(&asked, "8").await).await), sorted(&job_event(JobState::Running, Some(8))));
}

#[tokio::test]
async fn quiet_stream_shows_that_it_is_alive() {
    let folder = tempfile::tempdir().unwrap();
    let asked = with_journal(folder.path(), JobState::Running, "");
    let mut body = watch(&asked, "").await;
    next(&mut body).await;
    let heartbeat = body.frame().await.unwrap().unwrap().into_data().unwrap();
    assert!(heartbeat.starts_with(b":"), "{heartbeat:?}");
    asked.stop.cancel();
    assert_eq!(next(&mut body).await, "");
}

#[tokio::test]
async fn streams_are_counted() {
    let folder = tempfile::tempdir().unwrap();
    let asked = with_journal(folder.path(), JobState::Running, "");
    let mut held = Vec::new();
    for _ in 0..EVENT_STREAMS {
        held.push(watch(&asked, "").await);
    }
    let seen = asked.get(&format!("/v1/jobs/{JOB}/events")).await;
    assert_eq!((seen.status, seen.header("retry-after")), (503, "10"));
    assert_eq!(asked.event_streams.available_permits(), 0);
    held.pop();
    drop(watch(&asked, "").await);
    assert_eq!(asked.event_streams.available_permits(), 1);
}

#[test]
fn fifty_streams_end_at_shutdown() {
    let folder = tempfile::tempdir().unwrap();
    let asked = with_journal(folder.path(), JobState::Running, "");
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let address = listener.local_addr().unwrap();
    let (app, stop) = (asked.app.clone(), asked.stop.clone());
    let server = std::thread::spawn(move || serve(listener, app, &stop, Duration::from_secs(10), || ()).unwrap());
    let mut clients: Vec<TcpStream> = (0..50)
        .map(|_| {
            let mut client = TcpStream::connect(address).unwrap();
            client.set_read_timeout(Some(Duration::from_secs(10))).unwrap();
            write!(client, "GET /v1/jobs/{JOB}/events HTTP/1.1\r\nhost: localhost\r\n\r\n").unwrap();
            client.read_exact(&mut [0; 300]).unwrap();
            client
        })
        .collect();
    asked.stop.cancel();
    for client in &mut clients {
        let mut rest = String::new();
        client.read_to_string(&mut rest).unwrap();
        assert!(rest.ends_with("0\r\n\r\n"), "{rest}");
    }
    drop(clients);
    assert_eq!(server.join().unwrap(), ShutdownReport { dropped: 0 });
}
