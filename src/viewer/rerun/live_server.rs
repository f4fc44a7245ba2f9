use std::collections::HashMap;
use std::fmt;
use std::hash::{BuildHasher, RandomState};
use std::io;
use std::net::{Ipv4Addr, SocketAddr, TcpListener, TcpStream};
use std::sync::Arc;
use std::sync::mpsc::sync_channel;
use std::thread;
use std::time::Duration;

use parking_lot::{Mutex, MutexGuard};

use rerun::external::re_log_types::BlueprintActivationCommand;
use rerun::external::re_uri::{Origin, ProxyUri, Scheme};
use rerun::grpc_server::GrpcServerSink;
use rerun::log::LogMsg;
use rerun::sink::LogSink;
use rerun::{MemoryLimit, PlaybackBehavior, ServerOptions};

use super::live::{MessageSink, VIEWER_QUEUE};
use super::viewer_proxy::ViewerProxy;
use upm_core::background::{OverflowPolicy, Queue, Receiver};
use upm_core::thread_priority::lower_thread_priority;

/// Largest number of messages that the server has not yet taken in. Its own bound is 128 MiB.
const MOST_AHEAD: usize = 64;

/// Number of runs after which one of Rerun's servers is replaced, unless viewers are connected. It never forgets a run,
/// and it drops static data, which hold for a whole run, after all temporal data: eventually its history would hold old
/// runs only.
const RUNS_EACH: u32 = 16;

/// Bytes of memory used by a history per byte that the server counts in it. Measured: 1.3 after fifty short runs, 2.1
/// after some hundred.
const TAKEN_PER_COUNTED: u64 = 2;

/// Least history of a server, counted bytes: with an empty history it blocks the sender.
const LEAST_HISTORY_BYTES: u64 = 1 << 20;

/// Lowest port of a server behind the gate, and the number of addresses that are tried.
const FIRST_PORT: u16 = 1024;
const ADDRESSES_TRIED: usize = 64;

/// Number and interval of the attempts to reach a new server.
const CONNECT_ATTEMPTS: usize = 200;
const CONNECT_INTERVAL: Duration = Duration::from_millis(10);

/// A server for Rerun viewers on this machine that shows the runs of one plate, each run as a separate recording. It
/// lives as long as the plate; clones are the same server. New viewers see the most recent runs, including the current
/// one.
///
/// A viewer that lags or is frozen does not delay the runs: the messages it does not take are dropped, for all viewers,
/// until it is disconnected after half a minute. Any local program may connect, without a password. Pages in a browser
/// are refused, because they cannot speak HTTP/2 without TLS. The Rerun server behind the gate would answer them, so
/// its address is random.
#[derive(Clone)]
pub struct LiveServer(Arc<LiveServerInner>);

struct LiveServerInner {
    uri: String,
    proxy: ViewerProxy,
    history_bytes: u64,
    active: Mutex<ActiveServer>,
}

struct ActiveServer {
    stage: Arc<ServerGeneration>,
    runs: u32,
}

impl LiveServer {
    /// Starts listening on `port` of the loopback, or on any free one. The newest messages are kept for later viewers,
    /// within about `history_bytes` of memory.
    pub fn start(port: Option<u16>, history_bytes: u64) -> io::Result<Self> {
        let listener = TcpListener::bind((Ipv4Addr::LOCALHOST, port.unwrap_or(0)))?;
        let (stage, address) = ServerGeneration::start(history_bytes)?;
        let proxy = ViewerProxy::start(listener, address)?;
        let uri = ProxyUri::new(Origin::from_scheme_and_socket_addr(Scheme::RerunHttp, proxy.address())).to_string();
        let active = Mutex::new(ActiveServer { stage, runs: 0 });
        Ok(Self(Arc::new(LiveServerInner { uri, proxy, history_bytes, active })))
    }

    /// Address for viewers, `rerun+http://127.0.0.1:PORT/proxy`.
    pub fn uri(&self) -> &str {
        &self.0.uri
    }

    /// Number of messages that the present server lost because a viewer lagged.
    #[cfg(test)]
    pub(super) fn lost(&self) -> u64 {
        lock(&self.0.active).stage.queue.lost()
    }

    /// The feed for one run whose layout depends on `layout` alone.
    pub(super) fn feed(&self, layout: String) -> MessageSink {
        let mut feed = RunFeed { stage: self.0.server_for_run(), layout, layout_whole: true };
        Box::new(move |message| feed.offer(message))
    }
}

impl fmt::Debug for LiveServer {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_tuple("LiveServer").field(&self.0.uri).finish()
    }
}

impl LiveServerInner {
    fn server_for_run(&self) -> Arc<ServerGeneration> {
        let mut active = lock(&self.active);
        if active.runs >= RUNS_EACH {
            match self.proxy.replace_if_idle(|| ServerGeneration::start(self.history_bytes)) {
                Ok(Some(stage)) => *active = ActiveServer { stage, runs: 0 },
                Ok(None) => {}
                Err(fault) => tracing::warn!("the live stream at {} goes on as it was: {fault}", self.uri),
            }
        }
        active.runs += 1;
        Arc::clone(&active.stage)
    }
}

/// One of Rerun's servers and the queue to it. It ends with its last run.
struct ServerGeneration {
    queue: Queue<LogMsg>,
    layouts: Mutex<Layouts>,
}

/// Layouts that the server has, by their key. It never forgets one, so a layout for each run would fill the memory.
#[derive(Default)]
struct Layouts {
    announced: HashMap<String, BlueprintActivationCommand>,
    /// Key of the layout that viewers show.
    shown: Option<String>,
}

