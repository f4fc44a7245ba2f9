use std::io::{self, Read, Write};
use std::net::{Shutdown, SocketAddr, TcpListener, TcpStream};
use std::sync::Arc;
use std::thread;
use std::time::Duration;

use parking_lot::Mutex;

use upm_core::thread_priority::lower_thread_priority;
use upm_core::time::{Clock, MonotonicClock};

/// Largest number of viewers at a time.
const MOST_VIEWERS: usize = 16;

/// Largest number of connections that have not yet been identified as viewers.
const MOST_PENDING: usize = 64;

/// The HTTP/2 connection preface. Browsers only speak HTTP/1 without TLS, so requiring it keeps web pages out. The
/// server behind the proxy would answer pages, under any host name of this machine.
const PREFACE: &[u8] = b"PRI * HTTP/2.0\r\n\r\nSM\r\n\r\n";

/// Time within which a client has to send the preface.
const PREFACE_WITHIN: Duration = Duration::from_secs(5);

/// Time after which a viewer that reads nothing is disconnected.
const WRITE_TIMEOUT: Duration = Duration::from_secs(30);

/// Time within which the server behind the proxy has to accept a connection.
const CONNECT_WITHIN: Duration = Duration::from_secs(1);

/// Pause before the next viewer is accepted after a failure.
const RETRY_AFTER: Duration = Duration::from_millis(20);

/// Size of the buffer for copying, bytes.
const COPY_BUFFER: usize = 16 << 10;

/// A fixed address for viewers in front of a replaceable server. It keeps browsers out and limits the number of
/// viewers. The server can be replaced while no viewer is connected.
#[derive(Debug)]
pub(super) struct ViewerProxy {
    address: SocketAddr,
    state: Arc<Mutex<ProxyState>>,
}

#[derive(Debug)]
struct ProxyState {
    server: SocketAddr,
    viewers: Permits,
    pending: Permits,
    closed: bool,
}

/// A number of permits; dropping one makes it available again.
#[derive(Debug)]
struct Permits {
    taken: Arc<()>,
    most: usize,
}

impl Permits {
    fn new(most: usize) -> Self {
        Self { taken: Arc::default(), most }
    }

    fn count(&self) -> usize {
        Arc::strong_count(&self.taken) - 1
    }

    fn take(&self, whose: &str) -> io::Result<Arc<()>> {
        let is_free = self.count() < self.most;
        is_free.then(|| Arc::clone(&self.taken)).ok_or_else(|| io::Error::other(format!("{} {whose}", self.most)))
    }
}

impl ViewerProxy {
    /// Starts passing viewers that connect to `listener` on to `server`.
    pub(super) fn start(listener: TcpListener, server: SocketAddr) -> io::Result<Self> {
        let address = listener.local_addr()?;
        let (viewers, pending) = (Permits::new(MOST_VIEWERS), Permits::new(MOST_PENDING));
        let state = Arc::new(Mutex::new(ProxyState { server, viewers, pending, closed: false }));
        let accepted = Arc::clone(&state);
        thread::Builder::new().name("live-proxy".into()).spawn(move || {
            // the relay threads inherit this
            lower_thread_priority();
            accept_loop(&listener, &accepted);
        })?;
        Ok(Self { address, state })
    }

    /// The address that viewers connect to.
    pub(super) fn address(&self) -> SocketAddr {
        self.address
    }

    /// Replaces the server by the one that `start` makes. Returns `None`, without calling `start`, while viewers are
    /// connected. Viewers that connect meanwhile wait.
    pub(super) fn replace_if_idle<T>(
        &self,
        start: impl FnOnce() -> io::Result<(T, SocketAddr)>,
    ) -> io::Result<Option<T>> {
        let mut state = self.state.lock();
        if state.viewers.count() > 0 {
            return Ok(None);
        }
        let (started, server) = start()?;
        state.server = server;
        Ok(Some(started))
    }
}

