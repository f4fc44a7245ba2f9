use std::net::{SocketAddr, TcpListener};
use std::sync::Arc;
use std::time::Duration;
use std::{io, thread};

use axum::extract::ConnectInfo;
use axum::http::HeaderMap;
use axum::http::header::AUTHORIZATION;
use axum::routing::post;
use axum::{Json, Router};
use serde::Serialize;
use tokio::sync::oneshot;
use tokio_util::sync::CancellationToken;
use tower_http::cors::{AllowOrigin, CorsLayer};

use super::layers::with_layers;
use super::listen::serve;
use super::origin_check::AllowedHosts;
use super::problem::Problem;
use super::tokens::{Caller, Scope, Tokens};
use upm_core::background::{OverflowPolicy, Queue};

/// The only path of the listener for emergency stops.
pub const STOP_PATH: &str = "/v1/estop";

/// Stops that are confirmed at once.
const CONFIRMED_AT_ONCE: usize = 2;

/// Serves `POST /v1/estop` on `listener` until the process ends, on threads that share nothing with the API's server
/// and have the usual priority. `stop` stops the plates and never waits, `confirm` returns the answer. A page that
/// `hosts` admits may read it.
pub fn serve_stops<T: Serialize + Send + 'static>(
    listener: TcpListener,
    hosts: AllowedHosts,
    tokens: Arc<Tokens>,
    stop: impl Fn() + Send + Sync + 'static,
    confirm: impl Fn(&Caller) -> T + Send + Sync + 'static,
) -> io::Result<()> {
    let both = Arc::new((stop, confirm, Confirmations::start()?));
    let handler = async move |ConnectInfo(remote): ConnectInfo<SocketAddr>, headers: HeaderMap| {
        let name = tokens.admit(&headers, Scope::Read)?;
        both.0();
        let (doing, caller) = (Arc::clone(&both), Caller { name, remote: Some(remote) });
        let confirmed = both.2.of(move || doing.1(&caller)).await;
        let unconfirmed = || Problem::busy("the plates are stopped; what became of their motors is not known", 1);
        Ok::<_, Problem>(Json(confirmed.ok_or_else(unconfirmed)?))
    };
    let cors = CorsLayer::new().allow_origin(AllowOrigin::mirror_request()).allow_headers([AUTHORIZATION]);
    let app = with_layers(Router::new().route(STOP_PATH, post(handler)).layer(cors), hosts);
    let serve = move || serve(listener, app, &CancellationToken::new(), Duration::ZERO, || ());
    thread::Builder::new().name("stop-listener".into()).spawn(serve).map(|_| ())
}

/// Emergency stops that may wait for their confirmation.
const WAITING: usize = 512;

/// Threads of the usual priority that confirm emergency stops: they stand ready, so that a stop needs no new thread,
/// and all others may wait for the disk.
#[derive(Debug)]
pub struct Confirmations(Queue<Box<dyn FnOnce() + Send>>);

impl Confirmations {
    /// Starts the threads, which end when this value is dropped.
    pub fn start() -> io::Result<Self> {
        let (queue, waiting) = Queue::<Box<dyn FnOnce() + Send>>::bounded(WAITING, OverflowPolicy::GiveUp);
        for _ in 0..CONFIRMED_AT_ONCE {
            let waiting = waiting.clone();
            let confirm = move || waiting.iter().for_each(|confirmation| confirmation());
            thread::Builder::new().name("stops".into()).spawn(confirm)?;
        }
        Ok(Self(queue))
    }

    /// The result of `confirm` on one of the threads; `None` when too many others wait.
    pub async fn of<T: Send + 'static>(&self, confirm: impl FnOnce() -> T + Send + 'static) -> Option<T> {
        let (reply, confirmed) = oneshot::channel();
        self.0.send(Box::new(move || drop(reply.send(confirm())))).ok()?;
        confirmed.await.ok()
    }
}

#[cfg(test)]
mod tests {
    use std::io::{Read, Write};
    use std::net::TcpStream;

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
        let stop = |caller: &Caller| format!("stopped by {}", caller.name);
        let hosts = AllowedHosts::new(address, &[]).with_page("127.0.0.1:8750".parse().unwrap());
        serve_stops(listener, hosts, Arc::new(tokens), || (), stop).unwrap();
        let request = |line: &str, more: &str| {
            let token = format!("authorization: Bearer {TOKEN}");
            said(address, &format!("{line} HTTP/1.1\r\nhost: localhost\r\nconnection: close\r\n{token}\r\n{more}\r\n"))
        };
        let silent = TcpStream::connect(address).unwrap();
        let stopped = request("POST /v1/estop", "");
        assert!(
            stopped.starts_with("HTTP/1.1 200 OK\r\n") && stopped.ends_with("\r\n\r\n\"stopped by door\""),
            "{stopped}"
        );
        drop(silent);
        let page = "origin: http://localhost:8750\r\nsec-fetch-site: same-site\r\n";
        let preflight = format!("{page}access-control-request-method: POST\r\n");
        let (asked, of_page) = (request("OPTIONS /v1/estop", &preflight), request("POST /v1/estop", page));
        assert!(asked.starts_with("HTTP/1.1 200 OK\r\n") && asked.ends_with("\r\n\r\n"), "{asked}");
        assert!(asked.contains("access-control-allow-headers: authorization\r\n"), "{asked}");
        assert!(of_page.contains("access-control-allow-origin: http://localhost:8750\r\n"), "{of_page}");
        assert!(of_page.ends_with("\r\n\r\n\"stopped by door\""), "{of_page}");
        let without_token = said(address, "POST /v1/estop HTTP/1.1\r\nhost: localhost\r\nconnection: close\r\n\r\n");
        assert!(without_token.contains("www-authenticate: Bearer"), "{without_token}");
        for (answer, status) in [
            (without_token, 401),
            (request("POST /v1/estop", "host: evil.example\r\n"), 400),
            (request("POST /v1/estop", "origin: http://evil.example:8750\r\n"), 403),
            (request("POST /v1/estop", "origin: http://localhost:3000\r\n"), 403),
            (request("POST /v1/jobs", ""), 404),
            (request("GET /v1/estop", ""), 405),
        ] {
            assert!(answer.starts_with(&format!("HTTP/1.1 {status} ")), "{status}: {answer}");
            assert!(answer.contains("content-type: application/problem+json\r\n"), "{answer}");
        }
    }
}
