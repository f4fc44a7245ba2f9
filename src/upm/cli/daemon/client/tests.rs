use std::net::TcpListener;

use serde_json::json;

use super::testing::{Canned, FakeServer, JOB, answer, job, json as said, problem, stopped};
use super::{Client, ClientRefusal, bearer_of, job_path, plate_path};
use crate::cli::daemon::stop::stop_all;
use crate::cli::daemon::submit::queue;
use upm_server::api::{Job, JobId, JobsPage};
use upm_server::states::JobState;

fn refused(server: &FakeServer) -> ClientRefusal {
    Client::at(&server.url).unwrap().get::<Job>(&job_path(JOB)).unwrap_err()
}

/// URL of a port on which no server listens.
fn nobody() -> String {
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    format!("http://{}", listener.local_addr().unwrap())
}

#[test]
fn daemon_below_a_path_is_asked_there() {
    let server = FakeServer::saying(vec![said(200, &job(JobState::Queued))]);
    let client = Client::at(&format!("{}/lab/upm/", server.url)).unwrap();
    assert_eq!(client.get::<Job>(&job_path(JOB)).unwrap(), job(JobState::Queued));
    assert_eq!(server.asked()[0].line, format!("GET /lab/upm/v1/jobs/{JOB} HTTP/1.1"));
}

#[test]
fn a_job_is_asked_for_and_read() {
    let server = FakeServer::saying(vec![said(200, &job(JobState::Queued))]);
    let client = Client { bearer: Some("Bearer secret".into()), ..Client::at(&format!("{}/", server.url)).unwrap() };
    assert_eq!(client.get::<Job>(&job_path(JOB)).unwrap(), job(JobState::Queued));
    let asked = &server.asked()[0];
    assert_eq!(asked.line, format!("GET /v1/jobs/{JOB} HTTP/1.1"));
    assert_eq!(asked.header("host"), Some(server.url.trim_start_matches("http://")));
    assert_eq!(asked.header("authorization"), Some("Bearer secret"));
}

#[test]
fn missing_daemon_and_foreign_servers_are_distinguished() {
    let url = nobody();
    let refusal = Client::at(&url).unwrap().get::<Job>("/v1/jobs").unwrap_err();
    assert!(matches!(refusal, ClientRefusal::Unreached(_)), "{refusal:?}");
    let line = refusal.line();
    assert!(line.starts_with(&format!("no daemon answers at {url}: ")) && line.contains("upm serve"), "{line}");
    let page = refused(&FakeServer::saying(vec![answer(200, "text/html", "", "<html>")]));
    assert!(page.line().contains("cannot be understood"), "{page:?}");
    let gateway = refused(&FakeServer::saying(vec![answer(502, "text/html", "", "<html>")]));
    assert!(gateway.line().contains("status 502"), "{gateway:?}");
    let elsewhere =
        refused(&FakeServer::saying(vec![answer(302, "text/html", "Location: http://127.0.0.1:1/\r\n", "")]));
    assert!(elsewhere.line().contains("status 302"), "{elsewhere:?}");
    assert!(matches!(refused(&FakeServer::saying(vec![Canned::Hangup])), ClientRefusal::Lost(_)));
}

#[test]
fn only_plain_addresses_ids_names_and_tokens_are_taken() {
    for url in
        ["", "127.0.0.1:8750", "https://127.0.0.1", "ftp://x", "http://", "http://a b", "http://u@h", "http://h/?q"]
    {
        assert_eq!(Client::at(url).err().map(|failure| failure.status), Some(2), "{url:?}");
    }
    for url in ["http://127.0.0.1:8750", "http://[::1]:8750/", "http://rig.lan/upm/"] {
        assert!(!Client::at(url).unwrap().base.ends_with('/'), "{url:?}");
    }
    for name in ["", "..", "a/b", "a b", "a?b"] {
        assert_eq!(plate_path(name).unwrap_err().status, 2, "{name:?}");
    }
    let folder = tempfile::TempDir::new().unwrap();
    let file = folder.path().join("token");
    for (text, bearer) in [("abc\n", Some("Bearer abc")), ("", None), ("a b", None), ("a\nb", None)] {
        std::fs::write(&file, text).unwrap();
        assert_eq!(bearer_of(&file).ok().as_deref(), bearer, "{text:?}");
    }
    assert!(bearer_of(folder.path()).is_err());
}

