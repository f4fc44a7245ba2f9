use std::cmp::Reverse;
use std::collections::BTreeMap;
use std::net::{IpAddr, Ipv6Addr};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use parking_lot::Mutex;
use tokio::task::AbortHandle;

use super::limits::HttpLimits;

/// The host that connections are counted for: an IPv4 address, or the /64 network of an IPv6 address, since one host
/// may use all of that.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(super) struct PeerHost(IpAddr);

impl From<IpAddr> for PeerHost {
    fn from(address: IpAddr) -> Self {
        Self(match address.to_canonical() {
            IpAddr::V6(six) if !six.is_loopback() => Ipv6Addr::from_bits(six.to_bits() >> 64 << 64).into(),
            other => other,
        })
    }
}

impl PeerHost {
    fn most_common(self, limits: &HttpLimits) -> usize {
        if self.0.is_loopback() { limits.loopback_connections } else { limits.peer_connections }
    }
}

/// Counter of the common connections, on which every operation is served.
#[derive(Debug, Default)]
pub(super) struct CommonConnections(Arc<Mutex<Counts>>);

#[derive(Debug, Default)]
struct Counts {
    all: usize,
    of_peer: BTreeMap<PeerHost, usize>,
}

impl CommonConnections {
    /// A place among the common connections; `None` when all are taken, or `peer` has its share.
    pub(super) fn admit(&self, peer: PeerHost, limits: &HttpLimits) -> Option<CommonPlace> {
        let mut counts = self.0.lock();
        let held = counts.of_peer.get(&peer).copied().unwrap_or(0);
        if counts.all >= limits.connections || held >= peer.most_common(limits) {
            return None;
        }
        counts.all += 1;
        counts.of_peer.insert(peer, held + 1);
        drop(counts);
        Some(CommonPlace { counts: Arc::clone(&self.0), peer })
    }
}

/// A place among the common connections, freed on drop.
#[derive(Debug)]
pub(super) struct CommonPlace {
    counts: Arc<Mutex<Counts>>,
    peer: PeerHost,
}

impl Drop for CommonPlace {
    fn drop(&mut self) {
        let mut counts = self.counts.lock();
        counts.all -= 1;
        let held = counts.of_peer.remove(&self.peer).unwrap_or(1);
        if held > 1 {
            counts.of_peer.insert(self.peer, held - 1);
        }
    }
}

/// True from a request's complete head until its answer is written: a busy connection is never dropped in favour of
/// another.
#[derive(Clone, Debug, Default)]
pub(super) struct Busy(Arc<AtomicBool>);

impl Busy {
    pub(super) fn set(&self, busy: bool) {
        self.0.store(busy, Ordering::Release);
    }

    fn is_set(&self) -> bool {
        self.0.load(Ordering::Acquire)
    }
}

/// The newest connections that found no common place, by host. They serve only the emergency stop, the list of plates
/// and the health checks.
#[derive(Debug, Default)]
pub(super) struct SpareConnections(Arc<Mutex<Spares>>);

#[derive(Debug, Default)]
struct Spares {
    count: usize,
    opened: u64,
    /// Oldest first.
    of_peer: BTreeMap<PeerHost, BTreeMap<u64, SparePermit>>,
}

#[derive(Debug, Default)]
struct SparePermit {
    task: Option<AbortHandle>,
    busy: Busy,
}

impl SpareConnections {
    /// A place for a new connection among at most `most`. When all are taken, the oldest connection that is not busy is
    /// dropped, of the host with the most connections. So a host that opens many displaces its own, and each of them
    /// has had time to send its request. `None` when all are busy.
    pub(super) fn admit(&self, peer: PeerHost, most: usize) -> Option<SparePlace> {
        let mut spares = self.0.lock();
        let dropped = if spares.count < most { None } else { Some(spares.take_idle()?) };
        let (number, busy) = (spares.opened, Busy::default());
        spares.opened += 1;
        spares.count += 1;
        let permit = SparePermit { task: None, busy: busy.clone() };
        spares.of_peer.entry(peer).or_default().insert(number, permit);
        drop(spares);
        if let Some(task) = dropped.and_then(|permit| permit.task) {
            task.abort();
        }
        Some(SparePlace { spares: Arc::clone(&self.0), peer, number, busy })
    }

    /// Names the task that serves the connection `number` of `peer`: it is aborted when the connection is dropped.
    pub(super) fn set_task(&self, peer: PeerHost, number: u64, task: AbortHandle) {
        if let Some(permit) = self.0.lock().of_peer.get_mut(&peer).and_then(|held| held.get_mut(&number)) {
            permit.task = Some(task);
        }
    }
}

