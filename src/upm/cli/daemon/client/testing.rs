//! HTTP server with canned responses for tests of client commands.

use std::io::{BufRead, BufReader, Read, Write};
use std::net::{TcpListener, TcpStream};
use std::sync::{Arc, Mutex};
use std::thread;

use upm_server::api::{EStopped, Job, JobId};
use upm_server::states::JobState;

/// Response to one connection.
#[derive(Clone, Debug)]
pub enum Canned {
    /// These bytes, then the end of the connection.
    Bytes(String),
    /// No response: the connection is closed after the request.
    Hangup,
}

/// A request that the server received.
#[derive(Clone, Debug)]
pub struct ReceivedRequest {
    /// Method, path and version.
    pub line: String,
    /// Header lines.
    pub head: Vec<String>,
    /// Text after the head, of the length that `Content-Length` gives.
    pub body: String,
}

impl ReceivedRequest {
    /// Value of a header.
    pub fn header(&self, name: &str) -> Option<&str> {
        let value = |line: &&String| line.split_once(':').is_some_and(|(found, _)| found.eq_ignore_ascii_case(name));
        self.head.iter().find(value).and_then(|line| line.split_once(':')).map(|(_, value)| value.trim())
    }
}

/// Server that answers each connection with the result of `answer` for its request.
pub struct FakeServer {
    /// Address of the server.
    pub url: String,
    asked: Arc<Mutex<Vec<ReceivedRequest>>>,
}

impl FakeServer {
    /// Server that gives these answers in turn, one per connection, and repeats the last one.
    pub fn saying(answers: Vec<Canned>) -> Self {
        let count = Mutex::new(0);
        Self::start(move |_| {
            let mut count = count.lock().unwrap();
            let answer = answers[(*count).min(answers.len() - 1)].clone();
            *count += 1;
            answer
        })
    }

    /// Server that calls `answer` for every request.
    pub fn start(answer: impl Fn(&ReceivedRequest) -> Canned + Send + Sync + 'static) -> Self {
        let listener = TcpListener::bind("127.0.0.1:0").unwrap();
        let url = format!("http://{}", listener.local_addr().unwrap());
        let asked = Arc::new(Mutex::new(Vec::new()));
        let (kept, answer) = (asked.clone(), Arc::new(answer));
        thread::spawn(move || {
            for stream in listener.incoming().map_while(Result::ok) {
                let (kept, answer) = (kept.clone(), answer.clone());
                thread::spawn(move || attend(stream, &kept, &*answer));
            }
        });
        Self { url, asked }
    }

    /// All requests received so far.
    pub fn asked(&self) -> Vec<ReceivedRequest> {
        self.asked.lock().unwrap().clone()
    }
}

fn attend(mut stream: TcpStream, asked: &Mutex<Vec<ReceivedRequest>>, answer: &dyn Fn(&ReceivedRequest) -> Canned) {
    let request = read(&stream);
    asked.lock().unwrap().push(request.clone());
    if let Canned::Bytes(bytes) = answer(&request) {
        stream.write_all(bytes.as_bytes()).ok();
    }
}

fn read(stream: &TcpStream) -> ReceivedRequest {
    let mut reader = BufReader::new(stream);
    let mut lines = Vec::new();
    loop {
        let mut line = String::new();
        reader.read_line(&mut line).unwrap();
        if line.trim_end().is_empty() {
            break;
        }
        lines.push(line.trim_end().to_owned());
    }
    let mut asked = ReceivedRequest { line: lines.remove(0), head: lines, body: String::new() };
    let length = asked.header("content-length").map_or(0, |length| length.parse().unwrap());
    reader.take(length).read_to_string(&mut asked.body).unwrap();
    asked
}

/// Complete HTTP response with these parts.
pub fn answer(status: u16, media: &str, headers: &str, body: &str) -> Canned {
    let length = body.len();
    Canned::Bytes(format!(
        "HTTP/1.1 {status} Said\r\nContent-Type: {media}\r\nContent-Length: {length}\r\n{headers}Connection: close\r\n\r\n{body}"
    ))
}

/// Complete HTTP response with a JSON body.
pub fn json(status: u16, value: &impl serde::Serialize) -> Canned {
    answer(status, "application/json", "", &serde_json::to_string(value).unwrap())
}

/// Problem document as an HTTP response.
pub fn problem(status: u16, detail: &str, headers: &str, faults: &serde_json::Value) -> Canned {
    let document = serde_json::json!({
        "title": "Title", "status": status, "detail": detail, "faults": faults,
    });
    answer(status, "application/problem+json", headers, &document.to_string())
}

/// Event stream of these bytes, one chunk per piece; terminated if `ends`, else cut off.
pub fn events(pieces: &[&str], ends: bool) -> Canned {
    let head = "HTTP/1.1 200 OK\r\nContent-Type: text/event-stream\r\nTransfer-Encoding: chunked\r\n\r\n";
    let chunks: String = pieces.iter().map(|piece| format!("{:x}\r\n{piece}\r\n", piece.len())).collect();
    Canned::Bytes(format!("{head}{chunks}{}", if ends { "0\r\n\r\n" } else { "" }))
}

/// Id of the test job.
pub const JOB: &str = "019a0000000070008000000000000001";

/// Test job in this state.
pub fn job(state: JobState) -> Job {
    let (name, plate) = ("rest".to_owned(), "left".to_owned());
    let submitted_at = "2026-11-22T05:14:00.123456Z".to_owned();
    Job { id: JobId::parse(JOB).unwrap(), name, state, plate, submitted_at, progress: 0.25, seed: 1, ..Job::default() }
}

/// Response to an emergency stop of this plate.
pub fn stopped(plate: &str) -> EStopped {
    let (plate, silent, persisted) = (plate.to_owned(), true, true);
    EStopped { plate, silent, persisted, requested_at_s: Some(1.0), silent_at_s: Some(1.0), wall_s: Some(0.001) }
}
