use std::cmp::Reverse;
use std::collections::{BTreeMap, BTreeSet};
use std::io;
use std::net::SocketAddr;
use std::time::Duration;

use mio::net::TcpStream;

use super::admission::PeerHost;

/// Connections whose client has not sent anything yet. They take no thread, task or timer.
#[derive(Debug, Default)]
pub(super) struct SilentConnections {
    opened: usize,
    by_number: BTreeMap<usize, Silent>,
    /// Numbers of the connections of each host.
    of_peer: BTreeMap<PeerHost, BTreeSet<usize>>,
}

/// A connection whose client has not sent anything yet.
#[derive(Debug)]
pub(super) struct Silent {
    pub(super) stream: TcpStream,
    pub(super) peer: SocketAddr,
    /// Time on the caller's clock at which it was accepted.
    pub(super) accepted_at: Duration,
}

/// The state of a silent connection at its next observation.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Received {
    Nothing,
    Bytes,
    /// The client has closed, or its connection failed.
    End,
}

impl SilentConnections {
    /// Number that the next connection gets. Numbers are not given twice.
    pub(super) fn next_number(&self) -> usize {
        self.opened
    }

    /// Adds a connection. When there are `most`, the oldest is closed of the host with the most. So a host that opens
    /// many displaces its own, and each of them has had time to send its request.
    pub(super) fn add(&mut self, silent: Silent, most: usize) {
        if self.by_number.len() >= most {
            self.close_one();
        }
        self.of_peer.entry(PeerHost::from(silent.peer.ip())).or_default().insert(self.opened);
        self.by_number.insert(self.opened, silent);
        self.opened += 1;
    }

    /// The bytes or the end that the connection has received; `None` when it is no longer silent.
    pub(super) fn received(&self, number: usize) -> Option<Received> {
        let silent = self.by_number.get(&number)?;
        Some(match silent.stream.peek(&mut [0]) {
            Ok(1..) => Received::Bytes,
            Err(error) if error.kind() == io::ErrorKind::WouldBlock => Received::Nothing,
            _ => Received::End,
        })
    }

    /// Takes the connection out. Dropping it closes it.
    pub(super) fn take(&mut self, number: usize) -> Option<Silent> {
        let silent = self.by_number.remove(&number)?;
        let host = PeerHost::from(silent.peer.ip());
        if let Some(held) = self.of_peer.get_mut(&host) {
            held.remove(&number);
            if held.is_empty() {
                self.of_peer.remove(&host);
            }
        }
        Some(silent)
    }

    /// Closes the connections accepted at `time` or earlier.
    pub(super) fn close_accepted_until(&mut self, time: Duration) {
        while let Some((&number, silent)) = self.by_number.first_key_value()
            && silent.accepted_at <= time
        {
            self.take(number);
        }
    }

    /// Time at which the oldest connection was accepted.
    pub(super) fn oldest(&self) -> Option<Duration> {
        self.by_number.first_key_value().map(|(_, silent)| silent.accepted_at)
    }

    /// Closes the oldest connection of the host with the most; of hosts with equally many, that with the oldest one.
    /// False when none is held.
    pub(super) fn close_one(&mut self) -> bool {
        let oldest = self.of_peer.values().filter_map(|held| Some((held.len(), Reverse(*held.first()?)))).max();
        oldest.is_some_and(|(_, Reverse(number))| self.take(number).is_some())
    }
}

#[cfg(test)]
mod tests {
    use std::io::{Read, Write};
    use std::net;

    use super::*;

    /// Both ends of a connection.
    fn pair() -> (net::TcpStream, TcpStream) {
        let listener = net::TcpListener::bind("127.0.0.1:0").unwrap();
        let client = net::TcpStream::connect(listener.local_addr().unwrap()).unwrap();
        let (server, _) = listener.accept().unwrap();
        server.set_nonblocking(true).unwrap();
        (client, TcpStream::from_std(server))
    }

    fn add(silent: &mut SilentConnections, address: &str, accepted_ms: u64, most: usize) -> (usize, net::TcpStream) {
        let (number, (client, stream)) = (silent.next_number(), pair());
        let peer = SocketAddr::new(address.parse().unwrap(), 1);
        silent.add(Silent { stream, peer, accepted_at: Duration::from_millis(accepted_ms) }, most);
        (number, client)
    }

    #[test]
    fn received_tells_bytes_from_silence_and_from_the_end() {
        let mut silent = SilentConnections::default();
        let (number, mut client) = add(&mut silent, "192.0.2.1", 0, 4);
        assert_eq!(silent.received(number), Some(Received::Nothing));
        client.write_all(b"G").unwrap();
        assert_eq!(silent.received(number), Some(Received::Bytes));
        let (ended, client) = add(&mut silent, "192.0.2.1", 0, 4);
        drop(client);
        assert_eq!(silent.received(ended), Some(Received::End));
        assert!(silent.take(number).is_some());
        assert_eq!(silent.received(number), None);
    }

    #[test]
    fn host_with_the_most_connections_loses_its_oldest() {
        let mut silent = SilentConnections::default();
        let (operator, _client) = add(&mut silent, "192.0.2.1", 0, 4);
        let flood: Vec<_> = (1..=100).map(|ms| add(&mut silent, "192.0.2.66", ms, 4)).collect();
        assert_eq!(silent.by_number.keys().copied().collect::<Vec<_>>(), [operator, 98, 99, 100]);
        assert_eq!(silent.of_peer.len(), 2);
        let (_, mut displaced) = flood.into_iter().next().unwrap();
        assert_eq!(displaced.read(&mut [0]).unwrap(), 0, "closed");
    }

    #[test]
    fn of_hosts_with_equally_many_that_with_the_oldest_loses_it() {
        let mut silent = SilentConnections::default();
        let hosts = ["192.0.2.1", "192.0.2.2", "2001:db8::1"];
        let clients: Vec<_> = (0..9).map(|i| add(&mut silent, hosts[i % 3], 0, 3)).collect();
        assert_eq!(silent.by_number.keys().copied().collect::<Vec<_>>(), [6, 7, 8], "whatever their addresses");
        assert!(silent.close_one() && silent.close_one() && silent.close_one() && !silent.close_one());
        drop(clients);
    }

    #[test]
    fn connection_is_closed_once_it_was_silent_for_too_long() {
        let mut silent = SilentConnections::default();
        let _clients = [10, 20, 30].map(|ms| add(&mut silent, "192.0.2.1", ms, 4));
        silent.close_accepted_until(Duration::from_millis(20));
        assert_eq!(silent.oldest(), Some(Duration::from_millis(30)));
        silent.close_accepted_until(Duration::from_millis(30));
        assert_eq!((silent.oldest(), silent.of_peer.len()), (None, 0));
    }
}