#[test]
fn a_lost_answer_is_asked_for_once_more_under_the_same_key() {
    let half = "HTTP/1.1 201 Created\r\nContent-Type: application/json\r\nContent-Length: 500\r\n\r\n{\"id\":";
    for lost in [Canned::Hangup, Canned::Bytes(half.to_owned())] {
        let server = FakeServer::saying(vec![lost.clone(), said(201, &job(JobState::Queued))]);
        let client = Client::at(&server.url).unwrap();
        assert_eq!(queue(&client, "{\"name\": 1}", None, "k-1").unwrap().id.to_string(), JOB);
        let asked = server.asked();
        assert_eq!(asked.len(), 2);
        for request in &asked {
            assert_eq!(request.line, "POST /v1/jobs HTTP/1.1");
            assert_eq!(request.header("idempotency-key"), Some("k-1"));
            assert_eq!(request.header("content-type"), Some("application/json"));
            assert_eq!(request.body, "{\"name\": 1}");
        }
        let server = FakeServer::saying(vec![lost]);
        assert!(matches!(queue(&Client::at(&server.url).unwrap(), "{}", None, "k"), Err(ClientRefusal::Lost(_))));
        assert_eq!(server.asked().len(), 2, "once more and no oftener");
    }
    let cases = [(409, 1, "a no is an answer"), (429, 1, "so is not now"), (503, 2, "it may be queued all the same")];
    for (status, requests, why) in cases {
        let server = FakeServer::saying(vec![problem(status, "no", "", &json!([]))]);
        assert!(queue(&Client::at(&server.url).unwrap(), "{}", None, "k").is_err());
        assert_eq!(server.asked().len(), requests, "{why}");
    }
}

#[test]
fn jobs_are_listed_page_by_page() {
    let ids: Vec<String> = (0..450).map(|i| format!("{:032x}", 1000 - i)).collect();
    let all = ids.clone();
    let server = FakeServer::start(move |asked| {
        let after = |name: &str| asked.line.split_once(name).map(|(_, rest)| rest.split(['&', ' ']).next().unwrap());
        let limit: usize = after("limit=").unwrap().parse().unwrap();
        let from = after("cursor=").map_or(0, |cursor| all.iter().position(|id| id == cursor).unwrap() + 1);
        let jobs: Vec<Job> = all[from..]
            .iter()
            .take(limit)
            .map(|id| Job { id: JobId::parse(id).unwrap(), ..job(JobState::Failed) })
            .collect();
        let next = (from + limit < all.len()).then(|| jobs.last().unwrap().id.to_string());
        said(200, &JobsPage { jobs, next })
    });
    let client = Client::at(&server.url).unwrap();
    for (most, expected, more) in
        [(1, 1, true), (200, 200, true), (201, 201, true), (450, 450, false), (u32::MAX, 450, false)]
    {
        let page = client.jobs(Some("failed"), most).unwrap();
        assert_eq!(page.jobs.iter().map(|job| job.id.to_string()).collect::<Vec<_>>(), ids[..expected]);
        assert_eq!(page.next.is_some(), more, "{most}");
    }
    assert!(server.asked().iter().all(|asked| asked.line.contains("state=failed")));
}

#[test]
fn a_stop_is_asked_for_three_times_each_on_its_own_connection() {
    let none = json!([]);
    let server = FakeServer::saying(vec![Canned::Hangup, problem(503, "full", "", &none), said(200, &stopped("left"))]);
    let stops = stop_all(&Client::at(&server.url).unwrap(), &["left".to_owned()]);
    assert_eq!((stops[0].attempts, stops[0].answer.clone()), (3, Some(stopped("left"))));
    assert!(server.asked().iter().all(|asked| asked.line == "POST /v1/plates/left/estop HTTP/1.1"));

    let stops = stop_all(&Client::at(&nobody()).unwrap(), &["left".to_owned()]);
    assert!(stops[0].attempts == 3 && stops[0].error.as_deref().unwrap().starts_with("no daemon answers"));

    let server = FakeServer::saying(vec![problem(404, "no such plate", "", &none)]);
    let stops = stop_all(&Client::at(&server.url).unwrap(), &["left".to_owned()]);
    assert_eq!(
        (stops[0].attempts, stops[0].error.as_deref()),
        (1, Some("no such plate")),
        "it will not be there later"
    );
}

#[test]
fn no_plate_waits_for_the_stop_of_another() {
    let server = FakeServer::start(|asked| {
        if asked.line.contains("/slow/") {
            std::thread::sleep(std::time::Duration::from_millis(400));
        }
        said(200, &stopped("x"))
    });
    let names = ["slow", "a/b", "fast"].map(str::to_owned);
    let stops = stop_all(&Client::at(&server.url).unwrap(), &names);
    assert_eq!(stops.iter().map(|stop| stop.answer.is_some()).collect::<Vec<_>>(), [true, false, true]);
    assert_eq!(stops.iter().map(|stop| stop.plate.clone()).collect::<Vec<_>>(), names);
    assert!(stops[0].wall_s >= 0.4 && stops[2].wall_s < 0.3, "{stops:?}");
}
