use serde_json::{Value, json};

use super::events::{EventCounts, ReceivedEvent};
use super::follow::{StreamFollower, StreamItem};
use super::job_display::{line_of, note_of};
use crate::cli::daemon::client::testing::{Canned, FakeServer, JOB, events, job, problem};
use crate::cli::daemon::client::{Client, ClientRefusal};
use upm_server::states::JobState;

fn read(text: &str) -> Vec<ReceivedEvent> {
    let mut stream = EventCounts::new(text.as_bytes());
    std::iter::from_fn(|| stream.next().unwrap()).collect()
}

fn event(id: Option<u64>, kind: &str, data: Value) -> ReceivedEvent {
    ReceivedEvent { id, kind: kind.to_owned(), data }
}

/// All messages about a job whose stream the server serves.
fn heard(server: &FakeServer, after: Option<u64>) -> Vec<StreamItem> {
    let client = Client::at(&server.url).unwrap();
    let mut follower = StreamFollower::new(client, format!("/v1/jobs/{JOB}/events"), after).stalled();
    std::iter::from_fn(|| follower.next()).take(1000).collect()
}

fn kinds(heard: &[StreamItem]) -> Vec<String> {
    let kind = |heard: &StreamItem| match heard {
        StreamItem::Event(event) => format!("{} {}", event.kind, event.id.map_or(String::new(), |id| id.to_string())),
        StreamItem::Lost(_) => "lost".to_owned(),
        StreamItem::Refused(_) => "refused".to_owned(),
    };
    heard.iter().map(|heard| kind(heard).trim_end().to_owned()).collect()
}

fn snapshot(state: JobState) -> String {
    format!("retry: 1000\n\nevent: snapshot\ndata: {}\n\n", json!({"job": job(state), "plate": {}}))
}

#[test]
fn events_are_parsed_per_the_sse_standard() {
    assert_eq!(
        read("retry: 1000\n\nid: 7\nevent: cycle\ndata: {\"a\":1}\n\n"),
        [event(Some(7), "cycle", json!({"a": 1}))]
    );
    assert_eq!(read("id: 7\r\nevent: look\r\ndata:[1,\r\ndata: 2]\r\n\r\n"), [event(Some(7), "look", json!([1, 2]))]);
    assert_eq!(read(": hb\n\n: hb\n\nevent: gap\ndata: {}\n\n"), [event(None, "gap", json!({}))]);
    assert_eq!(read("id: 8\nevent: cycle\ndata: 1\n"), [], "an event without its empty line is cut short");
    assert_eq!(read("id: 8\nevent: cycle\ndata: 1\n\nid: 9\nevent"), [event(Some(8), "cycle", json!(1))]);
    assert_eq!(read("event: odd\ndata: not json\n\n"), [event(None, "odd", Value::Null)]);
    assert!(EventCounts::new(std::io::repeat(b'x')).next().is_err(), "a line without end is not kept");
}

#[test]
fn a_job_is_followed_over_a_cut_in_the_middle_of_an_event() {
    let (running, completed) = (snapshot(JobState::Running), snapshot(JobState::Completed));
    let first = events(&[&running, "id: 1\nevent: state\ndata: {}\n\nid: 2\nevent: cycle\nda"], false);
    let none = json!([]);
    let second = events(&[&running, "id: 2\nevent: cycle\ndata: {}\n\n", "event: look\ndata: {}\n\n"], true);
    let third = events(
        &[&completed, "id: 3\nevent: finished\ndata: {\"state\":\"completed\"}\n\nevent: bye\ndata: {}\n\n"],
        true,
    );
    let server = FakeServer::saying(vec![first, Canned::Hangup, problem(503, "starting", "", &none), second, third]);
    let wanted =
        ["snapshot", "state 1", "lost", "snapshot", "cycle 2", "look", "lost", "snapshot", "finished 3", "bye"];
    assert_eq!(kinds(&heard(&server, None)), wanted);
    let resumed: Vec<_> = server.asked().iter().map(|asked| asked.header("last-event-id").map(str::to_owned)).collect();
    assert_eq!(resumed, [None, Some("1"), Some("1"), Some("1"), Some("2")].map(|id| id.map(str::to_owned)));
}

