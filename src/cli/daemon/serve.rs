use std::io::ErrorKind;
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, sync_channel};
use std::time::Duration;

use jiff::Timestamp;
use serde_json::{Value, json};

use super::signals;
use crate::cli::args::{Common, ServeArgs};
use crate::cli::failure::Failure;
use crate::cli::{NOT_REACHED, print_json};
use upm_core::time::MonotonicClock;
use upm_runner::config::DaemonSpec;
use upm_server::daemon::{Daemon, Ended, Notice, ServiceManager, StartFault, prepare};

/// Time that repairing what a crash left may take.
const LONGEST_START: Duration = Duration::from_secs(600);

const VERSION: &str = env!("CARGO_PKG_VERSION");

pub(in crate::cli) fn serve(args: &ServeArgs, common: Common) -> Result<u8, Failure> {
    if args.check {
        return check(args, common);
    }
    let spec = spec_of(args)?;
    let mut prepared = prepare(&spec).map_err(Failure::faults)?;
    let manager = service_manager()?;
    let (stop, told_to_end) = stop_signals();
    prepared.told_to_end = told_to_end;
    manager.extend(LONGEST_START);
    let names = spec.plate_names();
    let daemon = Daemon::start(spec, prepared, MonotonicClock::new(), Timestamp::now, VERSION);
    let daemon = daemon.map_err(start_failure)?;
    let address = daemon.address().map_err(|error| Failure::failed(error.to_string()))?;
    signals::attend(daemon.emergency_stop(), daemon.token_reload());
    say!("http://{address}")?;
    tracing::info!(%address, plates = names.join(", "), "upm {VERSION} serves");
    Ok(status(&daemon.serve(&stop, &manager)))
}

/// Tells whether the daemon would start now, in the form in which `upm check` tells of files.
fn check(args: &ServeArgs, common: Common) -> Result<u8, Failure> {
    let checked = checked(args);
    if !common.json {
        say!("{}: {}", args.config.display(), checked?)?;
        return Ok(0);
    }
    print_json(&row(&args.config, &checked))?;
    Ok(checked.map_or_else(|failure| failure.status, |_| 0))
}

fn row(file: &Path, checked: &Result<String, Failure>) -> Value {
    json!({
        "file": file,
        "valid": checked.is_ok(),
        "says": checked.as_ref().ok(),
        "faults": checked.as_ref().err().map(|failure| &failure.lines),
    })
}

/// A line about the daemon that would start.
fn checked(args: &ServeArgs) -> Result<String, Failure> {
    let spec = spec_of(args)?;
    prepare(&spec).map_err(Failure::faults)?;
    let refused = Daemon::refused_addresses(&spec);
    if !refused.is_empty() {
        let lines = refused.iter().map(ToString::to_string).collect();
        return Err(Failure { status: NOT_REACHED, lines });
    }
    Ok(format!("daemon on {}, plates: {}", spec.listen, spec.plate_names().join(", ")))
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

/// A message for every signal that asks to end, and a flag that stays set from the first one on.
fn stop_signals() -> (Receiver<()>, Arc<AtomicBool>) {
    let (sender, stop) = sync_channel(1);
    let told = Arc::<AtomicBool>::default();
    let flag = Arc::clone(&told);
    let handler = move || {
        flag.store(true, Ordering::SeqCst);
        sender.try_send(()).ok();
    };
    if let Err(error) = ctrlc::set_handler(handler) {
        tracing::warn!("signals will not stop the daemon in order: {error}");
    }
    (stop, told)
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

#[cfg(test)]
mod tests {
    use std::net::{SocketAddr, TcpListener};

    use super::*;
    use crate::cli::BAD_INPUT;
    use crate::cli::logs::LogFormat;

    fn args(config: &str, listen: SocketAddr) -> ServeArgs {
        let config = Path::new(env!("CARGO_MANIFEST_DIR")).join(config);
        ServeArgs { config, listen: Some(listen), data: None, check: true, log: LogFormat::Text }
    }

    #[test]
    fn a_check_tells_of_the_file_and_of_an_address_that_another_has() {
        let free = "127.0.0.1:0".parse().unwrap();
        let good = args("configs/daemon.json", free);
        let checked_good = checked(&good);
        let told = row(&good.config, &checked_good);
        assert_eq!((&told["valid"], &told["faults"]), (&json!(true), &Value::Null));
        assert!(told["says"].as_str().unwrap().starts_with("daemon on 127.0.0.1:0, plates: upm-1, "), "{told}");

        let other = TcpListener::bind(free).unwrap();
        let taken = other.local_addr().unwrap();
        let failure = checked(&args("configs/daemon.json", taken)).unwrap_err();
        assert_eq!(failure.status, NOT_REACHED, "its files are right");
        assert!(failure.lines[0].starts_with(&format!("{taken}: cannot be listened on: ")), "{failure:?}");

        let bad = args("configs/plus-sign.json", free);
        let checked_bad = checked(&bad);
        let told = row(&bad.config, &checked_bad);
        assert_eq!((&told["valid"], &told["says"]), (&json!(false), &Value::Null));
        assert!(!told["faults"].as_array().unwrap().is_empty(), "{told}");
        assert_eq!(checked_bad.unwrap_err().status, BAD_INPUT);
    }
}
