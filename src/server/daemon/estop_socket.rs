//! Emergency stops past HTTP: a Unix socket in the data folder that only the daemon's user may write to.
//!
//! A client sends one line of JSON, [`LocalStopRequest`]; an empty line stops every plate. It is answered with one line,
//! [`LocalStopAnswer`]. `echo | socat - UNIX-CONNECT:DATA/estop.sock` is enough.

use std::fs::{self, Permissions};
use std::io::{self, ErrorKind, Read, Write};
use std::os::unix::fs::PermissionsExt;
use std::os::unix::net::{UnixListener, UnixStream};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::{self, ScopedJoinHandle};
use std::time::Duration;

use serde::{Deserialize, Serialize};

use super::state::DaemonState;
use super::stops;
use crate::service::{Caller, EStopped};
use upm_core::time::{Clock, MonotonicClock};

/// Name of the socket in the data folder.
pub const ESTOP_SOCKET: &str = "estop.sock";

/// Threads that take stops: a client that says nothing keeps one of them for [`ASKED_WITHIN`].
const THREADS: usize = 4;

/// Longest request and longest answer, bytes.
const MOST_REQUEST: usize = 4 << 10;
const MOST_ANSWER: usize = 64 << 10;

/// Most plates of a request.
const MOST_PLATES: usize = 64;

/// Time for a request to come in whole, for its answer to be taken, and for the answer to come.
const ASKED_WITHIN: Duration = Duration::from_millis(500);
const TAKEN_WITHIN: Duration = Duration::from_millis(500);
const ANSWERED_WITHIN: Duration = Duration::from_millis(1500);

/// Rest after the machine had no room for one more connection.
const NO_ROOM_PAUSE: Duration = Duration::from_millis(20);

/// The socket, as the audit log names it.
const BY_SOCKET: &str = "estop.sock";

/// What the socket is asked.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct LocalStopRequest {
    /// Plates to stop; none for all.
    pub plates: Vec<String>,
    /// Only the daemon that listens on this port is meant.
    pub port: Option<u16>,
}

/// What it answers.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct LocalStopAnswer {
    /// How the stop of each plate went.
    pub stops: Vec<LocalStop>,
    /// Why nothing was stopped.
    pub error: Option<String>,
}

/// How the stop of one plate went: the answer, or why there is none.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct LocalStop {
    /// The plate.
    pub plate: String,
    /// As HTTP answers it.
    pub answer: Option<EStopped>,
    /// Why it was not stopped.
    pub error: Option<String>,
}

/// Stops plates from wherever in the process that is asked for. Copies stop the same.
#[derive(Clone, Debug)]
pub struct EmergencyStops(pub(super) Arc<DaemonState>);

impl EmergencyStops {
    /// Stops every plate. `by` is who asks, for the audit log. All have been told before the first is waited for.
    pub fn stop_all(&self, by: &str) -> Vec<LocalStop> {
        self.stop(&self.0.spec.plate_names(), by)
    }

    /// Stops these plates.
    pub(super) fn stop(&self, names: &[String], by: &str) -> Vec<LocalStop> {
        for plate in names.iter().filter_map(|name| self.0.plates.get(name)) {
            plate.estop();
        }
        // beside each other: a frozen disk keeps each of them for most of a second
        let see = |name: &str| self.see_through(name, by);
        thread::scope(|scope| {
            let start = |name| thread::Builder::new().spawn_scoped(scope, move || see(name)).ok();
            let seen: Vec<_> = names.iter().map(String::as_str).map(|name| (name, start(name))).collect();
            let wait = |(name, seen): (_, Option<ScopedJoinHandle<'_, LocalStop>>)| {
                seen.and_then(|thread| thread.join().ok()).unwrap_or_else(|| see(name))
            };
            seen.into_iter().map(wait).collect()
        })
    }

    fn see_through(&self, name: &str, by: &str) -> LocalStop {
        let caller = Caller { name: by.to_owned(), remote: None };
        let (answer, error) = match stops::see_through(&self.0, name, &caller) {
            Ok(answer) => (Some(answer), None),
            Err(_) => (None, Some(format!("expected one of {}", self.0.spec.plate_names().join(", ")))),
        };
        LocalStop { plate: name.to_owned(), answer, error }
    }
}

/// The socket. It is removed when this is dropped.
#[derive(Debug)]
pub(super) struct EStopSocket {
    path: PathBuf,
    ending: Arc<AtomicBool>,
}

impl EStopSocket {
    /// Listens in `data`, in place of a socket that an earlier daemon left; `port` is the one of HTTP. The folder's lock
    /// must be held.
    pub fn open(data: &Path, port: u16, stop: &EmergencyStops) -> io::Result<Self> {
        let path = data.join(ESTOP_SOCKET);
        match fs::remove_file(&path) {
            Err(error) if error.kind() != ErrorKind::NotFound => return Err(error),
            _ => {}
        }
        let listener = UnixListener::bind(&path)?;
        fs::set_permissions(&path, Permissions::from_mode(0o600))?;
        let socket = Self { path, ending: Arc::default() };
        for _ in 0..THREADS {
            let (listener, stop, ending) = (listener.try_clone()?, stop.clone(), Arc::clone(&socket.ending));
            thread::Builder::new().name("estop".into()).spawn(move || take_stops(&listener, port, &stop, &ending))?;
        }
        Ok(socket)
    }
}

impl Drop for EStopSocket {
    fn drop(&mut self) {
        self.ending.store(true, Ordering::SeqCst);
        // wakes the threads, which then see it; not joined: one may be waiting for a client
        for _ in 0..THREADS {
            UnixStream::connect(&self.path).ok();
        }
        fs::remove_file(&self.path).ok();
    }
}

