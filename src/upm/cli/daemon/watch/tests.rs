use serde_json::{Value, json};

use super::follow::{EventReader, ReceivedEvent, StreamFollower, StreamItem};
use super::job_display::line_of;
use crate::cli::daemon::client::testing::{Canned, FakeServer, JOB, events, job, problem};
use crate::cli::daemon::client::{Client, ClientRefusal};
use upm_server::states::JobState;

fn read(text: &str) -> Vec<ReceivedEvent> {
    let mut stream = EventReader::new(text.as_bytes());
    std::iter::from_fn(|| stream.next().unwrap()).collect()
}

fn event(id: Option<u64>, kind: &str, data: Value) -> ReceivedEvent {
    ReceivedEvent { id, kind: kind.to_owned(), data }
}

/// All messages about a job whose stream the server serves.
fn heard(server: &FakeServer, after: Option<u64>) -> Vec<StreamItem> {
    let client = Client::at(&server.url).unwrap();
    let mut follower = StreamFollower::new(client, format!("/v1/jobs/{JOB}/events"), after);
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

fn job_event(state: JobState) -> String {
    format!("event: job\ndata: {}\n\n", json!(job(state)))
}

#[test]
fn events_are_parsed_per_the_sse_standard() {
    assert_eq!(read("retry: 1000\n\nid: 7\nevent: job\ndata: {\"a\":1}\n\n"), [event(Some(7), "job", json!({"a": 1}))]);
    assert_eq!(read("id: 7\r\ndata:[1,\r\ndata: 2]\r\n\r\n"), [event(Some(7), "message", json!([1, 2]))]);
    assert_eq!(read(":\n\n: hb\n\nevent: job\ndata: {}\n\n"), [event(None, "job", json!({}))]);
    assert_eq!(read("id: 8\ndata: 1\n"), [], "an event without its empty line is cut short");
    assert_eq!(read("id: 8\ndata: 1\n\nid: 9\nevent"), [event(Some(8), "message", json!(1))]);
    assert_eq!(read("event: odd\ndata: not json\n\n"), [event(None, "odd", Value::Null)]);
    assert!(EventReader::new(std::io::repeat(b'x')).next().is_err(), "a line without end is not kept");
}

#[test]
fn job_is_followed_over_a_cut_in_the_middle_of_an_event() {
    let (running, completed) = (job_event(JobState::Running), job_event(JobState::Completed));
    let first = events(&[&running, "id: 10\ndata: {}\n\nid: 20\nda"], false);
    let none = json!([]);
    let second = events(&[&running, "id: 20\ndata: {}\n\n", "id: 30\ndata: {}\n\n"], true);
    let third = events(&["id: 40\ndata: {}\n\n", &completed], true);
    let server = FakeServer::saying(vec![first, Canned::Hangup, problem(503, "starting", "", &none), second, third]);
    let wanted = ["job", "message 10", "lost", "job", "message 20", "message 30", "lost", "message 40", "job"];
    assert_eq!(kinds(&heard(&server, None)), wanted);
    let resumed: Vec<_> = server.asked().iter().map(|asked| asked.header("last-event-id").map(str::to_owned)).collect();
    assert_eq!(resumed, [None, Some("10"), Some("10"), Some("10"), Some("30")].map(|id| id.map(str::to_owned)));
}

#[test]
fn watching_ends_once_the_job_has_ended() {
    let server = FakeServer::saying(vec![events(&[&job_event(JobState::Interrupted)], true)]);
    assert_eq!(kinds(&heard(&server, Some(0))), ["job"]);
    assert_eq!(server.asked().len(), 1);
    assert_eq!(server.asked()[0].header("last-event-id"), Some("0"));
}

#[test]
fn watching_ends_when_the_daemon_refuses_or_stays_unreachable() {
    let none = json!([]);
    let server = FakeServer::saying(vec![problem(503, "too many event streams", "Retry-After: 10\r\n", &none)]);
    let all = heard(&server, None);
    let [StreamItem::Refused(refusal)] = &all[..] else { panic!("{all:?}") };
    assert_eq!(refusal.line(), "too many event streams; try again in 10 s");
    assert_eq!(server.asked().len(), 1, "nothing was followed yet that could be lost");

    let running = events(&[&job_event(JobState::Running)], false);
    let server = FakeServer::saying(vec![running.clone(), problem(404, "no such job", "", &none)]);
    assert_eq!(kinds(&heard(&server, None)), ["job", "lost", "refused"]);

    let server = FakeServer::saying(vec![running, Canned::Hangup]);
    let all = heard(&server, None);
    assert_eq!(kinds(&all), ["job", "lost", "refused"]);
    assert!(matches!(all.last(), Some(StreamItem::Refused(ClientRefusal::Lost(_)))));
    assert!((10..50).contains(&server.asked().len()), "{}", server.asked().len());
}

#[test]
fn each_event_is_shown_in_one_line() {
    let line = |data: Value| line_of(&event(None, "message", data));
    let cycle = |pulses: &[u8], phase: &str| {
        json!({"type": "cycle", "cycle": 3, "ended_at_s": 12.34, "wanted": {"progress": 0.5, "phase": phase},
            "plan": {"pulses": pulses}})
    };
    let shown = line(cycle(&[0; 24], "to\u{1b} A")).unwrap();
    assert_eq!(shown, "plate   12.3 s   50 %  cycle 3, 24 pulses  to\\u{1b} A");
    assert_eq!(line(cycle(&[0], "to A")).unwrap(), "plate   12.3 s   50 %  cycle 3, 1 pulse  to A");
    assert_eq!(line(json!({"type": "localised"})), None);
    let note = |level: &str| json!({"type": "event", "at_s": 2, "level": level, "text": "t"});
    assert_eq!(line(note("error")).unwrap(), "plate    2.0 s  error: t");
    assert_eq!(line(note("info")), None);
    assert_eq!(line(note("warning")).unwrap(), "plate    2.0 s  warning: t");
    let running = event(None, "job", json!(job(JobState::Running)));
    assert!(line_of(&running).unwrap().ends_with(": running"), "{:?}", line_of(&running));
    assert_eq!(line_of(&event(None, "job", json!({"job": 1}))), None, "what cannot be understood is passed over");
}
