use std::collections::HashMap;
use std::fmt;
use std::io;
use std::net::{Ipv4Addr, SocketAddr, TcpListener, TcpStream};
use std::sync::mpsc::Receiver;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::thread;
use std::time::Duration;

use rerun::external::re_log_types::BlueprintActivationCommand;
use rerun::grpc_server::GrpcServerSink;
use rerun::log::LogMsg;
use rerun::sink::LogSink;
use rerun::{MemoryLimit, PlaybackBehavior, ServerOptions};

use super::live::{Feed, LiveQueue};

/// Messages that the server may have before it has taken them in. Its own bound is 128 MiB.
const MOST_AHEAD: usize = 64;

/// Bytes of memory that a history takes for each that the server counts in it. Measured: 1.3 after fifty short runs, 2.1
/// after some hundred.
const TAKEN_PER_COUNTED: u64 = 2;

/// Least history of a server, counted bytes: with none at all it blocks whoever sends.
const LEAST_HISTORY_BYTES: u64 = 1 << 20;

/// How often and how far apart it is tried whether a new server answers.
const KNOCKS: usize = 200;
const KNOCKS_APART: Duration = Duration::from_millis(10);

/// Where Rerun viewers on this machine see the runs of one plate, each run as a recording of its own. It lives as long
/// as the plate; clones are the same server.
///
/// A viewer that lags or is frozen costs the runs nothing: what it does not take is dropped, for all viewers, until the
/// server gives up on it after half a minute. Whoever is on this machine may connect, without a password.
#[derive(Clone)]
pub struct LiveServer(Arc<Serving>);

struct Serving {
    uri: String,
    queue: LiveQueue,
    layouts: Mutex<Layouts>,
}

/// Layouts that the server has, by what they depend on. It forgets none, so one for each run would fill the memory.
#[derive(Default)]
struct Layouts {
    told: HashMap<String, BlueprintActivationCommand>,
    /// The one that viewers show.
    shown: Option<String>,
}

impl LiveServer {
    /// Starts to listen on `port` of the loopback, any free one without it. The newest messages are kept for
    /// viewers that come later, as many as take about `history_bytes` of memory.
    pub fn start(port: Option<u16>, history_bytes: u64) -> io::Result<Self> {
        // a port in use would show only when a run sends
        let address = TcpListener::bind((Ipv4Addr::LOCALHOST, port.unwrap_or(0)))?.local_addr()?;
        let options = ServerOptions {
            playback_behavior: PlaybackBehavior::NewestFirst,
            memory_limit: MemoryLimit::from_bytes((history_bytes / TAKEN_PER_COUNTED).max(LEAST_HISTORY_BYTES)),
            cors_allowed_origins: Vec::new(),
        };
        let sink = GrpcServerSink::new(&address.ip().to_string(), address.port(), options).map_err(io::Error::other)?;
        let uri = sink.uri().to_string();
        let (queue, messages) = LiveQueue::new();
        thread::Builder::new().name("live".into()).spawn(move || serve(&sink, &messages))?;
        wait_for(address)?;
        Ok(Self(Arc::new(Serving { uri, queue, layouts: Mutex::default() })))
    }

    /// What a viewer connects to, `rerun+http://127.0.0.1:PORT/proxy`.
    pub fn uri(&self) -> &str {
        &self.0.uri
    }

    /// Messages that were dropped because a viewer lagged.
    pub fn dropped(&self) -> u64 {
        self.0.queue.dropped()
    }

    /// What feeds it during one run, whose layout depends on nothing but `layout`.
    pub(super) fn feed(&self, layout: String) -> Feed {
        let mut feed = RunFeed { serving: Arc::clone(&self.0), layout, layout_whole: true };
        Box::new(move |message| feed.offer(message))
    }
}

impl fmt::Debug for LiveServer {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_tuple("LiveServer").field(&self.0.uri).finish()
    }
}

struct RunFeed {
    serving: Arc<Serving>,
    layout: String,
    /// False when some of the layout was dropped.
    layout_whole: bool,
}

impl RunFeed {
    fn offer(&mut self, message: LogMsg) {
        if message.store_id().is_blueprint() {
            self.offer_layout(message);
        } else {
            self.serving.queue.offer(message);
        }
    }

    /// A layout goes to the server once; after that it is only shown again.
    fn offer_layout(&mut self, message: LogMsg) {
        let Serving { queue, layouts, .. } = &*self.serving;
        let mut layouts = layouts_of(layouts);
        let told = layouts.told.get(&self.layout).cloned();
        match (message, told) {
            (LogMsg::BlueprintActivationCommand(_), Some(_)) if layouts.shown.as_ref() == Some(&self.layout) => {}
            (LogMsg::BlueprintActivationCommand(_), Some(told)) => {
                if queue.offer(LogMsg::BlueprintActivationCommand(told)) {
                    layouts.shown = Some(self.layout.clone());
                }
            }
            (LogMsg::BlueprintActivationCommand(last), None) => {
                if queue.offer(LogMsg::BlueprintActivationCommand(last.clone())) && self.layout_whole {
                    layouts.told.insert(self.layout.clone(), last);
                    layouts.shown = Some(self.layout.clone());
                }
            }
            (_, Some(_)) => {}
            (message, None) => self.layout_whole &= queue.offer(message),
        }
    }
}

fn layouts_of(layouts: &Mutex<Layouts>) -> MutexGuard<'_, Layouts> {
    layouts.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Hands on what comes until nobody sends any more. When the sink is dropped here it waits for the slowest viewer, so
/// nobody waits for this thread.
fn serve(sink: &GrpcServerSink, messages: &Receiver<LogMsg>) {
    let mut ahead = 0;
    while let Ok(message) = messages.recv() {
        sink.send(message);
        ahead += 1;
        if ahead == MOST_AHEAD {
            ahead = 0;
            if let Err(fault) = sink.flush_blocking(Duration::MAX) {
                tracing::error!("the live stream at {} has ended: {fault}", sink.uri());
                return;
            }
        }
    }
}

/// Waits until the server at `address` answers.
fn wait_for(address: SocketAddr) -> io::Result<()> {
    for _ in 1..KNOCKS {
        if TcpStream::connect(address).is_ok() {
            return Ok(());
        }
        thread::sleep(KNOCKS_APART);
    }
    TcpStream::connect(address).map(drop)
}
