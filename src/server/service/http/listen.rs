use std::collections::VecDeque;
use std::io;
use std::net::SocketAddr;
use std::pin::pin;
use std::sync::Arc;
use std::time::Duration;

use axum::Router;
use axum::body::Body;
use axum::http::Request;
use hyper::body::Incoming;
use hyper::server::conn::http1;
use hyper::service::service_fn;
use hyper_util::rt::{TokioIo, TokioTimer};
use tokio::net::{TcpListener, TcpStream};
use tokio::sync::{OwnedSemaphorePermit, Semaphore};
use tokio::task::{AbortHandle, JoinSet};
use tokio::time::sleep;
use tower::ServiceExt;

use super::descriptors::make_room;
use super::limits::{Limits, Spare};
use super::socket::Socket;
use super::stop::StopFlag;
use upm_core::priority::step_back;

/// Threads that answer.
const WORKERS: usize = 2;

/// Most threads that read files.
const FILE_READERS: usize = 8;

/// Largest header that hyper reads at all, bytes.
const READ_BYTES: usize = 32 << 10;

/// Files that may be open beside connections and what they read: store, run folders, live streams.
const OTHER_FILES: u64 = 256;

/// Rest after the machine had no room for one more connection.
const NO_ROOM_PAUSE: Duration = Duration::from_millis(50);

/// Where a request came from.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(in crate::service) struct Peer(pub SocketAddr);

/// How the server ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Served {
    /// Connections that were dropped because they had not ended in time.
    pub dropped: usize,
}

/// Answers on `listener` with `app` until `stop` is set, in a runtime of its own. Blocks. Returns at the latest
/// `limits.ending_time` after the flag was set, whatever clients do.
pub fn serve(listener: std::net::TcpListener, app: Router, limits: &Limits, stop: &StopFlag) -> io::Result<Served> {
    let wanted = (limits.connections + limits.downloads) as u64 + OTHER_FILES;
    let room = make_room(wanted);
    if room < wanted {
        tracing::warn!("only {room} files may be open at once, {wanted} may be needed: raise `ulimit -n`");
    }
    let runtime = tokio::runtime::Builder::new_multi_thread()
        .worker_threads(WORKERS)
        .max_blocking_threads(FILE_READERS)
        .thread_name("http")
        .on_thread_start(step_back)
        .enable_all()
        .build()?;
    let served = runtime.block_on(accept(listener, app, limits, stop));
    runtime.shutdown_background();
    served
}

async fn accept(listener: std::net::TcpListener, app: Router, limits: &Limits, stop: &StopFlag) -> io::Result<Served> {
    listener.set_nonblocking(true)?;
    let listener = TcpListener::from_std(listener)?;
    let mut connections = Connections::new(app, limits, stop);
    let mut stopped = pin!(stop.stopped());
    loop {
        tokio::select! {
            biased;
            () = &mut stopped => break,
            Some(_) = connections.tasks.join_next() => {}
            accepted = listener.accept() => match accepted {
                Ok((stream, peer)) => connections.open(stream, peer),
                Err(error) => {
                    tracing::warn!(%error, "no connection");
                    sleep(NO_ROOM_PAUSE).await;
                }
            },
        }
    }
    drop(listener);
    Ok(connections.end(limits.ending_time).await)
}

/// The connections that are open. Past a number of them the next ones are spare: they serve e-stop, the list of plates
/// and health, and the oldest of them gives way to one more.
struct Connections<'a> {
    app: Router,
    limits: &'a Limits,
    stop: &'a StopFlag,
    tasks: JoinSet<()>,
    common: Arc<Semaphore>,
    spare: VecDeque<AbortHandle>,
}

impl<'a> Connections<'a> {
    fn new(app: Router, limits: &'a Limits, stop: &'a StopFlag) -> Self {
        let common = limits.connections.saturating_sub(limits.spare_connections);
        let common = Arc::new(Semaphore::new(common));
        Self { app, limits, stop, tasks: JoinSet::new(), common, spare: VecDeque::new() }
    }

    fn open(&mut self, stream: TcpStream, peer: SocketAddr) {
        let _ = stream.set_nodelay(true);
        let permit = self.common.clone().try_acquire_owned().ok();
        let is_spare = permit.is_none();
        if is_spare {
            self.spare.retain(|task| !task.is_finished());
            if self.spare.len() >= self.limits.spare_connections {
                self.spare.pop_front().iter().for_each(AbortHandle::abort);
            }
        }
        let attended = attend(stream, peer, self.app.clone(), self.limits.clone(), permit, self.stop.clone());
        let task = self.tasks.spawn(attended);
        if is_spare {
            self.spare.push_back(task);
        }
    }

    /// Lets all that are open end by themselves for `within`, then drops the rest.
    async fn end(mut self, within: Duration) -> Served {
        tokio::select! {
            biased;
            () = async { while self.tasks.join_next().await.is_some() {} } => {}
            () = sleep(within) => {}
        }
        let dropped = self.tasks.len();
        self.tasks.abort_all();
        Served { dropped }
    }
}

async fn attend(
    stream: TcpStream,
    peer: SocketAddr,
    app: Router,
    limits: Limits,
    permit: Option<OwnedSemaphorePermit>,
    stop: StopFlag,
) {
    let is_spare = permit.is_none();
    let service = service_fn(move |request: Request<Incoming>| {
        let mut request = request.map(Body::new);
        request.extensions_mut().insert(Peer(peer));
        if is_spare {
            request.extensions_mut().insert(Spare);
        }
        app.clone().oneshot(request)
    });
    let mut builder = http1::Builder::new();
    builder
        .timer(TokioTimer::new())
        .header_read_timeout(if is_spare { limits.spare_header_time } else { limits.header_time })
        .max_buf_size(READ_BYTES)
        .keep_alive(!is_spare);
    let socket = TokioIo::new(Socket::new(stream, limits.stalled_time));
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
    drop(permit);
}
