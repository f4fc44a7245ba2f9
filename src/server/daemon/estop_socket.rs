//! Emergency stops without HTTP: a Unix socket in the data folder that only the daemon's user may write to.
//!
//! A client sends one line of JSON, [`LocalStopRequest`]; an empty line stops every plate. The reply is one line,
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

use super::estop;
use super::state::DaemonState;
use crate::api::EStopped;
use crate::http::Caller;
use upm_core::time::{Clock, MonotonicClock};

/// Name of the socket in the data folder.
pub const ESTOP_SOCKET: &str = "estop.sock";

/// Threads that accept stops. A client that sends nothing occupies one of them for [`ASKED_WITHIN`].
const THREADS: usize = 4;

/// Longest request and longest reply, bytes.
const MOST_REQUEST: usize = 4 << 10;
const MOST_ANSWER: usize = 64 << 10;

/// Most plates in one request.
const MOST_PLATES: usize = 64;

/// Longest time for a request to arrive in full, for the client to take the reply, and for the reply to arrive.
const ASKED_WITHIN: Duration = Duration::from_millis(500);
const TAKEN_WITHIN: Duration = Duration::from_millis(500);
const ANSWERED_WITHIN: Duration = Duration::from_millis(1500);

/// Pause after the system could not accept one more connection.
const NO_ROOM_PAUSE: Duration = Duration::from_millis(20);

/// Caller name of the socket in the audit log.
const BY_SOCKET: &str = "estop.sock";

/// A request on the socket.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct LocalStopRequest {
    /// Plates to stop; empty for all.
    pub plates: Vec<String>,
    /// HTTP port of the daemon that is meant; a daemon on another port refuses. `None` for any.
    pub port: Option<u16>,
}

/// The reply on the socket.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct LocalStopAnswer {
    /// Result of the stop of each plate.
    pub stops: Vec<LocalStop>,
    /// Why no plate was stopped; `None` when the request was accepted.
    pub error: Option<String>,
}

/// Result of the stop of one plate: the answer, or why there is none.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct LocalStop {
    /// Name of the plate; a name that the daemon does not know gives an `error`.
    pub plate: String,
    /// The answer, the same as over HTTP.
    pub answer: Option<EStopped>,
    /// Why the plate was not stopped.
    pub error: Option<String>,
}

/// Emergency stops of the daemon's plates from any thread of the process. Copies share the daemon.
#[derive(Clone, Debug)]
pub struct EmergencyStops(pub(super) Arc<DaemonState>);

impl EmergencyStops {
    /// Stops every plate. `by` is the caller's name for the audit log. All plates are stopped before the first
    /// confirmation is awaited.
    pub fn stop_all(&self, by: &str) -> Vec<LocalStop> {
        self.stop(&self.0.spec.plate_names(), &Caller { name: by.to_owned(), remote: None })
    }

    /// Stops every plate for a client on the network; returns a [`LocalStopAnswer`] as JSON.
    pub(super) fn stop_for(&self, caller: &Caller) -> Vec<u8> {
        let stops = self.stop(&self.0.spec.plate_names(), caller);
        serde_json::to_vec(&LocalStopAnswer { stops, error: None }).unwrap_or_default()
    }

    /// Stops the plates called `names`.
    fn stop(&self, names: &[String], caller: &Caller) -> Vec<LocalStop> {
        for plate in names.iter().filter_map(|name| self.0.plates.get(name)) {
            plate.estop();
        }
        // in parallel: on a frozen disk each takes most of a second
        let see = |name: &str| self.confirm_stop(name, caller);
        thread::scope(|scope| {
            let start = |name| thread::Builder::new().spawn_scoped(scope, move || see(name)).ok();
            let seen: Vec<_> = names.iter().map(String::as_str).map(|name| (name, start(name))).collect();
            let wait = |(name, seen): (_, Option<ScopedJoinHandle<'_, LocalStop>>)| {
                seen.and_then(|thread| thread.join().ok()).unwrap_or_else(|| see(name))
            };
            seen.into_iter().map(wait).collect()
        })
    }

    fn confirm_stop(&self, name: &str, caller: &Caller) -> LocalStop {
        let (answer, error) = match estop::confirm_stop(&self.0, name, caller) {
            Ok(answer) => (Some(answer), None),
            Err(_) => (None, Some(format!("expected one of {}", self.0.spec.plate_names().join(", ")))),
        };
        LocalStop { plate: name.to_owned(), answer, error }
    }
}

/// The listening socket. Dropping it removes the socket file.
#[derive(Debug)]
pub(super) struct EStopSocket {
    path: PathBuf,
    ending: Arc<AtomicBool>,
}

impl EStopSocket {
    /// Listens in `data`, replacing a socket left by an earlier daemon; `port` is the HTTP port. The caller must hold
    /// the folder's lock.
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
        // wakes the threads, which then see the flag; not joined, since one may be waiting for a client
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
        Ok(request) => {
            let caller = Caller { name: BY_SOCKET.to_owned(), remote: None };
            LocalStopAnswer { stops: stop.stop(&request.plates, &caller), error: None }
        }
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

/// Sends a stop to the daemon whose data folder is `data`. An error when no daemon listens there, or no complete reply
/// arrives in time.
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

/// A line of at most `most` bytes that arrives `within` this time; `None` when the other end closes without sending
/// any.
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
