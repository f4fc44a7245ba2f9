use std::fs::OpenOptions;
use std::io::Write;

use super::*;
use crate::api::EVENT_STREAMS;
use crate::http::{Scope, Tokens};

/// An event: its kind, `id` and data; for one of kind `job` the job's state.
type Heard = (&'static str, Option<u64>, String);

fn heard(text: &str) -> Heard {
    let field = |name: &str| text.lines().find_map(|line| line.strip_prefix(name)).map(str::to_owned);
    let (id, data) = (field("id: ").map(|id| id.parse().unwrap()), field("data: ").unwrap());
    match field("event: ").as_deref() {
        Some("job") => {
            let job: crate::api::Job = serde_json::from_str(&data).unwrap();
            ("job", id, job.state.code().to_owned())
        }
        _ => ("", id, data),
    }
}

fn job(state: &str, id: Option<u64>) -> Heard {
    ("job", id, state.to_owned())
}

fn line(id: u64, text: &str) -> Heard {
    ("", Some(id), text.to_owned())
}

fn watch(api: &TestApi, row: &JobRow, after: &str) -> Body {
    let headers = if after.is_empty() { vec![] } else { vec![("last-event-id", after)] };
    let request = request("GET", &format!("/v1/jobs/{}/events", row.id), &headers, "");
    let (status, headers, body) = api.runtime.block_on(api.open(request));
    assert_eq!((status, &headers["cache-control"]), (200, &"no-store".parse().unwrap()));
    body
}

fn all(api: &TestApi, body: Body) -> Vec<Heard> {
    let text = api.runtime.block_on(body.collect()).unwrap().to_bytes();
    String::from_utf8(text.to_vec()).unwrap().split_terminator("\n\n").map(heard).collect()
}

/// The next event of the stream, heartbeats skipped; `None` at its end.
fn next(api: &TestApi, body: &mut Body) -> Option<Heard> {
    loop {
        let frame = api.runtime.block_on(body.frame())?;
        let text = String::from_utf8(frame.unwrap().into_data().unwrap().to_vec()).unwrap();
        if !text.starts_with(':') {
            return Some(heard(&text));
        }
    }
}

/// Begins the queued job with this journal; the journal's path.
fn begin_with(api: &TestApi, text: &str) -> PathBuf {
    let journal = api.begin().join("journal.jsonl");
    std::fs::write(&journal, text).unwrap();
    journal
}

#[test]
fn stream_of_an_ended_job_resumes_at_any_line_and_ends_with_the_job() {
    let api = TestApi::stopped();
    let row = api.queue();
    let journal = begin_with(&api, "{\"a\":1}\n{\"b\":22}\n{\"cut");
    api.end(&row, JobState::Completed, RecordingStatus::None);
    let lines = [line(8, "{\"a\":1}"), line(17, "{\"b\":22}"), job("completed", None)];
    for (after, from) in [("0", 0), ("8", 1), ("17", 2), ("9", 0), ("999", 0), ("", 2)] {
        assert_eq!(all(&api, watch(&api, &row, after)), lines[from..], "{after}");
    }
    let text: String = (0..200_000).map(|number| format!("{{\"n\":{number}}}\n")).collect();
    std::fs::write(&journal, &text).unwrap();
    let long = all(&api, watch(&api, &row, "0"));
    assert_eq!((long.len(), long[199_999].1), (200_001, Some(text.len() as u64)));
    std::fs::remove_file(journal).unwrap();
    assert_eq!(all(&api, watch(&api, &row, "0")), lines[2..], "the run folder is gone");
}

#[test]
fn stream_follows_a_job_from_the_queue_to_its_end() {
    let api = TestApi::stopped();
    let row = api.queue();
    let mut body = watch(&api, &row, "");
    assert_eq!(next(&api, &mut body), Some(job("queued", Some(0))));
    let journal = begin_with(&api, "{\"a\":1}\n{\"b\"");
    let append = |text: &str| {
        OpenOptions::new().append(true).open(&journal).unwrap().write_all(text.as_bytes()).unwrap();
    };
    assert_eq!(next(&api, &mut body), Some(job("running", None)));
    assert_eq!(next(&api, &mut body), Some(line(8, "{\"a\":1}")));
    let mut late = watch(&api, &row, "");
    assert_eq!(next(&api, &mut late), Some(job("running", Some(8))), "from now on");
    append(":2}\n");
    for body in [&mut body, &mut late] {
        assert_eq!(next(&api, body), Some(line(16, "{\"b\":2}")), "whole lines alone");
    }
    append("{\"c\":3}\n");
    api.end(&row, JobState::Cancelled, RecordingStatus::None);
    assert_eq!(next(&api, &mut body), Some(line(24, "{\"c\":3}")), "every line before the end");
    assert_eq!(next(&api, &mut body), Some(job("cancelled", None)));
    assert_eq!(next(&api, &mut body), None);
}

#[test]
fn quiet_stream_shows_that_it_is_alive_and_ends_with_the_store() {
    let api = TestApi::stopped();
    let row = api.queue();
    let mut body = watch(&api, &row, "");
    next(&api, &mut body);
    let heartbeat = api.runtime.block_on(body.frame()).unwrap().unwrap().into_data().unwrap();
    assert!(heartbeat.starts_with(b":"), "{heartbeat:?}");
    assert!(api.daemon.store.close(TIMEOUT));
    assert_eq!(next(&api, &mut body), None);
}

#[test]
fn stream_ends_when_its_token_is_replaced() {
    let api = TestApi::stopped();
    let row = api.queue();
    let hold = |letter: &str| {
        let mut tokens = Tokens::default();
        tokens.add("read", &letter.repeat(32), Scope::Read).unwrap();
        assert!(api.daemon.tokens.replace(tokens));
    };
    let open = |letter: &str| {
        let bearer = format!("Bearer {}", letter.repeat(32));
        let headers = [("authorization", bearer.as_str())];
        api.runtime.block_on(api.open(request("GET", &format!("/v1/jobs/{}/events", row.id), &headers, "")))
    };
    hold("a");
    let (status, _, mut body) = open("a");
    assert_eq!((status, next(&api, &mut body)), (200, Some(job("queued", Some(0)))));
    hold("b");
    assert_eq!(next(&api, &mut body), None);
    assert_eq!((open("a").0, open("b").0), (401, 200));
}

#[test]
fn streams_are_counted() {
    let api = TestApi::stopped();
    let row = api.queue();
    let mut held: Vec<Body> = (0..EVENT_STREAMS).map(|_| watch(&api, &row, "")).collect();
    let seen = api.get(&format!("/v1/jobs/{}/events", row.id));
    assert_eq!((seen.status, seen.header("retry-after")), (503, "10"));
    held.pop();
    drop(watch(&api, &row, ""));
    assert_eq!(api.daemon.event_streams.available_permits(), 1);
}