fn take_stops(listener: &UnixListener, port: u16, stop: &EmergencyStops, ending: &AtomicBool) {
    for client in listener.incoming() {
        if ending.load(Ordering::SeqCst) {
            return;
        }
        match client.and_then(|client| take_stop(&client, port, stop)) {
            Ok(()) => {}
            Err(error) => {
                tracing::warn!("{ESTOP_SOCKET}: {error}");
                thread::sleep(NO_ROOM_PAUSE);
            }
        }
    }
}

fn take_stop(client: &UnixStream, port: u16, stop: &EmergencyStops) -> io::Result<()> {
    let Some(line) = line_of(client, MOST_REQUEST, ASKED_WITHIN)? else { return Ok(()) };
    let answer = match request_in(&line, port) {
        Ok(request) if request.plates.is_empty() => LocalStopAnswer { stops: stop.stop_all(BY_SOCKET), error: None },
        Ok(request) => LocalStopAnswer { stops: stop.stop(&request.plates, BY_SOCKET), error: None },
        Err(error) => LocalStopAnswer { stops: Vec::new(), error: Some(error) },
    };
    client.set_write_timeout(Some(TAKEN_WITHIN))?;
    send(client, &answer)
}

fn request_in(line: &[u8], port: u16) -> Result<LocalStopRequest, String> {
    if line.trim_ascii().is_empty() {
        return Ok(LocalStopRequest::default());
    }
    let request: LocalStopRequest = serde_json::from_slice(line)
        .map_err(|error| format!(r#"expected an empty line or {{"plates": ["NAME"]}}: {error}"#))?;
    match request.port {
        Some(meant) if meant != port => Err(format!("expected the daemon on port {meant}, found the one on {port}")),
        _ if request.plates.len() > MOST_PLATES => {
            Err(format!("expected at most {MOST_PLATES} plates, found {}", request.plates.len()))
        }
        _ => Ok(request),
    }
}

/// Asks the daemon whose data folder is `data` for a stop. An error when there is none, or no whole answer in time.
pub fn stop_locally(data: &Path, request: &LocalStopRequest) -> io::Result<LocalStopAnswer> {
    let daemon = UnixStream::connect(data.join(ESTOP_SOCKET))?;
    daemon.set_write_timeout(Some(TAKEN_WITHIN))?;
    send(&daemon, request)?;
    let line = line_of(&daemon, MOST_ANSWER, ANSWERED_WITHIN)?.ok_or(ErrorKind::UnexpectedEof)?;
    serde_json::from_slice(&line).map_err(io::Error::other)
}

fn send(mut to: &UnixStream, value: &impl Serialize) -> io::Result<()> {
    let mut line = serde_json::to_vec(value)?;
    line.push(b'\n');
    to.write_all(&line)
}

/// A line of at most `most` bytes that comes `within` this time; `None` when the other end closes and says nothing.
fn line_of(mut from: &UnixStream, most: usize, within: Duration) -> io::Result<Option<Vec<u8>>> {
    let (clock, mut line) = (MonotonicClock::new(), Vec::new());
    let mut piece = [0; 1 << 10];
    loop {
        let left = within.checked_sub(clock.elapsed()).filter(|left| !left.is_zero());
        from.set_read_timeout(Some(left.ok_or(ErrorKind::TimedOut)?))?;
        let count = from.read(&mut piece)?;
        if count == 0 {
            return if line.is_empty() { Ok(None) } else { Err(ErrorKind::UnexpectedEof.into()) };
        }
        line.extend_from_slice(piece.get(..count).unwrap_or_default());
        if let Some(end) = line.iter().position(|byte| *byte == b'\n') {
            line.truncate(end);
            return Ok(Some(line));
        }
        if line.len() > most {
            return Err(io::Error::new(ErrorKind::InvalidData, format!("expected a line of at most {most} bytes")));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn request_is_a_line_of_json_or_an_empty_one_for_all() {
        let all = LocalStopRequest::default();
        assert_eq!(request_in(b"", 1), Ok(all.clone()));
        assert_eq!(request_in(b"{}\r", 1), Ok(all));
        let left = LocalStopRequest { plates: vec!["left".to_owned()], port: Some(1) };
        assert_eq!(request_in(br#"{"plates":["left"],"port":1}"#, 1), Ok(left));
        for wrong in [&br#"{"plates":["left"],"port":2}"#[..], br#"{"plate":"left"}"#, b"left", b"\xff"] {
            assert!(request_in(wrong, 1).is_err(), "{wrong:?}");
        }
    }

    #[test]
    fn line_is_bounded_in_bytes_and_time() {
        let heard = |said: &[u8], within_ms| {
            let (mut client, daemon) = UnixStream::pair().unwrap();
            client.write_all(said).unwrap();
            line_of(&daemon, 8, Duration::from_millis(within_ms)).map_err(|error| error.kind())
        };
        assert_eq!(heard(b"one\ntwo", 10_000), Ok(Some(b"one".to_vec())));
        assert_eq!(heard(&[b'x'; 2000], 10_000), Err(ErrorKind::InvalidData));
        assert!(matches!(heard(b"half", 20), Err(ErrorKind::WouldBlock | ErrorKind::TimedOut)));
        let (client, daemon) = UnixStream::pair().unwrap();
        drop(client);
        assert_eq!(line_of(&daemon, 8, Duration::from_secs(10)).unwrap(), None);
    }
}
