use std::io::{self, Read, Write};
use std::net::{Shutdown, SocketAddr, TcpListener, TcpStream};
use std::sync::Arc;
use std::thread;
use std::time::Duration;

use parking_lot::{Mutex, MutexGuard};

use upm_core::priority::step_back;
use upm_core::time::{Clock, MonotonicClock};

/// Viewers at a time.
const MOST_VIEWERS: usize = 16;

/// Connections at a time that have not said yet that they are viewers.
const MOST_CALLERS: usize = 64;

/// What every client that speaks HTTP/2 says first. A viewer does; a page in a browser cannot, without TLS it is given
/// HTTP/1. The server behind would answer pages, whichever name of this machine they use.
const PREFACE: &[u8] = b"PRI * HTTP/2.0\r\n\r\nSM\r\n\r\n";

/// Time to say it.
const INTRODUCTION: Duration = Duration::from_secs(5);

/// A viewer that takes nothing for so long is let go.
const PATIENCE: Duration = Duration::from_secs(30);

/// Time that the server behind the gate has to answer.
const ANSWER: Duration = Duration::from_secs(1);

/// Time before the next viewer is let in when one could not be taken.
const TAKE_AGAIN: Duration = Duration::from_millis(20);

/// Bytes passed on at once.
const PASSED: usize = 16 << 10;

/// One address for viewers, whichever server stands behind it. It knows how many are there, so that a server can be put
/// in another's place while nobody looks.
#[derive(Debug)]
pub(super) struct Gate {
    address: SocketAddr,
    hall: Arc<Mutex<Hall>>,
}

/// What is behind the gate.
#[derive(Debug)]
struct Hall {
    server: SocketAddr,
    viewers: usize,
    callers: usize,
    closed: bool,
}

impl Gate {
    /// Lets in whoever comes to `listener`, and passes them on to `server`.
    pub(super) fn open(listener: TcpListener, server: SocketAddr) -> io::Result<Self> {
        let address = listener.local_addr()?;
        let hall = Arc::new(Mutex::new(Hall { server, viewers: 0, callers: 0, closed: false }));
        let of_door = Arc::clone(&hall);
        thread::Builder::new().name("live-gate".into()).spawn(move || {
            // those who pass things on are what this one is
            step_back();
            keep_door(&listener, &of_door);
        })?;
        Ok(Self { address, hall })
    }

    /// Where viewers come to.
    pub(super) fn address(&self) -> SocketAddr {
        self.address
    }

    /// Passes viewers on to the server that `start` makes, from now on; `None` while there are viewers, and `start` is not
    /// called. Who comes meanwhile waits.
    pub(super) fn replace_when_alone<T>(
        &self,
        start: impl FnOnce() -> io::Result<(T, SocketAddr)>,
    ) -> io::Result<Option<T>> {
        let mut hall = lock(&self.hall);
        if hall.viewers > 0 {
            return Ok(None);
        }
        let (started, server) = start()?;
        hall.server = server;
        Ok(Some(started))
    }
}

impl Drop for Gate {
    fn drop(&mut self) {
        lock(&self.hall).closed = true;
        // wakes the door, which then sees it
        TcpStream::connect(self.address).ok();
    }
}

fn lock(hall: &Mutex<Hall>) -> MutexGuard<'_, Hall> {
    hall.lock()
}

fn keep_door(listener: &TcpListener, hall: &Arc<Mutex<Hall>>) {
    for viewer in listener.incoming() {
        if lock(hall).closed {
            return;
        }
        if let Err(fault) = viewer.and_then(|viewer| hear(viewer, hall)) {
            not_let_in(&fault);
            thread::sleep(TAKE_AGAIN);
        }
    }
}

fn not_let_in(fault: &io::Error) {
    tracing::warn!("a viewer of the live stream was not let in: {fault}");
}

/// Lets the caller in once it has said that it is a viewer, on a thread of its own.
fn hear(caller: TcpStream, hall: &Arc<Mutex<Hall>>) -> io::Result<()> {
    let (call, hall) = (Call::take(hall)?, Arc::clone(hall));
    let attend = move || {
        let introduced = introduction(&caller, INTRODUCTION);
        drop(call);
        match introduced {
            Ok(()) => let_in(&caller, &hall).unwrap_or_else(|fault| not_let_in(&fault)),
            Err(fault) => tracing::debug!("no viewer of the live stream: {fault}"),
        }
    };
    thread::Builder::new().name("live-in".into()).spawn(attend).map(drop)
}

