use std::io;
use std::net::SocketAddr;
use std::sync::Arc;
use std::time::Duration;

use mio::event::Event;
use mio::net::TcpListener;
use mio::{Events, Interest, Poll, Token, Waker};
use rustix::io::Errno;

use super::silent::{Received, Silent, SilentConnections};
use upm_core::time::{Clock, MonotonicClock};

const LISTENER: Token = Token(usize::MAX);
const SHUTDOWN: Token = Token(usize::MAX - 1);

/// Connections accepted before the events of earlier ones are handled. Far fewer than silent ones are kept, so that
/// none is closed for newer ones before its request was noticed.
const IN_A_ROW: usize = 32;

/// Most events handled in a row.
const EVENTS: usize = 1024;

/// Pause after the system could not accept one more connection.
const NO_ROOM_PAUSE: Duration = Duration::from_millis(50);

/// Pause while no further connection may be opened.
const FULL_PAUSE: Duration = Duration::from_millis(5);

/// A server of connections that have sent something.
pub(super) trait Serve {
    /// False while no further connection may be opened.
    fn may_open(&mut self) -> bool;

    /// Serves a connection, without blocking.
    fn serve(&mut self, stream: std::net::TcpStream, peer: SocketAddr);
}

/// The event loop that accepts connections and keeps each until its client has sent something. A silent connection
/// costs little more than the kernel's part, so that a flood of them keeps no emergency stop in the accept queue.
pub(super) struct Acceptor {
    poll: Poll,
    /// Kept here, since the event of a waker that was dropped never arrives.
    shutdown: Arc<Waker>,
    listener: TcpListener,
    silent: SilentConnections,
    clock: MonotonicClock,
    most_silent: usize,
    silent_time: Duration,
}

impl Acceptor {
    /// Accepts on `listener`; at most `most_silent` connections are kept, each for `silent_time`.
    pub(super) fn new(listener: std::net::TcpListener, most_silent: usize, silent_time: Duration) -> io::Result<Self> {
        listener.set_nonblocking(true)?;
        let (poll, mut listener) = (Poll::new()?, TcpListener::from_std(listener));
        poll.registry().register(&mut listener, LISTENER, Interest::READABLE)?;
        let shutdown = Arc::new(Waker::new(poll.registry(), SHUTDOWN)?);
        let (silent, clock) = (SilentConnections::default(), MonotonicClock::new());
        Ok(Self { poll, shutdown, listener, silent, clock, most_silent, silent_time })
    }

    /// Ends [`run`](Self::run) when it is woken.
    pub(super) fn shutdown_waker(&self) -> Arc<Waker> {
        Arc::clone(&self.shutdown)
    }

    /// Hands connections to `server` until the waker is woken; then closes the listener and all silent connections.
    pub(super) fn run(mut self, server: &mut impl Serve) -> io::Result<()> {
        let mut events = Events::with_capacity(EVENTS);
        // the listener reports only that connections have come, not that some are left
        let (mut queued, mut pause) = (false, Duration::ZERO);
        loop {
            match self.poll.poll(&mut events, self.longest_wait(queued.then_some(pause))) {
                Err(error) if error.kind() == io::ErrorKind::Interrupted => continue,
                polled => polled?,
            }
            if events.iter().any(|event| event.token() == SHUTDOWN) {
                return Ok(());
            }
            queued |= events.iter().any(|event| event.token() == LISTENER);
            events.iter().for_each(|event| self.handle(event, server));
            if let Some(time) = self.clock.elapsed().checked_sub(self.silent_time) {
                self.silent.close_accepted_until(time);
            }
            if !queued {
                continue;
            }
            (queued, pause) = if server.may_open() { self.accept_some() } else { (true, FULL_PAUSE) };
        }
    }

    /// Time until the oldest silent connection is closed, at most `pause`; `None` without either.
    fn longest_wait(&self, pause: Option<Duration>) -> Option<Duration> {
        let close_at = self.silent.oldest().map(|time| time + self.silent_time);
        let until_closing = close_at.map(|time| time.saturating_sub(self.clock.elapsed()));
        [until_closing, pause].into_iter().flatten().min()
    }

    fn handle(&mut self, event: &Event, server: &mut impl Serve) {
        let Token(number) = event.token();
        let received = self.silent.received(number);
        if !matches!(received, Some(Received::Bytes | Received::End)) {
            return;
        }
        let Some(Silent { mut stream, peer, .. }) = self.silent.take(number) else { return };
        if received == Some(Received::Bytes) && self.poll.registry().deregister(&mut stream).is_ok() {
            server.serve(stream.into(), peer);
        }
    }

    /// Accepts connections of the queue; returns whether more may be left, and the pause before they are accepted.
    fn accept_some(&mut self) -> (bool, Duration) {
        for _ in 0..IN_A_ROW {
            let (mut stream, peer) = match self.listener.accept() {
                Ok(accepted) => accepted,
                Err(error) if error.kind() == io::ErrorKind::WouldBlock => return (false, Duration::ZERO),
                // room for one more; then events are handled, so that none is closed before its request is noticed
                Err(error) if is_out_of_descriptors(&error) && self.silent.close_one() => {
                    return (true, Duration::ZERO);
                }
                Err(error) => {
                    tracing::warn!(%error, "cannot accept a connection");
                    return (true, NO_ROOM_PAUSE);
                }
            };
            let token = Token(self.silent.next_number());
            if self.poll.registry().register(&mut stream, token, Interest::READABLE).is_ok() {
                let accepted_at = self.clock.elapsed();
                self.silent.add(Silent { stream, peer, accepted_at }, self.most_silent);
            }
        }
        (true, Duration::ZERO)
    }
}

fn is_out_of_descriptors(error: &io::Error) -> bool {
    matches!(Errno::from_io_error(error), Some(Errno::MFILE | Errno::NFILE))
}
