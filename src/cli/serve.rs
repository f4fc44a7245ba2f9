use std::io::ErrorKind;
use std::sync::mpsc::{Receiver, sync_channel};
use std::time::Duration;

use jiff::Timestamp;

use super::NOT_REACHED;
use super::args::ServeArgs;
use super::failure::Failure;
use crate::config::DaemonSpec;
use crate::daemon::{Daemon, Ended, Notice, ServiceManager, StartFault, prepare};
use crate::time::MonotonicClock;

/// Time that repairing what a crash left may take.
const LONGEST_START: Duration = Duration::from_secs(600);

const VERSION: &str = env!("CARGO_PKG_VERSION");

pub(super) fn serve(args: &ServeArgs) -> Result<u8, Failure> {
    let spec = spec_of(args)?;
    let prepared = prepare(&spec).map_err(Failure::faults)?;
    if args.check {
        say!("{}: daemon on {}, plates: {}", spec.file, spec.listen, spec.plate_names().join(", "))?;
        return Ok(0);
    }
    let manager = service_manager()?;
    let stop = stop_signals();
    manager.extend(LONGEST_START);
    let names = spec.plate_names();
    let daemon = Daemon::start(spec, prepared, MonotonicClock::new(), Timestamp::now, VERSION);
    let daemon = daemon.map_err(start_failure)?;
    let address = daemon.address().map_err(|error| Failure::failed(error.to_string()))?;
    say!("http://{address}")?;
    tracing::info!(%address, plates = names.join(", "), "upm {VERSION} serves");
    Ok(status(&daemon.serve(&stop, &manager)))
}

/// The service manager that the environment tells of.
fn service_manager() -> Result<ServiceManager, Failure> {
    let text = |name: &str| std::env::var(name).ok();
    let (socket, usec, pid) = (std::env::var_os("NOTIFY_SOCKET"), text("WATCHDOG_USEC"), text("WATCHDOG_PID"));
    let notice = Notice { socket: socket.as_deref(), watchdog_usec: usec.as_deref(), watchdog_pid: pid.as_deref() };
    ServiceManager::new(notice, std::process::id()).map_err(Failure::bad_input)
}

fn spec_of(args: &ServeArgs) -> Result<DaemonSpec, Failure> {
    let mut spec = DaemonSpec::load(&args.config).map_err(Failure::faults)?;
    if let Some(listen) = args.listen {
        spec.listen = listen;
    }
    if let Some(data) = &args.data {
        spec.data.clone_from(data);
    }
    Ok(spec)
}

/// A message for every signal that asks to end.
fn stop_signals() -> Receiver<()> {
    let (sender, stop) = sync_channel(1);
    let handler = move || {
        sender.try_send(()).ok();
    };
    if let Err(error) = ctrlc::set_handler(handler) {
        tracing::warn!("signals will not stop the daemon in order: {error}");
    }
    stop
}

fn start_failure(fault: StartFault) -> Failure {
    match &fault {
        StartFault::Listen(address, error) if error.kind() == ErrorKind::AddrInUse => {
            Failure::failed(format!("{address} is in use: is another daemon running? --listen takes another one"))
        }
        _ => Failure::failed(fault.to_string()),
    }
}

fn status(ended: &Ended) -> u8 {
    let Ended { plates_left, dropped, in_order } = ended;
    if *dropped > 0 {
        tracing::info!(connections = dropped, "dropped at the end");
    }
    if !plates_left.is_empty() {
        tracing::error!(plates = plates_left.join(", "), "did not end in time");
    }
    if *in_order { 0 } else { NOT_REACHED }
}
