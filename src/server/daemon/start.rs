use std::fs;
use std::io;
use std::net::{SocketAddr, TcpListener};
use std::sync::Arc;
use std::sync::mpsc::{Receiver, RecvTimeoutError};
use std::thread::{self, JoinHandle};
use std::time::Duration;

use jiff::Timestamp;
use sd_notify::{NotifyState, notify, watchdog_enabled};

use super::estop_socket::{self, ESTOP_SOCKET, EmergencyStops};
use super::prepare::{Prepared, renew_tokens};
use crate::api::{DaemonState, app, liveness_failures};
use crate::http::{AllowedHosts, Caller, STOP_PATH, joined, serve, serve_stops};
use crate::store::{JobState, RecoveryReport, Store, StoreError};
use crate::supervisor::PlateSupervisor;
use upm_core::background::BackgroundThread;
use upm_core::thread_priority::lower_thread_priority;
use upm_core::time::MonotonicClock;
use upm_runner::config::DaemonSpec;

/// Longest time for plates to end: motors go to zero at once, closing recordings takes a moment.
const PLATES_WITHIN: Duration = Duration::from_millis(1200);
/// Longest time for requests under way to end, in parallel with that.
const REQUESTS_WITHIN: Duration = Duration::from_millis(1300);
/// Longest time for the store to be closed, after both.
const STORE_WITHIN: Duration = Duration::from_millis(400);
/// Interval at which jobs and free space are counted.
const TICK: Duration = Duration::from_millis(500);
/// Ticks from one count of all jobs to the next: that takes as long as there are many.
const TICKS_A_COUNT: u64 = 10;

/// Why a daemon does not start.
#[derive(Debug, thiserror::Error)]
pub enum StartError {
    /// Its job store cannot be opened.
    #[error(transparent)]
    Store(StoreError),
    /// It cannot listen on its address.
    #[error("{0}: cannot be listened on: {1}")]
    Listen(SocketAddr, io::Error),
    /// Plates or threads cannot be started.
    #[error("plates: {0}")]
    Plates(io::Error),
}

/// Result of a daemon's shutdown.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct ExitReport {
    /// Plates that had not ended in time.
    pub plates_left: Vec<String>,
    /// Connections dropped because they had not ended in time.
    pub dropped: usize,
    /// True when everything is on the disk; otherwise the next start is a recovery after a crash.
    pub in_order: bool,
}

/// A daemon whose plates are ready and that listens, but does not answer requests yet.
#[derive(Debug)]
pub struct Daemon {
    pub(super) state: Arc<DaemonState>,
    listener: TcpListener,
}

impl Daemon {
    /// Faults of listening now on its addresses; empty when all are free. Binds each for a moment.
    pub fn refused_addresses(spec: &DaemonSpec) -> Vec<StartError> {
        let own = std::iter::once(spec.listen).chain(spec.stop_listen);
        own.filter_map(|address| listener_at(address).err()).collect()
    }

    /// Binds its ports, opens the store, recovers the state that the previous daemon left and creates the plates.
    /// Requests wait until [`Self::serve`]. Plates that need an operator's consent stay still.
    pub fn start(
        spec: DaemonSpec,
        prepared: Prepared,
        clock: MonotonicClock,
        now: fn() -> Timestamp,
        version: &'static str,
    ) -> Result<Self, StartError> {
        // before anything is changed: a port in use must not disturb the daemon that holds the data
        let listener = listener_at(spec.listen)?;
        let stop_listener = spec.stop_listen.map(listener_at).transpose()?;
        let opened = Store::open(&spec.data, &spec.plate_names(), spec.queue, spec.keep.clone(), now);
        let (store, recovery) = opened.map_err(StartError::Store)?;
        let store = Arc::new(store);
        let plates = PlateSupervisor::start(&spec, prepared.libraries, &store, &recovery, clock);
        let plates = plates.map_err(StartError::Plates)?;
        log_recovery(&recovery, &store, &spec);
        let state = DaemonState::new(spec, store, plates, prepared.tokens, clock, version);
        let state = Arc::new(state.map_err(StartError::Plates)?);
        let stop = EmergencyStops(Arc::clone(&state));
        let port = listener.local_addr().map(|address| address.port());
        if let Err(error) = port.and_then(|port| estop_socket::listen(&state.spec.data, port, &stop)) {
            // only logged: HTTP and SIGUSR1 stop the plates, too
            tracing::error!("{}: {error}", state.spec.data.join(ESTOP_SOCKET).display());
        }
        if let Some(stop_listener) = stop_listener {
            take_stops(stop_listener, &state).map_err(StartError::Plates)?;
        }
        Ok(Self { state, listener })
    }

