use std::io;
use std::net::SocketAddr;
use std::sync::Arc;
use std::time::Duration;

use axum::{Extension, Router};
use hyper::server::conn::http1;
use hyper_util::rt::{TokioIo, TokioTimer};
use hyper_util::server::graceful::GracefulShutdown;
use hyper_util::service::TowerToHyperService;
use socket2::SockRef;
use tokio::net::{TcpListener, TcpStream};
use tokio::sync::{OwnedSemaphorePermit, Semaphore, watch};
use tokio::time::{sleep, timeout};

use upm_core::thread_priority::lower_thread_priority;

/// Threads that serve requests.
const WORKERS: usize = 2;

/// Most threads that read files.
const FILE_READERS: usize = 8;

/// Most connections at once; further ones wait in the kernel's queue.
const CONNECTIONS: usize = 512;

/// Longest time until the header of a connection's next request is complete.
const HEADER_TIME: Duration = Duration::from_secs(5);

/// Longest time for which a client may accept no bytes of an answer.
const STALLED_TIME: Duration = Duration::from_secs(20);

/// Largest header that hyper reads, bytes.
const READ_BYTES: usize = 32 << 10;

/// Pause after the system could not accept one more connection.
const NO_ROOM_PAUSE: Duration = Duration::from_millis(50);

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

/// Serves `app` on `listener` until `stop` is set, in its own runtime. Blocks. Requests under way then have the time
/// `ending` for their end, whatever clients do.
pub fn serve(
    listener: std::net::TcpListener,
    app: Router,
    stop: &ShutdownSignal,
    ending: Duration,
) -> io::Result<ShutdownReport> {
    let runtime = tokio::runtime::Builder::new_multi_thread()
        .worker_threads(WORKERS)
        .max_blocking_threads(FILE_READERS)
        .thread_name("http")
        .on_thread_start(lower_thread_priority)
        .enable_all()
        .build()?;
    let served = runtime.block_on(serve_until_stopped(listener, app, stop, ending));
    runtime.shutdown_background();
    served
}

async fn serve_until_stopped(
    listener: std::net::TcpListener,
    app: Router,
    stop: &ShutdownSignal,
    ending: Duration,
) -> io::Result<ShutdownReport> {
    listener.set_nonblocking(true)?;
    let listener = TcpListener::from_std(listener)?;
    let (places, open) = (Arc::new(Semaphore::new(CONNECTIONS)), GracefulShutdown::new());
    let mut builder = http1::Builder::new();
    builder.timer(TokioTimer::new()).header_read_timeout(HEADER_TIME).max_buf_size(READ_BYTES);
    loop {
        let accepted = tokio::select! {
            () = stop.stopped() => break,
            accepted = accept(&listener, &places) => accepted,
        };
        let (stream, peer, place) = match accepted {
            Ok(accepted) => accepted,
            Err(error) => {
                tracing::warn!(%error, "cannot accept a connection");
                sleep(NO_ROOM_PAUSE).await;
                continue;
            }
        };
        let _ = stream.set_nodelay(true);
        let _ = SockRef::from(&stream).set_tcp_user_timeout(Some(STALLED_TIME));
        let service = TowerToHyperService::new(app.clone().layer(Extension(Peer(peer))));
        let connection = open.watch(builder.serve_connection(TokioIo::new(stream), service));
        tokio::spawn(async move {
            if let Err(error) = connection.await {
                tracing::debug!(%peer, %error, "connection");
            }
            drop(place);
        });
    }
    drop(listener);
    let ended = timeout(ending, open.shutdown()).await;
    Ok(ShutdownReport { dropped: ended.map_or(CONNECTIONS - places.available_permits(), |()| 0) })
}

/// The next connection, once there is a place for it. Until then it waits in the kernel's queue.
async fn accept(
    listener: &TcpListener,
    places: &Arc<Semaphore>,
) -> io::Result<(TcpStream, SocketAddr, OwnedSemaphorePermit)> {
    let place = Arc::clone(places).acquire_owned().await.map_err(io::Error::other)?;
    let (stream, peer) = listener.accept().await?;
    Ok((stream, peer, place))
}