/// Hears [`PREFACE`] from the caller, `within` this time, and nothing after it.
fn introduction(mut caller: &TcpStream, within: Duration) -> io::Result<()> {
    let clock = MonotonicClock::new();
    let (mut heard, mut count) = ([0; PREFACE.len()], 0);
    while count < PREFACE.len() {
        let left = within.checked_sub(clock.elapsed()).filter(|left| !left.is_zero());
        caller.set_read_timeout(Some(left.ok_or(io::ErrorKind::TimedOut)?))?;
        let more = caller.read(&mut heard[count..])?;
        count += more;
        if more == 0 || !PREFACE.starts_with(&heard[..count]) {
            return Err(io::Error::other("it does not speak HTTP/2"));
        }
    }
    caller.set_read_timeout(None)
}

/// Passes on what comes from the viewer and what it is sent, until one of the two is gone.
fn let_in(viewer: &TcpStream, hall: &Arc<Mutex<Hall>>) -> io::Result<()> {
    let (seat, server) = Seat::take(hall)?;
    let mut server = TcpStream::connect_timeout(&server, ANSWER)?;
    viewer.set_write_timeout(Some(PATIENCE))?;
    viewer.set_nodelay(true)?;
    server.set_nodelay(true)?;
    server.write_all(PREFACE)?;
    let (from, to, seat) = (server.try_clone()?, viewer.try_clone()?, Arc::new(seat));
    let of_both = Arc::clone(&seat);
    thread::Builder::new().name("live-out".into()).spawn(move || {
        pass(&from, &to);
        drop(of_both);
    })?;
    pass(viewer, &server);
    drop(seat);
    Ok(())
}

/// Passes on what comes until one end is gone; then nobody is left to speak to the other way either.
fn pass(mut from: &TcpStream, mut to: &TcpStream) {
    let mut bytes = [0; PASSED];
    while let Ok(count @ 1..) = from.read(&mut bytes) {
        if to.write_all(&bytes[..count]).is_err() {
            break;
        }
    }
    for stream in [from, to] {
        stream.shutdown(Shutdown::Both).ok();
    }
}

/// A caller's place before the gate; free again when it is dropped.
struct Call(Arc<Mutex<Hall>>);

impl Call {
    fn take(hall: &Arc<Mutex<Hall>>) -> io::Result<Self> {
        let mut now = lock(hall);
        if now.callers == MOST_CALLERS {
            return Err(io::Error::other(format!("{MOST_CALLERS} wait that have said nothing")));
        }
        now.callers += 1;
        Ok(Self(Arc::clone(hall)))
    }
}

impl Drop for Call {
    fn drop(&mut self) {
        lock(&self.0).callers -= 1;
    }
}

/// A viewer's place; free again when it is dropped.
struct Seat(Arc<Mutex<Hall>>);

impl Seat {
    /// A seat, and the server that is on show as long as it is taken.
    fn take(hall: &Arc<Mutex<Hall>>) -> io::Result<(Self, SocketAddr)> {
        let mut now = lock(hall);
        if now.viewers == MOST_VIEWERS {
            return Err(io::Error::other(format!("{MOST_VIEWERS} are there already")));
        }
        now.viewers += 1;
        Ok((Self(Arc::clone(hall)), now.server))
    }
}