#[test]
fn watching_ends_once_the_daemon_reports_the_job_over() {
    let (over, bye) =
        (snapshot(JobState::Interrupted), "event: bye\ndata: {\"code\":\"job_over\",\"why\":\"the job is over\"}\n\n");
    let server = FakeServer::saying(vec![events(&[&over, bye], true)]);
    assert_eq!(kinds(&heard(&server, Some(0))), ["snapshot", "bye"]);
    assert_eq!(server.asked().len(), 1);
    assert_eq!(server.asked()[0].header("last-event-id"), Some("0"));

    let later = "event: bye\ndata: {\"code\":\"store_silent\",\"why\":\"the job store does not answer now\"}\n\n";
    let finished = "id: 3\nevent: finished\ndata: {}\n\n";
    let server = FakeServer::saying(vec![events(&[&over, later], true), events(&[&over, finished, bye], true)]);
    assert_eq!(kinds(&heard(&server, Some(0))), ["snapshot", "bye", "lost", "snapshot", "finished 3", "bye"]);
}

#[test]
fn watching_ends_when_the_daemon_refuses_or_stays_unreachable() {
    let none = json!([]);
    let server = FakeServer::saying(vec![problem(503, "too many event streams", "Retry-After: 10\r\n", &none)]);
    let all = heard(&server, None);
    let [StreamItem::Refused(refusal)] = &all[..] else { panic!("{all:?}") };
    assert_eq!(refusal.line(), "too many event streams; try again in 10 s");
    assert_eq!(server.asked().len(), 1, "nothing was followed yet that could be lost");

    let running = events(&[&snapshot(JobState::Running)], false);
    let server = FakeServer::saying(vec![running.clone(), problem(404, "no such job", "", &none)]);
    assert_eq!(kinds(&heard(&server, None)), ["snapshot", "lost", "refused"]);

    let server = FakeServer::saying(vec![running, Canned::Hangup]);
    let all = heard(&server, None);
    assert_eq!(kinds(&all), ["snapshot", "lost", "refused"]);
    assert!(matches!(all.last(), Some(StreamItem::Refused(ClientRefusal::Lost(_)))));
    assert!((10..50).contains(&server.asked().len()), "{}", server.asked().len());
}

#[test]
fn each_event_is_shown_in_one_line() {
    let line = |kind: &str, data: Value| line_of(&event(None, kind, data));
    assert_eq!(line("state", json!({"state": "running", "at_s": 0})).unwrap(), "plate    0.0 s  running");
    let cycle = json!({"at_s": 12.34, "progress": 0.5, "cycle": 3, "pulses": 24, "phase": "to\u{1b} A"});
    assert_eq!(line("cycle", cycle).unwrap(), "plate   12.3 s   50 %  cycle 3, 24 pulses  to\\u{1b} A");
    let late = json!({"at_s": 12.34, "progress": 0.5, "cycle": 3, "pulses": 1, "phase": "to A", "behind_s": 8.2});
    let line_of_late = "plate   12.3 s, 8.2 s behind real time   50 %  cycle 3, 1 pulse  to A";
    assert_eq!(line("cycle", late).unwrap(), line_of_late);
    let recording = json!({"at_s": 1, "recording": "stopped", "reason": "disk low"});
    assert_eq!(line("recording", recording).unwrap(), "plate    1.0 s  recording stopped: disk low");
    assert_eq!(line("gap", json!({"from": 5, "to": 9})).unwrap(), "events 5 to 9 cannot be had any more");
    assert_eq!(line("look", json!({})), None);
    assert_eq!(line("snapshot", json!({"job": 1})), None, "what cannot be understood is passed over");
    let warning = event(None, "warning", json!({"at_s": 2, "level": "error", "text": "t"}));
    assert_eq!(note_of(&warning).unwrap(), "plate    2.0 s  error: t");
}