impl Drop for ViewerProxy {
    fn drop(&mut self) {
        self.state.lock().closed = true;
        // wakes the accepting thread, which then checks the flag
        TcpStream::connect(self.address).ok();
    }
}

fn accept_loop(listener: &TcpListener, state: &Arc<Mutex<ProxyState>>) {
    for client in listener.incoming() {
        if state.lock().closed {
            return;
        }
        if let Err(fault) = client.and_then(|client| accept(client, state)) {
            refused(&fault);
            thread::sleep(RETRY_AFTER);
        }
    }
}

fn refused(fault: &io::Error) {
    tracing::warn!("a viewer of the live stream was not let in: {fault}");
}

/// Serves the client on a new thread, once it has proved to be a viewer.
fn accept(client: TcpStream, state: &Arc<Mutex<ProxyState>>) -> io::Result<()> {
    let pending = state.lock().pending.take("clients have sent no preface yet")?;
    let state = Arc::clone(state);
    let serve = move || {
        let shown = read_preface(&client, PREFACE_WITHIN);
        drop(pending);
        match shown {
            Ok(()) => relay(&client, &state).unwrap_or_else(|fault| refused(&fault)),
            Err(fault) => tracing::debug!("no viewer of the live stream: {fault}"),
        }
    };
    thread::Builder::new().name("live-in".into()).spawn(serve).map(drop)
}

/// Reads [`PREFACE`] from the client, `within` this time, and no byte more.
fn read_preface(mut client: &TcpStream, within: Duration) -> io::Result<()> {
    let clock = MonotonicClock::new();
    let (mut read, mut count) = ([0; PREFACE.len()], 0);
    while count < PREFACE.len() {
        let left = within.checked_sub(clock.elapsed()).filter(|left| !left.is_zero());
        client.set_read_timeout(Some(left.ok_or(io::ErrorKind::TimedOut)?))?;
        let more = client.read(&mut read[count..])?;
        count += more;
        if more == 0 || !PREFACE.starts_with(&read[..count]) {
            return Err(io::Error::other("it does not speak HTTP/2"));
        }
    }
    client.set_read_timeout(None)
}

/// Relays bytes in both directions until one side is gone.
fn relay(viewer: &TcpStream, state: &Mutex<ProxyState>) -> io::Result<()> {
    let (permit, address) = {
        let state = state.lock();
        // one permit for both directions
        (Arc::new(state.viewers.take("viewers are connected already")?), state.server)
    };
    let mut server = TcpStream::connect_timeout(&address, CONNECT_WITHIN)?;
    viewer.set_write_timeout(Some(WRITE_TIMEOUT))?;
    viewer.set_nodelay(true)?;
    server.set_nodelay(true)?;
    server.write_all(PREFACE)?;
    let (from, to, of_both) = (server.try_clone()?, viewer.try_clone()?, Arc::clone(&permit));
    thread::Builder::new().name("live-out".into()).spawn(move || {
        copy(&from, &to);
        drop(of_both);
    })?;
    copy(viewer, &server);
    drop(permit);
    Ok(())
}