impl Drop for Seat {
    fn drop(&mut self) {
        lock(&self.0).viewers -= 1;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A server that says `word` to everyone and then listens.
    fn speaker(word: &'static [u8]) -> SocketAddr {
        let listener = TcpListener::bind("127.0.0.1:0").unwrap();
        let address = listener.local_addr().unwrap();
        thread::spawn(move || {
            for mut stream in listener.incoming().flatten() {
                stream.write_all(word).unwrap();
                thread::spawn(move || stream.read_to_end(&mut Vec::new()));
            }
        });
        address
    }

    fn gate(word: &'static [u8]) -> Gate {
        Gate::open(TcpListener::bind("127.0.0.1:0").unwrap(), speaker(word)).unwrap()
    }

    /// A viewer, and the word it was told; empty when it was sent away.
    fn viewer(gate: &Gate) -> (TcpStream, Vec<u8>) {
        let mut stream = TcpStream::connect(gate.address()).unwrap();
        stream.set_read_timeout(Some(Duration::from_secs(10))).unwrap();
        stream.write_all(PREFACE).unwrap();
        let mut word = vec![0; 3];
        let told = stream.read_exact(&mut word).is_ok();
        (stream, if told { word } else { Vec::new() })
    }

    fn replaced(gate: &Gate) -> bool {
        gate.replace_when_alone(|| Ok(((), speaker(b"new")))).unwrap().is_some()
    }

    #[test]
    fn a_server_is_replaced_only_while_nobody_looks() {
        let gate = gate(b"old");
        let (first, word) = viewer(&gate);
        assert_eq!(word, b"old");
        assert!(!replaced(&gate));
        assert_eq!(viewer(&gate).1, b"old");
        drop(first);
        let tries = (0..1000).take_while(|_| {
            thread::sleep(Duration::from_millis(10));
            !replaced(&gate)
        });
        assert!(tries.count() < 1000, "a viewer that left is still counted");
        assert_eq!(viewer(&gate).1, b"new");
    }

    #[test]
    fn no_more_viewers_than_there_are_seats() {
        let gate = gate(b"old");
        let mut seated: Vec<_> = (0..MOST_VIEWERS).map(|_| viewer(&gate)).collect();
        assert!(seated.iter().all(|(_, word)| word == b"old"));
        assert_eq!(viewer(&gate).1, b"");
        seated.pop();
        let tries = (0..1000).take_while(|_| {
            thread::sleep(Duration::from_millis(10));
            viewer(&gate).1 != b"old"
        });
        assert!(tries.count() < 1000, "a seat that was left stays taken");
    }

    #[test]
    fn who_does_not_speak_as_viewers_do_hears_nothing() {
        let gate = gate(b"old");
        for words in [&b"GET / HTTP/1.1\r\nHost: localhost\r\n\r\n"[..], b"P", b"PRI * HTTP/2.0\r\n\r\nSM\r\n\r\t"] {
            let mut page = TcpStream::connect(gate.address()).unwrap();
            page.set_read_timeout(Some(Duration::from_secs(10))).unwrap();
            page.write_all(words).unwrap();
            page.shutdown(Shutdown::Write).unwrap();
            let mut heard = Vec::new();
            // it is sent away, politely or not
            page.read_to_end(&mut heard).ok();
            assert_eq!(heard, b"", "{words:?}");
        }
        assert_eq!(viewer(&gate).1, b"old");
    }

    #[test]
    fn the_server_hears_what_the_viewer_said() {
        let server = TcpListener::bind("127.0.0.1:0").unwrap();
        let gate = Gate::open(TcpListener::bind("127.0.0.1:0").unwrap(), server.local_addr().unwrap()).unwrap();
        let mut viewer = TcpStream::connect(gate.address()).unwrap();
        let said = [PREFACE, b"and more"].concat();
        // byte by byte, as a network may bring it
        said.iter().for_each(|byte| viewer.write_all(&[*byte]).unwrap());
        let mut heard = vec![0; said.len()];
        server.accept().unwrap().0.read_exact(&mut heard).unwrap();
        assert_eq!(heard, said);
    }

    #[test]
    fn who_says_nothing_has_no_seat_and_is_sent_away() {
        let gate = gate(b"old");
        let silent: Vec<_> = (0..MOST_VIEWERS).map(|_| TcpStream::connect(gate.address()).unwrap()).collect();
        assert_eq!(viewer(&gate).1, b"old");
        drop(silent);

        let listener = TcpListener::bind("127.0.0.1:0").unwrap();
        let mut silent = TcpStream::connect(listener.local_addr().unwrap()).unwrap();
        silent.write_all(&PREFACE[..PREFACE.len() - 1]).unwrap();
        let caller = listener.accept().unwrap().0;
        assert!(introduction(&caller, Duration::from_millis(50)).is_err());
        silent.write_all(&PREFACE[PREFACE.len() - 1..]).unwrap();
    }

    #[test]
    fn a_gate_that_is_gone_lets_nobody_in() {
        let gate = gate(b"old");
        let address = gate.address();
        drop(gate);
        let tries = (0..1000).take_while(|_| {
            thread::sleep(Duration::from_millis(10));
            TcpStream::connect(address).is_ok()
        });
        assert!(tries.count() < 1000, "it still listens");
    }
}
