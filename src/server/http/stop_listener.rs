use std::io::{self, ErrorKind, Read, Write};
use std::net::{TcpListener, TcpStream};
use std::sync::Arc;
use std::thread;
use std::time::Duration;

use axum::body::Body;
use axum::extract::Request;
use axum::http::header::{ALLOW, CONTENT_TYPE};
use axum::http::{HeaderMap, HeaderValue, Method, StatusCode};
use axum::response::IntoResponse;

use super::{AllowedHosts, Caller, Problem, ProblemKind, Scope, Tokens};
use upm_core::time::{Clock, MonotonicClock};

/// The only path of the listener for emergency stops.
pub const STOP_PATH: &str = "/v1/estop";

/// Longest time for a header to arrive: the next client waits as long.
const HEADER_TIME: Duration = Duration::from_millis(250);
/// Longest time for the client to take its answer.
const TAKEN_WITHIN: Duration = Duration::from_millis(250);

/// Largest header, bytes, and most of its lines.
const HEADER_BYTES: usize = 8 << 10;
const HEADER_LINES: usize = 64;

/// Pause after the system could not accept one more connection.
const NO_ROOM_PAUSE: Duration = Duration::from_millis(20);

/// Serves `POST /v1/estop` on `listener` until the process ends: one request a connection, one connection after
/// another, on one thread that shares nothing with the API's server. `stop` stops the plates and returns the answer as
/// JSON.
pub fn serve_stops(
    listener: TcpListener,
    hosts: AllowedHosts,
    tokens: Arc<Tokens>,
    stop: impl Fn(&Caller) -> Vec<u8> + Send + 'static,
) -> io::Result<()> {
    let admit = move |request: &Request| -> Result<String, Problem> {
        hosts.check(request)?;
        if request.uri().path() != STOP_PATH {
            return Err(Problem::new(ProblemKind::NotFound, format!("this port has only POST {STOP_PATH}")));
        }
        if request.method() != Method::POST {
            let problem = Problem::new(ProblemKind::MethodNotAllowed, "method not allowed; see the Allow header");
            return Err(problem.with_header(ALLOW, HeaderValue::from_static("POST")));
        }
        tokens.admit(request.headers(), Scope::Read)
    };
    let take = move |mut client: TcpStream| {
        let remote = client.peer_addr().ok();
        match read_header(&mut client)?.and_then(|request| admit(&request)) {
            Ok(name) => {
                let json = HeaderMap::from_iter([(CONTENT_TYPE, HeaderValue::from_static("application/json"))]);
                answer(client, StatusCode::OK, &json, &stop(&Caller { name, remote }))
            }
            Err(problem) => {
                let body = serde_json::to_vec(&problem.document(None))?;
                let response = problem.into_response();
                answer(client, response.status(), response.headers(), &body)
            }
        }
    };
    let serve = move || {
        for client in listener.incoming() {
            match client.map(&take) {
                Ok(Ok(())) => {}
                // the client sent no request in time, or does not take its answer
                Ok(Err(error)) => tracing::debug!(%error, "emergency stop"),
                Err(error) => {
                    tracing::warn!(%error, "cannot accept a connection");
                    thread::sleep(NO_ROOM_PAUSE);
                }
            }
        }
    };
    thread::Builder::new().name("stop-listener".into()).spawn(serve).map(|_| ())
}

/// Reads a header; a problem for one that is malformed or too large.
fn read_header(client: &mut TcpStream) -> io::Result<Result<Request, Problem>> {
    let (clock, mut header, mut piece) = (MonotonicClock::new(), Vec::new(), [0; 1 << 10]);
    loop {
        let left = HEADER_TIME.checked_sub(clock.elapsed()).filter(|left| !left.is_zero());
        client.set_read_timeout(Some(left.ok_or(ErrorKind::TimedOut)?))?;
        let count = client.read(&mut piece)?;
        if count == 0 {
            return Err(ErrorKind::UnexpectedEof.into());
        }
        header.extend_from_slice(piece.get(..count).unwrap_or_default());
        if header.len() > HEADER_BYTES {
            let detail = format!("a header has at most {HEADER_BYTES} bytes");
            return Ok(Err(Problem::new(ProblemKind::HeaderTooLarge, detail)));
        }
        if let Some(request) = request_in(&header).transpose() {
            return Ok(request);
        }
    }
}