    /// A handle that stops its plates without the network.
    pub fn emergency_stop(&self) -> EmergencyStops {
        EmergencyStops(Arc::clone(&self.state))
    }

    /// Address it listens on.
    pub fn address(&self) -> io::Result<SocketAddr> {
        self.listener.local_addr()
    }

    /// Serves until `stop` receives a message or is disconnected, then shuts down within two seconds, whatever clients
    /// do; motors go to zero first. The service manager is notified when the daemon is ready, alive and shutting down.
    pub fn serve(self, stop: &Receiver<()>) -> ExitReport {
        let Self { state, listener } = self;
        // on another thread until the daemon ends
        let (app, ending) = (app(Arc::clone(&state)), state.ending.clone());
        let answering = thread::spawn(move || serve(listener, app, &ending, REQUESTS_WITHIN, lower_thread_priority));
        if let Err(error) = start_counting(&state) {
            tracing::error!("jobs are not counted: {error}");
        }
        let plates = format!("plates: {}", state.spec.plate_names().join(", "));
        notify_manager(&[NotifyState::Ready, NotifyState::Status(&plates)]);
        if let Err(error) = keep_alive(&state) {
            tracing::error!("the service manager gets no signs of life: {error}");
        }
        while !answering.is_finished() && stop.recv_timeout(TICK) == Err(RecvTimeoutError::Timeout) {}
        end(&state, answering)
    }
}

/// Logs the state that the previous daemon left, and jobs queued for plates that are no longer configured: they can be
/// cancelled, or the plate configured again.
fn log_recovery(recovery: &RecoveryReport, store: &Store, spec: &DaemonSpec) {
    let RecoveryReport { interrupted, ended, paused, clean, .. } = recovery;
    if !clean {
        tracing::warn!(interrupted = interrupted.len(), ended = ended.len(), "the last daemon did not end in order");
    }
    for (plate, _) in paused {
        tracing::warn!(plate, "paused: nothing moves before `upm resume {plate}`");
    }
    for (plate, _, jobs) in store.counts(Some(JobState::Queued)).unwrap_or_default() {
        if spec.plate(&plate).is_none() {
            tracing::warn!(plate, jobs, "jobs wait for a plate that is not served");
        }
    }
}

/// Starts the thread that counts jobs and free space and renews tokens until the daemon ends. A disk that hangs holds
/// this thread alone.
fn start_counting(state: &Arc<DaemonState>) -> io::Result<()> {
    let state = Arc::clone(state);
    let count = move || {
        lower_thread_priority();
        let mut faults = Vec::new();
        for tick in 0_u64.. {
            if state.ending.is_cancelled() {
                break;
            }
            state.count(tick.is_multiple_of(TICKS_A_COUNT));
            faults = renew_tokens(&state.spec, &state.tokens, &faults);
            thread::sleep(TICK);
        }
    };
    thread::Builder::new().name("count".into()).spawn(count).map(|_| ())
}