/// Copies bytes until one side is gone, then closes both.
fn copy(mut from: &TcpStream, mut to: &TcpStream) {
    let mut bytes = [0; COPY_BUFFER];
    while let Ok(count @ 1..) = from.read(&mut bytes) {
        if to.write_all(&bytes[..count]).is_err() {
            break;
        }
    }
    for stream in [from, to] {
        stream.shutdown(Shutdown::Both).ok();
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use upm_fixtures::wait::eventually_true;

    /// A server that sends `word` to every client and then listens.
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

    fn proxy(word: &'static [u8]) -> ViewerProxy {
        ViewerProxy::start(TcpListener::bind("127.0.0.1:0").unwrap(), speaker(word)).unwrap()
    }

    /// A viewer and the word it received; empty when it was refused.
    fn viewer(proxy: &ViewerProxy) -> (TcpStream, Vec<u8>) {
        let mut stream = TcpStream::connect(proxy.address()).unwrap();
        stream.set_read_timeout(Some(Duration::from_secs(10))).unwrap();
        stream.write_all(PREFACE).unwrap();
        let mut word = vec![0; 3];
        let is_answered = stream.read_exact(&mut word).is_ok();
        (stream, if is_answered { word } else { Vec::new() })
    }

    fn replaced(proxy: &ViewerProxy) -> bool {
        proxy.replace_if_idle(|| Ok(((), speaker(b"new")))).unwrap().is_some()
    }

    #[test]
    fn server_is_replaced_only_without_viewers() {
        let proxy = proxy(b"old");
        let (first, word) = viewer(&proxy);
        assert_eq!(word, b"old");
        assert!(!replaced(&proxy));
        assert_eq!(viewer(&proxy).1, b"old");
        drop(first);
        eventually_true("a viewer that left is not counted", || replaced(&proxy));
        assert_eq!(viewer(&proxy).1, b"new");
    }

    #[test]
    fn viewer_over_the_limit_is_refused() {
        let proxy = proxy(b"old");
        let mut seated: Vec<_> = (0..MOST_VIEWERS).map(|_| viewer(&proxy)).collect();
        assert!(seated.iter().all(|(_, word)| word == b"old"));
        assert_eq!(viewer(&proxy).1, b"");
        seated.pop();
        eventually_true("a seat that was left is free", || viewer(&proxy).1 == b"old");
    }

    #[test]
    fn non_viewer_client_gets_no_answer() {
        let proxy = proxy(b"old");
        for words in [&b"GET / HTTP/1.1\r\nHost: localhost\r\n\r\n"[..], b"P", b"PRI * HTTP/2.0\r\n\r\nSM\r\n\r\t"] {
            let mut page = TcpStream::connect(proxy.address()).unwrap();
            page.set_read_timeout(Some(Duration::from_secs(10))).unwrap();
            // the proxy refuses it, with or without an answer, and may hang up before all is sent
            page.write_all(words).and_then(|()| page.shutdown(Shutdown::Write)).ok();
            let mut heard = Vec::new();
            page.read_to_end(&mut heard).ok();
            assert_eq!(heard, b"", "{words:?}");
        }
        assert_eq!(viewer(&proxy).1, b"old");
    }

    #[test]
    fn viewer_bytes_reach_the_server_unchanged() {
        let server = TcpListener::bind("127.0.0.1:0").unwrap();
        let proxy =
            ViewerProxy::start(TcpListener::bind("127.0.0.1:0").unwrap(), server.local_addr().unwrap()).unwrap();
        let mut viewer = TcpStream::connect(proxy.address()).unwrap();
        let said = [PREFACE, b"and more"].concat();
        // byte by byte, as a network may deliver it
        said.iter().for_each(|byte| viewer.write_all(&[*byte]).unwrap());
        let mut heard = vec![0; said.len()];
        server.accept().unwrap().0.read_exact(&mut heard).unwrap();
        assert_eq!(heard, said);
    }

    #[test]
    fn silent_client_gets_no_permit_and_is_disconnected() {
        let proxy = proxy(b"old");
        let silent: Vec<_> = (0..MOST_VIEWERS).map(|_| TcpStream::connect(proxy.address()).unwrap()).collect();
        assert_eq!(viewer(&proxy).1, b"old");
        drop(silent);

        let listener = TcpListener::bind("127.0.0.1:0").unwrap();
        let mut silent = TcpStream::connect(listener.local_addr().unwrap()).unwrap();
        silent.write_all(&PREFACE[..PREFACE.len() - 1]).unwrap();
        let client = listener.accept().unwrap().0;
        assert!(read_preface(&client, Duration::from_millis(50)).is_err());
        silent.write_all(&PREFACE[PREFACE.len() - 1..]).unwrap();
    }

    #[test]
    fn dropped_proxy_accepts_no_connections() {
        let proxy = proxy(b"old");
        let address = proxy.address();
        drop(proxy);
        eventually_true("nothing listens", || TcpStream::connect(address).is_err());
    }
}