/// The request with this header; `None` while the header is not complete.
fn request_in(header: &[u8]) -> Result<Option<Request>, Problem> {
    let malformed = |detail: String| Problem::new(ProblemKind::Malformed, detail);
    let mut lines = [httparse::EMPTY_HEADER; HEADER_LINES];
    let mut parsed = httparse::Request::new(&mut lines);
    if parsed.parse(header).map_err(|error| malformed(error.to_string()))?.is_partial() {
        return Ok(None);
    }
    let request = Request::builder().method(parsed.method.unwrap_or_default()).uri(parsed.path.unwrap_or_default());
    let request = parsed.headers.iter().fold(request, |request, line| request.header(line.name, line.value));
    request.body(Body::empty()).map(Some).map_err(|error| malformed(error.to_string()))
}

/// Sends an answer and closes the connection.
fn answer(mut client: TcpStream, status: StatusCode, headers: &HeaderMap, body: &[u8]) -> io::Result<()> {
    let mut text = format!("HTTP/1.1 {status}\r\nconnection: close\r\ncontent-length: {}\r\n", body.len()).into_bytes();
    for (name, value) in headers {
        text.extend_from_slice(&[name.as_str().as_bytes(), b": ", value.as_bytes(), b"\r\n"].concat());
    }
    text.extend_from_slice(&[b"\r\n", body].concat());
    client.set_write_timeout(Some(TAKEN_WITHIN))?;
    client.write_all(&text)
}

#[cfg(test)]
mod tests {
    use std::net::SocketAddr;

    use super::*;

    const TOKEN: &str = "stop-stop-stop-stop-stop-stop-stop";

    fn said(address: SocketAddr, bytes: &str) -> String {
        let mut client = TcpStream::connect(address).unwrap();
        client.write_all(bytes.as_bytes()).unwrap();
        let mut text = String::new();
        let _ = client.read_to_string(&mut text);
        text
    }

    #[test]
    fn stop_is_answered_and_everything_else_refused_by_a_problem() {
        let listener = TcpListener::bind("127.0.0.1:0").unwrap();
        let address = listener.local_addr().unwrap();
        let mut tokens = Tokens::default();
        tokens.add("door", TOKEN, Scope::Read).unwrap();
        let stop = |caller: &Caller| format!("stopped by {}", caller.name).into_bytes();
        serve_stops(listener, AllowedHosts::new(address, &[]), Arc::new(tokens), stop).unwrap();
        let request = |line: &str, more: &str| {
            said(address, &format!("{line} HTTP/1.1\r\nhost: localhost\r\nauthorization: Bearer {TOKEN}\r\n{more}\r\n"))
        };
        let silent = TcpStream::connect(address).unwrap();
        let stopped = request("POST /v1/estop", "");
        assert!(
            stopped.starts_with("HTTP/1.1 200 OK\r\n") && stopped.ends_with("\r\n\r\nstopped by door"),
            "{stopped}"
        );
        drop(silent);
        let without_token = said(address, "POST /v1/estop HTTP/1.1\r\nhost: localhost\r\n\r\n");
        assert!(without_token.contains("www-authenticate: Bearer"), "{without_token}");
        let large = format!("x: {}\r\n", "y".repeat(HEADER_BYTES));
        for (answer, status) in [
            (without_token, 401),
            (said(address, "POST /v1/estop HTTP/1.1\r\nhost: evil.example\r\n\r\n"), 403),
            (request("POST /v1/estop", "origin: http://evil.example\r\n"), 403),
            (request("POST /v1/jobs", ""), 404),
            (request("GET /v1/estop", ""), 405),
            (request("POST /v1/estop", &large), 431),
            (said(address, "nonsense\r\n\r\n"), 400),
            (said(address, "POST /v1/estop HTTP/1.1\r\n\r\n"), 400),
        ] {
            assert!(answer.starts_with(&format!("HTTP/1.1 {status} ")), "{status}: {answer}");
            assert!(answer.contains("content-type: application/problem+json\r\n"), "{answer}");
        }
        assert_eq!(said(address, "POST /v1/estop HTTP/1.1\r\nhost: local"), "", "cut off");
    }
}
