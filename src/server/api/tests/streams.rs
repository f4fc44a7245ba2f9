use std::io::{Read, Write};
use std::net::{TcpListener, TcpStream};
use std::time::Duration;

use axum::body::Body;
use http_body_util::BodyExt;

use super::fake::JOB;
use super::{TestApi, request};
use crate::api::{EVENT_STREAMS, Refusal, ReplayPage, StreamEvent, StreamStart};
use crate::http::{ShutdownReport, serve};

const HEAD: &str = "retry: 1000\n\nevent: snapshot\ndata: {\"x\":1}\n\n";

/// Start of a stream for a client without a last event id: it carries an id to reconnect with.
fn head_at(id: u64) -> String {
    HEAD.replace("event: snapshot", &format!("id: {id}\nevent: snapshot"))
}

fn cycle(seq: u64) -> StreamEvent {
    StreamEvent::new(Some(seq), "cycle", "{}")
}

fn text_of(seqs: impl IntoIterator<Item = u64>) -> String {
    seqs.into_iter().map(|seq| format!("id: {seq}\nevent: cycle\ndata: {{}}\n\n")).collect()
}

/// A backend whose job has `newest` as its newest event, with events stored from `oldest` on.
fn asked(oldest: u64, newest: u64, is_over: bool) -> TestApi {
    let asked = TestApi::new();
    stand(&asked, oldest, newest, is_over);
    asked
}