/// Shuts down, each part within its time: plates and requests in parallel, then the store.
fn end(state: &Arc<DaemonState>, answering: JoinHandle<io::Result<usize>>) -> ExitReport {
    state.ending.cancel();
    // motors to zero before anything is reported: logging may take a while
    state.plates.shutdown(Duration::ZERO);
    tracing::info!("shutting down");
    notify_manager(&[NotifyState::Stopping, NotifyState::Status("ending")]);
    let plates_left = state.plates.shutdown(PLATES_WITHIN);
    tracing::debug!("plates have ended");
    let served = answering.join().unwrap_or_else(|_| Err(io::Error::other("the server panicked")));
    if let Err(error) = &served {
        tracing::error!("the server ended: {error}");
    }
    tracing::debug!("requests have ended");
    // while the folder is locked: after that the socket may be the next daemon's
    fs::remove_file(state.spec.data.join(ESTOP_SOCKET)).ok();
    let daemon = Arc::clone(state);
    let persisted = BackgroundThread::start("persist", false, move || daemon.plates.persist_again())
        .is_ok_and(|thread| thread.wait_within(STORE_WITHIN).unwrap_or(false));
    // an end that is not recorded makes the next start one after a crash: every plate is paused
    let in_order = persisted && state.store.close(STORE_WITHIN) && plates_left.is_empty();
    tracing::debug!(in_order, "the store is closed");
    ExitReport { plates_left, dropped: served.unwrap_or(0), in_order }
}

/// Takes emergency stops on the port that has nothing else.
fn take_stops(listener: TcpListener, state: &Arc<DaemonState>) -> io::Result<()> {
    let (address, stop) = (listener.local_addr()?, EmergencyStops(Arc::clone(state)));
    let hosts = AllowedHosts::new(address, &state.spec.hosts).with_page(state.spec.listen);
    let cut = stop.clone();
    let answer = move |caller: &Caller| stop.stop(&[], caller);
    serve_stops(listener, hosts, Arc::clone(&state.tokens), move || cut.cut(), answer)?;
    tracing::info!("emergency stops: POST http://{address}{STOP_PATH}");
    Ok(())
}

fn listener_at(address: SocketAddr) -> Result<TcpListener, StartError> {
    TcpListener::bind(address).map_err(|error| StartError::Listen(address, error))
}

/// Starts a thread that sends signs of life, twice in the manager's watchdog interval and only while the daemon is
/// healthy, and says when their absence has a reason. None where the manager expects none. A manager that does not read
/// holds this thread alone.
fn keep_alive(state: &Arc<DaemonState>) -> io::Result<()> {
    let Some(interval) = watchdog_enabled().filter(|interval| !interval.is_zero()) else { return Ok(()) };
    let state = Arc::clone(state);
    let ping = move || {
        let mut before = Vec::new();
        while !state.ending.is_cancelled() {
            let failures = liveness_failures(&state.observed());
            if failures.is_empty() {
                notify_manager(&[NotifyState::Watchdog]);
            }
            if failures != before {
                let status = if failures.is_empty() { "healthy again".to_owned() } else { joined(&failures) };
                tracing::warn!("state reported to the service manager: {status}");
                // a line feed would begin another message
                notify_manager(&[NotifyState::Status(&status.replace(char::is_control, " "))]);
            }
            before = failures;
            thread::sleep(interval / 2);
        }
    };
    thread::Builder::new().name("alive".into()).spawn(ping).map(|_| ())
}

/// Sends a message. A failure is only logged: a service manager that does not listen must not stop the daemon.
fn notify_manager(message: &[NotifyState<'_>]) {
    if let Err(error) = notify(message) {
        tracing::warn!(%error, "could not notify the service manager");
    }
}

#[cfg(test)]
mod tests {
    use std::net::Ipv4Addr;
    use std::path::Path;

    use super::*;

    #[test]
    fn addresses_in_use_are_reported() {
        let taken = || TcpListener::bind((Ipv4Addr::LOCALHOST, 0)).unwrap();
        let (first, second) = (taken(), taken());
        let [listen, stop] = [&first, &second].map(|listener| listener.local_addr().unwrap());
        let refused = |spec: &DaemonSpec| -> Vec<SocketAddr> {
            let address = |fault| match fault {
                StartError::Listen(address, error) if error.kind() == io::ErrorKind::AddrInUse => address,
                other => panic!("{other}"),
            };
            Daemon::refused_addresses(spec).into_iter().map(address).collect()
        };
        let file = Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../..")).join("configs/daemon.json");
        let mut spec = DaemonSpec { listen, stop_listen: Some(stop), ..DaemonSpec::load(&file).unwrap() };
        assert_eq!(refused(&spec), [listen, stop]);
        spec.stop_listen = None;
        assert_eq!(refused(&spec), [listen]);
        spec.listen.set_port(0);
        assert!(refused(&spec).is_empty());
    }
}
