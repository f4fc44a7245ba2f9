//! Emergency stops without HTTP: a Unix socket in the data folder that only the daemon's user may write to.
//!
//! A client sends one line of JSON, [`LocalStopRequest`]; an empty line stops every plate. The reply is one line,
//! [`LocalStopAnswer`]. `echo | socat - UNIX-CONNECT:DATA/estop.sock` is enough.

use std::fs::{self, Permissions};
use std::io::{self, BufRead, BufReader, ErrorKind, Read, Write};
use std::os::unix::fs::PermissionsExt;
use std::os::unix::net::{UnixListener, UnixStream};
use std::path::Path;
use std::sync::Arc;
use std::thread;
use std::time::Duration;

use serde::{Deserialize, Serialize};

use crate::api::{DaemonState, EStopped};
use crate::http::Caller;
use crate::supervisor::PlateHandle;

/// Name of the socket in the data folder, and of its callers in the audit log.
pub const ESTOP_SOCKET: &str = "estop.sock";

/// Longest request and longest reply, bytes.
const MOST_REQUEST: u64 = 4 << 10;
const MOST_ANSWER: u64 = 64 << 10;

/// Threads that stand ready for clients: a stop needs no new one, and a silent client holds up the next ones briefly.
const THREADS: usize = 4;

/// Longest waits for a request, for the client to take the reply, and for the reply.
const ASKED_WITHIN: Duration = Duration::from_millis(500);
const TAKEN_WITHIN: Duration = Duration::from_millis(500);
const ANSWERED_WITHIN: Duration = Duration::from_millis(1500);

/// Pause after the system could not accept one more connection.
const NO_ROOM_PAUSE: Duration = Duration::from_millis(20);

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
    pub stops: Vec<EStopped>,
    /// Why not every plate that was asked for is stopped; `None` when each is.
    pub error: Option<String>,
}

/// Emergency stops of the daemon's plates from any thread of the process. Copies share the daemon.
#[derive(Clone, Debug)]
pub struct EmergencyStops(pub(super) Arc<DaemonState>);

impl EmergencyStops {
    /// Stops every plate. `by` is the caller's name for the audit log. All plates are stopped before the first
    /// confirmation is awaited.
    pub fn stop_all(&self, by: &str) -> Vec<EStopped> {
        self.stop(&[], &Caller { name: by.to_owned(), remote: None }).stops
    }

    /// Stops every plate, without a word on what became of it. Never waits.
    pub(super) fn cut(&self) {
        for plate in self.0.plates.iter() {
            plate.estop();
        }
    }

    /// Stops the plates called `names`, or every plate where none is named.
    pub(super) fn stop(&self, names: &[String], caller: &Caller) -> LocalStopAnswer {
        let is_meant = |plate: &&Arc<PlateHandle>| names.is_empty() || names.iter().any(|name| name == plate.name());
        let plates: Vec<Arc<PlateHandle>> = self.0.plates.iter().filter(is_meant).cloned().collect();
        for plate in &plates {
            plate.estop();
        }
        let stops = self.0.confirm_stops(&plates, caller);
        let unknown = names.iter().find(|name| self.0.plates.get(name).is_none());
        let fault = |name| format!("expected one of {}, found {name:?}", self.0.spec.plate_names().join(", "));
        LocalStopAnswer { stops, error: unknown.map(fault) }
    }
}

/// Listens in `data`, replacing a socket left by an earlier daemon; `port` is the HTTP port. The caller must hold the
/// folder's lock, and removes the socket before it gives the lock up.
pub(super) fn listen(data: &Path, port: u16, stop: &EmergencyStops) -> io::Result<()> {
    let path = data.join(ESTOP_SOCKET);
    match fs::remove_file(&path) {
        Err(error) if error.kind() != ErrorKind::NotFound => return Err(error),
        _ => {}
    }
    let listener = UnixListener::bind(&path)?;
    fs::set_permissions(&path, Permissions::from_mode(0o600))?;
    for _ in 0..THREADS {
        let (listener, stop) = (listener.try_clone()?, stop.clone());
        let attend = move || {
            for client in listener.incoming() {
                if let Err(error) = client.and_then(|client| take_stop(&client, port, &stop)) {
                    tracing::warn!("{ESTOP_SOCKET}: {error}");
                    thread::sleep(NO_ROOM_PAUSE);
                }
            }
        };
        thread::Builder::new().name("estop".into()).spawn(attend)?;
    }
    Ok(())
}

fn take_stop(client: &UnixStream, port: u16, stop: &EmergencyStops) -> io::Result<()> {
    let Some(line) = line_of(client, MOST_REQUEST, ASKED_WITHIN)? else { return Ok(()) };
    let caller = Caller { name: ESTOP_SOCKET.to_owned(), remote: None };
    let answer = match request_in(&line, port) {
        Ok(request) => stop.stop(&request.plates, &caller),
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

/// A line of at most `most` bytes, none of which is awaited longer than `within`; `None` when the other end closes
/// without sending any. Only the daemon's own user has the socket, so a client that sends byte by byte is no attack.
fn line_of(from: &UnixStream, most: u64, within: Duration) -> io::Result<Option<Vec<u8>>> {
    from.set_read_timeout(Some(within))?;
    let mut line = Vec::new();
    BufReader::new(from.take(most)).read_until(b'\n', &mut line)?;
    match line.pop() {
        None => Ok(None),
        Some(b'\n') => Ok(Some(line)),
        Some(_) => Err(io::Error::new(ErrorKind::InvalidData, format!("expected a line of at most {most} bytes"))),
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
    fn line_is_bounded_in_bytes_and_each_byte_in_time() {
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