impl Spares {
    /// The oldest connection that is not busy, of the host with the most connections; of hosts with equally many, that
    /// with the oldest one. `None` when all are busy.
    fn take_idle(&mut self) -> Option<SparePermit> {
        let idle = |(peer, held): (&PeerHost, &BTreeMap<u64, SparePermit>)| {
            let (number, _) = held.iter().find(|(_, permit)| !permit.busy.is_set())?;
            Some((held.len(), Reverse(*number), *peer))
        };
        let (_, Reverse(number), peer) = self.of_peer.iter().filter_map(idle).max()?;
        self.remove(peer, number)
    }

    /// `None` when the connection was dropped before.
    fn remove(&mut self, peer: PeerHost, number: u64) -> Option<SparePermit> {
        let held = self.of_peer.get_mut(&peer)?;
        let permit = held.remove(&number)?;
        if held.is_empty() {
            self.of_peer.remove(&peer);
        }
        self.count -= 1;
        Some(permit)
    }
}

/// A place among the spare connections, freed on drop.
#[derive(Debug)]
pub(super) struct SparePlace {
    spares: Arc<Mutex<Spares>>,
    peer: PeerHost,
    pub(super) number: u64,
    pub(super) busy: Busy,
}

impl Drop for SparePlace {
    fn drop(&mut self) {
        self.spares.lock().remove(self.peer, self.number);
    }
}

#[cfg(test)]
mod tests {
    use std::future::pending;

    use tokio::task::JoinHandle;

    use super::*;

    fn host(address: &str) -> PeerHost {
        PeerHost::from(address.parse::<IpAddr>().unwrap())
    }

    #[test]
    fn peer_with_its_share_gets_no_common_place_and_others_do() {
        let limits =
            HttpLimits { connections: 5, peer_connections: 2, loopback_connections: 3, ..HttpLimits::default() };
        let common = CommonConnections::default();
        let admit = |address: &str| common.admit(host(address), &limits);
        let mut held: Vec<_> = ["192.0.2.1", "192.0.2.1", "127.0.0.1"].map(|peer| admit(peer).unwrap()).into();
        assert!(admit("192.0.2.1").is_none());
        assert!(admit("::ffff:192.0.2.1").is_none(), "the same host");
        held.push(admit("2001:db8::1").unwrap());
        held.push(admit("2001:db8::2:0:0:1").unwrap());
        assert!(admit("127.0.0.1").is_none(), "all are taken");
        held.remove(0);
        assert!(admit("2001:db8::3").is_none(), "the network of that host has its share");
        assert!(admit("192.0.2.1").is_some());
    }

    fn open(spares: &SpareConnections, address: &str, most: usize) -> Option<(JoinHandle<()>, Busy)> {
        let place = spares.admit(host(address), most)?;
        let (number, busy) = (place.number, place.busy.clone());
        let task = tokio::spawn(async move {
            pending::<()>().await;
            drop(place);
        });
        spares.set_task(host(address), number, task.abort_handle());
        Some((task, busy))
    }

    async fn is_dropped(task: JoinHandle<()>) -> bool {
        tokio::task::yield_now().await;
        task.is_finished()
    }

    #[tokio::test]
    async fn busy_spare_connection_is_never_dropped_and_the_oldest_idle_one_is() {
        let spares = SpareConnections::default();
        let opened: Vec<_> = (0..3).map(|_| open(&spares, "127.0.0.1", 3).unwrap()).collect();
        opened[0].1.set(true);
        let newest = open(&spares, "127.0.0.1", 3).unwrap();
        newest.1.set(true);
        let mut dropped = Vec::new();
        for (task, busy) in opened {
            dropped.push(is_dropped(task).await);
            busy.set(true);
        }
        assert_eq!(dropped, [false, true, false]);
        assert!(open(&spares, "127.0.0.1", 3).is_none(), "all are busy");
    }

    #[tokio::test]
    async fn host_with_many_spare_connections_pushes_out_its_own() {
        let spares = SpareConnections::default();
        let (operator, _) = open(&spares, "192.0.2.1", 4).unwrap();
        for _ in 0..100 {
            open(&spares, "192.0.2.66", 4).unwrap();
        }
        assert!(!is_dropped(operator).await);
        let held = spares.0.lock();
        assert_eq!((held.count, held.of_peer.len()), (4, 2));
    }

    #[tokio::test]
    async fn place_of_an_ended_connection_is_free_at_once() {
        let spares = SpareConnections::default();
        let (first, second) = (spares.admit(host("192.0.2.1"), 2), spares.admit(host("192.0.2.1"), 2));
        first.as_ref().unwrap().busy.set(true);
        second.unwrap().busy.set(true);
        assert!(spares.admit(host("192.0.2.2"), 2).is_some(), "the second one has ended");
        drop(first);
        let held = spares.0.lock();
        assert_eq!((held.count, held.of_peer.len()), (0, 0));
    }
}
