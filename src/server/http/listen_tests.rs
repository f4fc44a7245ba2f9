use std::convert::Infallible;
use std::io::{Read, Write};
use std::net::{SocketAddr, TcpListener, TcpStream};
use std::thread::JoinHandle;
use std::time::Duration;

use axum::Router;
use axum::body::Body;
use axum::routing::{get, post};
use bytes::Bytes;
use futures_util::stream;
use tokio_util::sync::CancellationToken;

use super::*;
use upm_core::document::MOST_BYTES;
use upm_core::time::{Clock, MonotonicClock};

struct TestServer {
    address: SocketAddr,
    stop: CancellationToken,
    thread: Option<JoinHandle<usize>>,
}

impl TestServer {
    fn start() -> Self {
        let listener = TcpListener::bind("127.0.0.1:0").unwrap();
        let address = listener.local_addr().unwrap();
        let app = with_layers(routes(), AllowedHosts::new(address, &[]));
        let stop = CancellationToken::new();
        let stopped = stop.clone();
        let thread =
            std::thread::spawn(move || serve(listener, app, &stopped, Duration::from_millis(300), || ()).unwrap());
        Self { address, stop, thread: Some(thread) }
    }

    fn connect(&self) -> TcpStream {
        let stream = TcpStream::connect(self.address).unwrap();
        stream.set_read_timeout(Some(Duration::from_secs(10))).unwrap();
        stream
    }

    /// Sends `bytes` and reads until the server closes; a reset counts as the end.
    fn exchange(&self, bytes: &[u8]) -> String {
        let mut stream = self.connect();
        let _ = stream.write_all(bytes);
        all_of(&mut stream)
    }

    fn get(&self, path: &str) -> String {
        self.exchange(format!("GET {path} HTTP/1.1\r\nhost: localhost\r\nconnection: close\r\n\r\n").as_bytes())
    }

    fn stop(&mut self) -> usize {
        self.stop.cancel();
        self.thread.take().unwrap().join().unwrap()
    }
}

impl Drop for TestServer {
    fn drop(&mut self) {
        self.stop.cancel();
        self.thread.take().map(JoinHandle::join);
    }
}

fn all_of(stream: &mut TcpStream) -> String {
    let mut bytes = Vec::new();
    let _ = stream.read_to_end(&mut bytes);
    String::from_utf8_lossy(&bytes).into_owned()
}

fn routes() -> Router {
    let endless = || async { Body::from_stream(stream::repeat(Ok::<_, Infallible>(Bytes::from(vec![b'x'; 4096])))) };
    let read = async |body: Bytes| body.len().to_string();
    Router::new()
        .route("/ok", get(|| async { "ok" }))
        .route("/panic", get(async || -> &'static str { panic!("as asked") }))
        .route("/endless", get(endless))
        .route("/slow", get(std::future::pending::<&'static str>))
        .route("/read", post(read))
}

fn post_of(length: usize, body: &[u8]) -> Vec<u8> {
    let head =
        format!("POST /read HTTP/1.1\r\nhost: localhost\r\nconnection: close\r\ncontent-length: {length}\r\n\r\n");
    [head.as_bytes(), body].concat()
}

fn assert_problem(answer: &str, status: u16) {
    assert!(answer.starts_with(&format!("HTTP/1.1 {status} ")), "{status}: {answer}");
    assert!(answer.contains("content-type: application/problem+json"), "{answer}");
    assert!(answer.contains(&format!("\"status\":{status},")), "{answer}");
    assert!(answer.contains("\"instance\":\"urn:upm:request:"), "{answer}");
}

#[test]
fn requests_are_answered() {
    let mut server = TestServer::start();
    assert!(server.get("/ok").ends_with("\r\n\r\nok"));
    assert!(server.exchange(&post_of(3, b"abc")).ends_with("\r\n\r\n3"));
    assert_eq!(server.stop(), 0);
}

#[test]
fn handler_that_panics_is_a_problem_of_one_request() {
    let server = TestServer::start();
    assert_problem(&server.get("/panic"), 500);
    assert!(server.get("/ok").ends_with("ok"));
}

#[test]
fn too_large_request_gets_a_problem_that_the_client_can_read() {
    let server = TestServer::start();
    let most = usize::try_from(MOST_BYTES).unwrap();
    assert!(server.exchange(&post_of(most, &vec![b' '; most])).ends_with(&format!("\r\n\r\n{most}")));
    assert_problem(&server.exchange(&post_of(most + 1, &vec![b' '; most + 1])), 413);
    assert_problem(&server.exchange(&post_of(1 << 40, b"")), 413);
    let mut chunked = b"POST /read HTTP/1.1\r\nhost: localhost\r\ntransfer-encoding: chunked\r\n\r\n".to_vec();
    (0..40).for_each(|_| chunked.extend([b"8000\r\n", [b' '; 0x8000].as_slice(), b"\r\n"].concat()));
    assert_problem(&server.exchange(&chunked), 413);
    let header = |bytes: usize| format!("GET /ok HTTP/1.1\r\nhost: localhost\r\nx: {}\r\n\r\n", "y".repeat(bytes));
    assert!(server.exchange(header(17 << 10).as_bytes()).starts_with("HTTP/1.1 431 "));
    let lines = format!("GET /ok HTTP/1.1\r\nhost: localhost\r\n{}\r\n", "x: y\r\n".repeat(80));
    assert!(server.exchange(lines.as_bytes()).starts_with("HTTP/1.1 431 "));
}

#[test]
fn malformed_requests_are_refused() {
    let server = TestServer::start();
    for garbage in [b"\x16\x03\x01\x02\x00\x01".as_slice(), b"nonsense\r\n\r\n", b"GET /\xff HTTP/9.9\r\n\r\n"] {
        assert!(server.exchange(garbage).starts_with("HTTP/1.1 400 "), "{garbage:?}");
    }
    assert_problem(&server.exchange(b"GET /ok HTTP/1.1\r\nhost: \xff\xfe\r\nconnection: close\r\n\r\n"), 400);
    assert!(server.exchange(b"GET /ok HTTP/1.0\r\n\r\n").starts_with("HTTP/1.0 400 "));
    assert_problem(&server.exchange(b"GET /ok HTTP/1.1\r\nhost: evil.example\r\nconnection: close\r\n\r\n"), 403);
    let both = b"POST /read HTTP/1.1\r\nhost: localhost\r\ncontent-length: 4\r\ncontent-length: 5\r\n\r\nabcde";
    assert!(server.exchange(both).starts_with("HTTP/1.1 400 "));
    assert!(server.get("/ok").ends_with("ok"));
}

#[test]
fn shutdown_is_bounded_despite_stalled_clients() {
    let mut server = TestServer::start();
    let opened: Vec<TcpStream> = (0..30)
        .map(|i| {
            let mut stream = server.connect();
            let path = ["/endless", "/slow", "/half-sent"][i % 3];
            let end = if path == "/half-sent" { "" } else { "\r\n\r\n" };
            stream.write_all(format!("GET {path} HTTP/1.1\r\nhost: localhost{end}").as_bytes()).unwrap();
            if path == "/endless" {
                stream.read_exact(&mut [0; 16]).unwrap();
            }
            stream
        })
        .collect();
    assert!(server.get("/ok").ends_with("ok"));
    let clock = MonotonicClock::new();
    let served = server.stop();
    assert!(clock.elapsed() < Duration::from_secs(2), "a daemon ends within two seconds: {:?}", clock.elapsed());
    assert!((10..=30).contains(&served), "{served}");
    assert!(TcpStream::connect(server.address).is_err());
    drop(opened);
}