fn stand(asked: &TestApi, oldest: u64, newest: u64, is_over: bool) {
    *asked.backend.stream_start.lock().unwrap() =
        Some(StreamStart { snapshot: "{\"x\":1}".to_owned(), newest, is_over });
    *asked.backend.ready.lock().unwrap() = ReplayPage { oldest, events: (oldest..=newest).map(cycle).collect() };
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

/// The next part of the stream, heartbeats skipped.
async fn next(body: &mut Body) -> String {
    loop {
        let Some(frame) = body.frame().await else { return String::new() };
        let text = String::from_utf8(frame.unwrap().into_data().unwrap().to_vec()).unwrap();
        if text != ": hb\n\n" {
            return text;
        }
    }
}

const OVER: &str = "event: bye\ndata: {\"code\":\"job_over\",\"why\":\"the job is over\"}\n\n";

#[tokio::test]
async fn a_stream_resumes_after_any_event() {
    let asked = asked(1, 1203, true);
    for after in [0, 1, 499, 500, 501, 1202, 1203] {
        let text = all(watch(&asked, &after.to_string()).await).await;
        assert_eq!(text, format!("{HEAD}{}{OVER}", text_of(after + 1..=1203)), "{after}");
    }
    let (head, end) = (head_at(1202), text_of([1203]));
    assert_eq!(all(watch(&asked, "").await).await, format!("{head}{end}{OVER}"), "the end itself");
}

#[tokio::test]
async fn pruned_events_are_reported_as_a_gap() {
    let old = asked(100, 102, true);
    let gap = "event: gap\ndata: {\"from\":6,\"to\":99}\n\n";
    assert_eq!(all(watch(&old, "5").await).await, format!("{HEAD}{gap}{}{OVER}", text_of(100..=102)));
    let gap = "event: gap\ndata: {\"from\":103,\"to\":200}\n\n";
    assert_eq!(all(watch(&old, "200").await).await, format!("{HEAD}{gap}{OVER}"));
    stand(&old, 103, 102, true);
    let gap = "event: gap\ndata: {\"from\":6,\"to\":102}\n\n";
    assert_eq!(all(watch(&old, "5").await).await, format!("{HEAD}{gap}{OVER}"));
}

#[tokio::test]
async fn live_events_come_once_and_end_with_the_job() {
    let asked = asked(1, 3, false);
    let mut body = watch(&asked, "1").await;
    let sender = asked.backend.senders.lock().unwrap().pop().unwrap();
    for event in [
        cycle(3),
        cycle(4),
        StreamEvent::new(None, "look", "{}"),
        cycle(5),
        StreamEvent::new(Some(6), "finished", "{}"),
    ] {
        assert!(sender.offer(&event));
    }
    assert_eq!(next(&mut body).await, HEAD);
    assert_eq!(next(&mut body).await, text_of(2..=3));
    assert_eq!(next(&mut body).await, text_of([4]));
    assert_eq!(next(&mut body).await, "event: look\ndata: {}\n\n");
    assert_eq!(next(&mut body).await, text_of([5]));
    assert_eq!(next(&mut body).await, "id: 6\nevent: finished\ndata: {}\n\n");
    assert_eq!(next(&mut body).await, OVER);
    assert_eq!(next(&mut body).await, "");
    assert!(sender.is_closed());
}

#[tokio::test]
async fn slow_client_gets_the_gap_and_a_new_snapshot() {
    let asked = asked(1, 0, false);
    let mut body = watch(&asked, "").await;
    assert_eq!(next(&mut body).await, head_at(0));
    let slow = asked.backend.senders.lock().unwrap().pop().unwrap();
    (1..=1000).for_each(|seq| assert!(slow.offer(&cycle(seq))));
    stand(&asked, 1, 1000, false);
    let head = head_at(1000);
    assert_eq!(next(&mut body).await, format!("event: gap\ndata: {{\"from\":1,\"to\":1000}}\n\n{head}"));
    assert!(slow.is_closed(), "the old queue is given back");
    let sender = asked.backend.senders.lock().unwrap().pop().unwrap();
    assert!(sender.offer(&cycle(1001)));
    assert_eq!(next(&mut body).await, text_of([1001]));
}

#[tokio::test]
async fn slow_client_gets_the_end_that_it_missed() {
    let asked = asked(1, 0, false);
    let mut body = watch(&asked, "").await;
    assert_eq!(next(&mut body).await, head_at(0));
    let slow = asked.backend.senders.lock().unwrap().pop().unwrap();
    (1..=1000).for_each(|seq| assert!(slow.offer(&cycle(seq))));
    stand(&asked, 1, 1001, true);
    let head = head_at(1000);
    assert_eq!(next(&mut body).await, format!("event: gap\ndata: {{\"from\":1,\"to\":1000}}\n\n{head}"));
    assert_eq!(next(&mut body).await, text_of([1001]), "what is not in the gap comes");
    assert_eq!(next(&mut body).await, OVER);
}

#[tokio::test]
async fn unanswering_store_ends_the_stream_without_a_gap() {
    let asked = asked(1, 3, true);
    let body = watch(&asked, "1").await;
    asked.backend.refuse(Refusal::Busy { why: "the job store is busy".to_owned(), retry_after_s: 1 });
    let bye = "event: bye\ndata: {\"code\":\"store_silent\",\"why\":\"the job store does not answer now\"}\n\n";
    assert_eq!(all(body).await, format!("{HEAD}{bye}"));
    assert_eq!(all(watch(&asked, "1").await).await, format!("{HEAD}{}{OVER}", text_of(2..=3)), "it can be had later");
}

#[tokio::test]
async fn a_quiet_stream_shows_that_it_is_alive_and_ends_with_the_daemon() {
    let asked = asked(1, 0, false);
    let mut body = watch(&asked, "").await;
    assert_eq!(next(&mut body).await, head_at(0));
    let heartbeat = body.frame().await.unwrap().unwrap().into_data().unwrap();
    assert_eq!(heartbeat, ": hb\n\n");
    asked.stop.cancel();
    assert_eq!(next(&mut body).await, "event: bye\ndata: {\"code\":\"daemon_ends\",\"why\":\"the daemon ends\"}\n\n");
    assert_eq!(next(&mut body).await, "");
}

#[tokio::test]
async fn streams_are_counted() {
    let asked = asked(1, 0, false);
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
fn fifty_clients_get_a_bye_at_shutdown() {
    let asked = TestApi::new();
    stand(&asked, 1, 0, false);
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
        assert!(rest.contains("event: bye\ndata: {\"code\":\"daemon_ends\",\"why\":\"the daemon ends\"}"), "{rest}");
    }
    drop(clients);
    assert_eq!(server.join().unwrap(), ShutdownReport { dropped: 0 });
}
