use std::io;
use std::net::SocketAddr;
use std::pin::pin;
use std::sync::Arc;

use axum::Router;
use axum::body::Body;
use axum::http::Request;
use bytes::Bytes;
use hyper::body::Incoming;
use hyper::server::conn::http1;
use hyper::service::service_fn;
use hyper_util::rt::{TokioIo, TokioTimer};
use socket2::SockRef;
use tokio::net::TcpStream;
use tokio::runtime::{Handle, Runtime};
use tokio::sync::watch;
use tokio::task::JoinSet;
use tokio::time::{sleep, timeout};
use tower::ServiceExt;

use super::accept::{Acceptor, Serve};
use super::admission::{Busy, CommonConnections, CommonPlace, PeerHost, SpareConnections, SparePlace};
use super::head::read_head;
use super::limits::{HttpLimits, ReservedConnection};
use super::socket::Socket;
use upm_core::thread_priority::lower_thread_priority;

/// Threads that serve requests on common connections.
const WORKERS: usize = 2;

/// Most threads that read files.
const FILE_READERS: usize = 8;

/// Largest header that hyper reads, bytes.
const READ_BYTES: usize = 32 << 10;

/// Open files besides connections and what they read: store, run folders, live streams.
const OTHER_FILES: u64 = 256;

/// Connections that the kernel may queue before they are accepted; its own limit is usually 4096. A client whose
/// connection finds no place repeats it after a second, an emergency stop among a flood as well.
const BACKLOG: i32 = 4096;

/// Most dropped connections whose tasks have not ended. Beyond this none is accepted, since each still holds its files.
const ENDING: usize = 512;

/// Address of the client that sent a request.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Peer(pub SocketAddr);

/// Result of a server's shutdown.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ShutdownReport {
    /// Connections dropped because they had not ended in time.
    pub dropped: usize,
}

/// Shuts the server down, from any thread, without waiting.
#[derive(Clone, Debug)]
pub struct ShutdownSender(Arc<watch::Sender<bool>>);

impl ShutdownSender {
    /// Refuses new connections, answers requests under way and ends event streams, within a time limit.
    pub fn stop(&self) {
        self.0.send_replace(true);
    }
}

/// True once the server is to shut down, or no [`ShutdownSender`] is left.
#[derive(Clone, Debug)]
pub struct ShutdownSignal(watch::Receiver<bool>);

impl ShutdownSignal {
    /// A flag with its sender.
    pub fn new() -> (ShutdownSender, Self) {
        let (sender, receiver) = watch::channel(false);
        (ShutdownSender(Arc::new(sender)), Self(receiver))
    }

    /// Waits until the server is to shut down.
    pub(crate) async fn stopped(&self) {
        let _ = self.0.clone().wait_for(|stop| *stop).await;
    }
}

/// Serves `app` on `listener` until `stop` is set, in its own runtimes. Blocks. Returns within `limits.ending_time`
/// after the flag was set, whatever clients do.
pub fn serve(
    listener: std::net::TcpListener,
    app: Router,
    limits: &HttpLimits,
    stop: &ShutdownSignal,
) -> io::Result<ShutdownReport> {
    // silent connections are as many as spare ones at most
    let connections = limits.connections + 2 * limits.spare_connections;
    let wanted = (connections + ENDING + limits.downloads) as u64 + OTHER_FILES;
    let room = raise_fd_limit(wanted);
    if room < wanted {
        tracing::warn!("only {room} files may be open at once, {wanted} may be needed: raise `ulimit -n`");
    }
    lengthen_backlog(&listener);
    let answering = runtime(WORKERS, lower_thread_priority)?;
    // this thread, which accepts, and the one that serves spare connections keep their priority
    let urgent = runtime(1, || ())?;
    let acceptor = Acceptor::new(listener, limits.spare_connections, limits.header_time)?;
    let (waker, stopped) = (acceptor.shutdown_waker(), stop.clone());
    urgent.spawn(async move {
        stopped.stopped().await;
        waker.wake()
    });
    let handles = Handles { common: answering.handle().clone(), spare: urgent.handle().clone() };
    let mut connections = Connections::new(app, limits, stop, handles);
    let served = acceptor.run(&mut connections).map(|()| urgent.block_on(connections.end()));
    answering.shutdown_background();
    urgent.shutdown_background();
    served
}

fn runtime(workers: usize, on_start: fn()) -> io::Result<Runtime> {
    tokio::runtime::Builder::new_multi_thread()
        .worker_threads(workers)
        .max_blocking_threads(FILE_READERS)
        .thread_name("http")
        .on_thread_start(on_start)
        .enable_all()
        .build()
}

/// Raises the soft limit of open files and sockets to `wanted`, as far as the hard limit allows; returns the limit now.
pub(super) fn raise_fd_limit(wanted: u64) -> u64 {
    use rustix::process::{Resource, Rlimit, getrlimit, setrlimit};

    let limit = getrlimit(Resource::Nofile);
    let present = limit.current.unwrap_or(u64::MAX);
    let most = limit.maximum.unwrap_or(u64::MAX).min(wanted);
    if most <= present {
        return present;
    }
    let raised = Rlimit { current: Some(most), maximum: limit.maximum };
    setrlimit(Resource::Nofile, raised).map_or(present, |()| most)
}

