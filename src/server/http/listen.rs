use std::io;
use std::sync::Arc;
use std::time::Duration;

use axum::extract::ConnectInfo;
use axum::{Extension, Router};
use hyper::server::conn::http1;
use hyper_util::rt::{TokioIo, TokioTimer};
use hyper_util::server::graceful::GracefulShutdown;
use hyper_util::service::TowerToHyperService;
use socket2::SockRef;
use tokio::net::TcpListener;
use tokio::sync::Semaphore;
use tokio::time::{sleep, timeout};
use tokio_util::sync::CancellationToken;

/// Threads that serve requests.
const WORKERS: usize = 2;

/// Most threads that wait for the store, check jobs and read files.
pub(crate) const BLOCKING_THREADS: usize = 8;

/// Most connections at once; further ones wait in the kernel's queue.
const CONNECTIONS: usize = 512;

/// Longest time until the header of a connection's next request is complete.
const HEADER_TIME: Duration = Duration::from_secs(5);

/// Longest time for which a client may accept no bytes of an answer.
const STALLED_TIME: Duration = Duration::from_secs(20);

/// Largest header, bytes, and most of its lines.
const HEADER_BYTES: usize = 16 << 10;
const HEADER_LINES: usize = 64;

/// Pause after the system could not accept one more connection.
const NO_ROOM_PAUSE: Duration = Duration::from_millis(50);

/// Serves `app` on `listener` until `stop` is cancelled, in its own runtime, each of whose threads begins with
/// `on_thread_start`. Blocks. Requests have the client's address as [`ConnectInfo`]. Those under way then have the time
/// `ending` for their end, whatever clients do. Returns the number of connections dropped because they had not ended by
/// then.
pub fn serve(
    listener: std::net::TcpListener,
    app: Router,
    stop: &CancellationToken,
    ending: Duration,
    on_thread_start: fn(),
) -> io::Result<usize> {
    let runtime = tokio::runtime::Builder::new_multi_thread()
        .worker_threads(WORKERS)
        .max_blocking_threads(BLOCKING_THREADS)
        .thread_name("http")
        .on_thread_start(on_thread_start)
        .enable_all()
        .build()?;
    let served = runtime.block_on(async {
        listener.set_nonblocking(true)?;
        let listener = TcpListener::from_std(listener)?;
        let (places, open) = (Arc::new(Semaphore::new(CONNECTIONS)), GracefulShutdown::new());
        let mut builder = http1::Builder::new();
        builder.timer(TokioTimer::new()).header_read_timeout(HEADER_TIME);
        builder.max_buf_size(HEADER_BYTES).max_headers(HEADER_LINES);
        loop {
            // a connection for which there is no place yet waits in the kernel's queue
            let accepted = async {
                let place = Arc::clone(&places).acquire_owned().await.map_err(io::Error::other)?;
                let (stream, peer) = listener.accept().await?;
                Ok::<_, io::Error>((stream, peer, place))
            };
            let accepted = tokio::select! {
                () = stop.cancelled() => break,
                accepted = accepted => accepted,
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
            let service = TowerToHyperService::new(app.clone().layer(Extension(ConnectInfo(peer))));
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
        Ok::<_, io::Error>(ended.map_or(CONNECTIONS - places.available_permits(), |()| 0))
    });
    runtime.shutdown_background();
    served
}
