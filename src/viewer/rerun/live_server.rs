use std::collections::HashMap;
use std::fmt;
use std::io;
use std::net::{Ipv4Addr, SocketAddr, TcpListener, TcpStream};
use std::sync::Arc;
use std::thread;
use std::time::Duration;

use parking_lot::Mutex;

use rerun::external::re_log_types::BlueprintActivationCommand;
use rerun::external::re_uri::{Origin, ProxyUri, Scheme};
use rerun::grpc_server::GrpcServerSink;
use rerun::log::LogMsg;
use rerun::sink::LogSink;
use rerun::{MemoryLimit, PlaybackBehavior, ServerOptions};

use super::live::{MessageSink, VIEWER_QUEUE};
use upm_core::background::{OverflowPolicy, Queue, Receiver};
use upm_core::thread_priority::lower_thread_priority;

/// Largest number of messages that the server has not yet taken in. Its own bound is 128 MiB.
const MOST_AHEAD: usize = 64;

/// Number and interval of the attempts to reach a new server.
const CONNECT_ATTEMPTS: usize = 200;
const CONNECT_INTERVAL: Duration = Duration::from_millis(10);

/// Rerun's server for viewers on this machine, which shows the runs of one plate, each run as a separate recording. It
/// lives as long as the plate; clones are the same server.
///
/// A viewer that lags or is frozen does not delay the runs: the messages it does not take are dropped, for all viewers,
/// until the server disconnects it. Any local program may connect, without a password, and so could any page in a
/// browser on this machine.
#[derive(Clone)]
pub struct LiveServer(Arc<LiveServerInner>);

struct LiveServerInner {
    uri: String,
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

impl LiveServer {
    /// Starts a server on `port` of the loopback, or on any free one, and waits until it answers. It keeps the newest
    /// messages for later viewers, up to `history_bytes` as it counts them.
    pub fn start(port: Option<u16>, history_bytes: u64) -> io::Result<Self> {
        // the server would only log that the port is in use
        let free = TcpListener::bind((Ipv4Addr::LOCALHOST, port.unwrap_or(0)))?;
        let address = free.local_addr()?;
        drop(free);
        let (queue, messages) = Queue::bounded(VIEWER_QUEUE, OverflowPolicy::GiveUp);
        thread::Builder::new().name("live".into()).spawn(move || {
            // the server's threads inherit this priority
            lower_thread_priority();
            serve(address, history_bytes, &messages);
        })?;
        wait_for(address)?;
        let uri = ProxyUri::new(Origin::from_scheme_and_socket_addr(Scheme::RerunHttp, address)).to_string();
        Ok(Self(Arc::new(LiveServerInner { uri, queue, layouts: Mutex::default() })))
    }

    /// Address for viewers, `rerun+http://127.0.0.1:PORT/proxy`.
    pub fn uri(&self) -> &str {
        &self.0.uri
    }

    /// Number of messages lost because a viewer lagged.
    #[cfg(test)]
    pub(super) fn lost(&self) -> u64 {
        self.0.queue.lost()
    }

    /// The feed for one run whose layout depends on `layout` alone.
    pub(super) fn feed(&self, layout: String) -> MessageSink {
        let mut feed = RunFeed { server: Arc::clone(&self.0), layout, layout_whole: true };
        Box::new(move |message| feed.offer(message))
    }
}

impl fmt::Debug for LiveServer {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_tuple("LiveServer").field(&self.0.uri).finish()
    }
}

struct RunFeed {
    server: Arc<LiveServerInner>,
    layout: String,
    /// False when a part of the layout was dropped.
    layout_whole: bool,
}

impl RunFeed {
    fn offer(&mut self, message: LogMsg) {
        if message.store_id().is_blueprint() {
            self.offer_layout(message);
        } else {
            self.server.queue.send(message).ok();
        }
    }

    /// Sends a layout to the server once; after that it is only selected again.
    fn offer_layout(&mut self, message: LogMsg) {
        let LiveServerInner { queue, layouts, .. } = &*self.server;
        let mut layouts = layouts.lock();
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

/// Passes messages to a server at `address` until all senders are gone. Dropping the sink waits for the slowest viewer,
/// so this thread is never waited for.
fn serve(address: SocketAddr, history_bytes: u64, messages: &Receiver<LogMsg>) {
    let options = ServerOptions {
        playback_behavior: PlaybackBehavior::NewestFirst,
        memory_limit: MemoryLimit::from_bytes(history_bytes),
        cors_allowed_origins: Vec::new(),
    };
    let sink = match GrpcServerSink::new(&address.ip().to_string(), address.port(), options) {
        Ok(sink) => sink,
        Err(fault) => return tracing::error!("there is no live stream at {address}: {fault}"),
    };
    let mut ahead = 0;
    while let Ok(message) = messages.recv() {
        sink.send(message);
        ahead += 1;
        if ahead == MOST_AHEAD {
            ahead = 0;
            if let Err(fault) = sink.flush_blocking(Duration::MAX) {
                return tracing::error!("the live stream at {address} has ended: {fault}");
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