/// Runtimes that serve requests: those of spare connections are separate from all others.
struct Handles {
    common: Handle,
    spare: Handle,
}

/// Lengthens the accept queue. The standard library requests 128 places; when they are taken, a client retries only
/// after a second.
fn lengthen_backlog(listener: &std::net::TcpListener) {
    if let Err(error) = SockRef::from(listener).listen(BACKLOG) {
        tracing::warn!("the backlog of connections stays short: {error}");
    }
}

/// The connections whose client has sent something. One that finds no common place is spare: it serves only the
/// emergency stop, the list of plates and health checks.
struct Connections<'a> {
    app: Router,
    limits: Arc<HttpLimits>,
    stop: &'a ShutdownSignal,
    handles: Handles,
    tasks: JoinSet<()>,
    common: CommonConnections,
    spare: SpareConnections,
}

impl<'a> Connections<'a> {
    fn new(app: Router, limits: &HttpLimits, stop: &'a ShutdownSignal, handles: Handles) -> Self {
        let (common, spare) = (CommonConnections::default(), SpareConnections::default());
        Self { app, limits: Arc::new(limits.clone()), stop, handles, tasks: JoinSet::new(), common, spare }
    }

    /// Lets all open connections end by themselves for `limits.ending_time`, then drops the rest.
    async fn end(mut self) -> ShutdownReport {
        tokio::select! {
            biased;
            () = async { while self.tasks.join_next().await.is_some() {} } => {}
            () = sleep(self.limits.ending_time) => {}
        }
        let dropped = self.tasks.len();
        self.tasks.abort_all();
        ShutdownReport { dropped }
    }
}

impl Serve for Connections<'_> {
    /// False while too many dropped connections have not ended.
    fn may_open(&mut self) -> bool {
        while self.tasks.try_join_next().is_some() {}
        self.tasks.len() < self.limits.connections + self.limits.spare_connections + ENDING
    }

    fn serve(&mut self, stream: std::net::TcpStream, peer: SocketAddr) {
        let host = PeerHost::from(peer.ip());
        let (limits, stop) = (Arc::clone(&self.limits), self.stop.clone());
        let task = ConnectionTask { app: self.app.clone(), limits, stop, peer };
        if let Some(place) = self.common.admit(host, &self.limits) {
            self.tasks.spawn_on(task.serve_common(stream, place), &self.handles.common);
        } else if let Some(place) = self.spare.admit(host, self.limits.spare_connections) {
            let number = place.number;
            let task = self.tasks.spawn_on(task.serve_spare(stream, place), &self.handles.spare);
            self.spare.set_task(host, number, task);
        }
    }
}

/// Everything needed to serve one connection.
struct ConnectionTask {
    app: Router,
    limits: Arc<HttpLimits>,
    stop: ShutdownSignal,
    peer: SocketAddr,
}

impl ConnectionTask {
    /// Serves a common connection until it ends.
    async fn serve_common(self, stream: std::net::TcpStream, place: CommonPlace) {
        let mut builder = http1::Builder::new();
        builder.header_read_timeout(self.limits.header_time);
        self.answer(stream, Bytes::new(), Busy::default(), builder).await;
        drop(place);
    }

    /// Reads the head of the only request of a spare connection, and answers it.
    async fn serve_spare(self, stream: std::net::TcpStream, place: SparePlace) {
        let Ok(stream) = TcpStream::from_std(stream) else { return };
        let (within, most) = (self.limits.spare_header_time, self.limits.header_bytes);
        let head = tokio::select! {
            head = timeout(within, read_head(&stream, most)) => head,
            () = self.stop.stopped() => return,
        };
        let Ok(Ok(head)) = head else { return };
        place.busy.set(true);
        let Ok(stream) = stream.into_std() else { return };
        let mut builder = http1::Builder::new();
        // a head that only this server takes for complete must not keep the place for hyper's 30 s
        builder.keep_alive(false).header_read_timeout(within);
        self.answer(stream, head, place.busy.clone(), builder).await;
        drop(place);
    }

    /// Serves `stream`; `early` holds the bytes read from it before.
    async fn answer(self, stream: std::net::TcpStream, early: Bytes, busy: Busy, mut builder: http1::Builder) {
        let Self { app, limits, stop, peer } = self;
        let Ok(stream) = TcpStream::from_std(stream) else { return };
        let _ = stream.set_nodelay(true);
        let is_spare = !early.is_empty();
        let service = service_fn(move |request: Request<Incoming>| {
            let mut request = request.map(Body::new);
            request.extensions_mut().insert(Peer(peer));
            if is_spare {
                request.extensions_mut().insert(ReservedConnection);
            }
            app.clone().oneshot(request)
        });
        let socket = TokioIo::new(Socket::new(stream, limits.stalled_time, early, busy));
        builder.timer(TokioTimer::new()).max_buf_size(READ_BYTES);
        let mut connection = pin!(builder.serve_connection(socket, service));
        let ended = tokio::select! {
            ended = connection.as_mut() => ended,
            () = stop.stopped() => {
                connection.as_mut().graceful_shutdown();
                connection.await
            }
        };
        if let Err(error) = ended {
            tracing::debug!(%peer, %error, "connection");
        }
    }
}