impl ServerGeneration {
    /// Starts a server and waits until it answers; also returns its address.
    fn start(history_bytes: u64) -> io::Result<(Arc<Self>, SocketAddr)> {
        let (queue, messages) = Queue::bounded(VIEWER_QUEUE, OverflowPolicy::GiveUp);
        let (bound, started) = sync_channel(1);
        thread::Builder::new().name("live".into()).spawn(move || {
            // the server's threads inherit this priority
            lower_thread_priority();
            let sink = sink(history_bytes);
            let address =
                sink.as_ref().map(|(_, address)| *address).map_err(|fault| io::Error::other(fault.to_string()));
            bound.try_send(address).ok();
            if let Ok((sink, _)) = sink {
                serve(&sink, &messages);
            }
        })?;
        let address = started.recv().map_err(io::Error::other)??;
        wait_for(address)?;
        Ok((Arc::new(Self { queue, layouts: Mutex::default() }), address))
    }
}

/// One of Rerun's servers at an unpredictable address, and that address.
fn sink(history_bytes: u64) -> io::Result<(GrpcServerSink, SocketAddr)> {
    let address = hidden_address()?;
    let options = ServerOptions {
        playback_behavior: PlaybackBehavior::NewestFirst,
        memory_limit: MemoryLimit::from_bytes((history_bytes / TAKEN_PER_COUNTED).max(LEAST_HISTORY_BYTES)),
        cors_allowed_origins: Vec::new(),
    };
    let sink = GrpcServerSink::new(&address.ip().to_string(), address.port(), options).map_err(io::Error::other)?;
    Ok((sink, address))
}

/// A free address that a page in a browser cannot guess: the server there would answer pages under any host name. On
/// Linux all of 127.0.0.0/8 is this machine; address and port give some 40 bits. Elsewhere only the port varies.
fn hidden_address() -> io::Result<SocketAddr> {
    let mut free = Err(io::ErrorKind::AddrInUse.into());
    for _ in 0..ADDRESSES_TRIED {
        // the standard library's hash keys are random
        let random = RandomState::new().hash_one(());
        let [.., a, b, c] = random.to_be_bytes();
        let ip = if cfg!(target_os = "linux") { Ipv4Addr::new(127, a, b, c) } else { Ipv4Addr::LOCALHOST };
        let port = FIRST_PORT.saturating_add((random >> 24) as u16 % (u16::MAX - FIRST_PORT));
        free = TcpListener::bind((ip, port)).and_then(|listener| listener.local_addr());
        if free.is_ok() {
            break;
        }
    }
    free
}

struct RunFeed {
    stage: Arc<ServerGeneration>,
    layout: String,
    /// False when a part of the layout was dropped.
    layout_whole: bool,
}

impl RunFeed {
    fn offer(&mut self, message: LogMsg) {
        if message.store_id().is_blueprint() {
            self.offer_layout(message);
        } else {
            self.stage.queue.send(message).ok();
        }
    }

    /// Sends a layout to the server once; after that it is only selected again.
    fn offer_layout(&mut self, message: LogMsg) {
        let ServerGeneration { queue, layouts } = &*self.stage;
        let mut layouts = lock(layouts);
        let announced = layouts.announced.get(&self.layout).cloned();
        match (message, announced) {
            (LogMsg::BlueprintActivationCommand(_), Some(_)) if layouts.shown.as_ref() == Some(&self.layout) => {}
            (LogMsg::BlueprintActivationCommand(_), Some(announced)) => {
                if queue.send(LogMsg::BlueprintActivationCommand(announced)).is_ok() {
                    layouts.shown = Some(self.layout.clone());
                }
            }
            (LogMsg::BlueprintActivationCommand(last), None) => {
                if queue.send(LogMsg::BlueprintActivationCommand(last.clone())).is_ok() && self.layout_whole {
                    layouts.announced.insert(self.layout.clone(), last);
                    layouts.shown = Some(self.layout.clone());
                }
            }
            (_, Some(_)) => {}
            (message, None) => self.layout_whole &= queue.send(message).is_ok(),
        }
    }
}

fn lock<T>(held: &Mutex<T>) -> MutexGuard<'_, T> {
    held.lock()
}

/// Passes messages on until all senders are gone. Dropping the sink waits for the slowest viewer, so this thread is
/// never waited for.
fn serve(sink: &GrpcServerSink, messages: &Receiver<LogMsg>) {
    let mut ahead = 0;
    while let Ok(message) = messages.recv() {
        sink.send(message);
        ahead += 1;
        if ahead == MOST_AHEAD {
            ahead = 0;
            if let Err(fault) = sink.flush_blocking(Duration::MAX) {
                tracing::error!("the live stream has ended: {fault}");
                return;
            }
        }
    }
}

/// Waits until the server at `address` answers.
fn wait_for(address: SocketAddr) -> io::Result<()> {
    for _ in 1..CONNECT_ATTEMPTS {
        if TcpStream::connect(address).is_ok() {
            return Ok(());
        }
        thread::sleep(CONNECT_INTERVAL);
    }
    TcpStream::connect(address).map(drop)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    #[cfg(target_os = "linux")]
    fn inner_servers_have_distinct_loopback_addresses() {
        let addresses = [0; 8].map(|_| hidden_address().unwrap());
        for address in addresses {
            assert!(address.ip().is_loopback() && address.ip() != Ipv4Addr::LOCALHOST, "{address}");
            assert!(address.port() >= FIRST_PORT);
        }
        let mut different = addresses.map(|address| address.ip()).to_vec();
        different.sort();
        different.dedup();
        assert_eq!(different.len(), addresses.len());
    }
}
