use std::io::ErrorKind;
use std::sync::mpsc::sync_channel;

use jiff::Timestamp;
use nix::sys::signal::{SigSet, Signal};

use crate::cli::args::{Common, ServeArgs};
use crate::cli::check::{ValidFile, show};
use crate::cli::output::{Failure, NOT_REACHED};
use crate::cli::signals;
use upm_core::time::MonotonicClock;
use upm_runner::config::DaemonSpec;
use upm_server::api::EStopped;
use upm_server::daemon::{Daemon, EmergencyStops, ExitReport, StartError, StoreError, keep_files_private, prepare};

const VERSION: &str = env!("CARGO_PKG_VERSION");

pub(crate) fn serve(args: &ServeArgs, common: Common) -> Result<u8, Failure> {
    if args.check {
        return check(args, common);
    }
    keep_files_private();
    let spec = spec_of(args)?;
    let prepared = prepare(&spec).map_err(Failure::faults)?;
    let (sender, stop) = sync_channel(1);
    signals::attend(signals::ending(), move || {
        sender.try_send(()).ok();
    });
    let (names, base_path) = (spec.plate_names(), spec.base_path.clone());
    let daemon = Daemon::start(spec, prepared, MonotonicClock::new(), Timestamp::now, VERSION);
    let daemon = daemon.map_err(start_failure)?;
    let address = daemon.address().map_err(Failure::failed)?;
    attend_sigusr1(daemon.emergency_stop());
    outln!("http://{address}{base_path}")?;
    tracing::info!(%address, plates = names.join(", "), "upm {VERSION} serves");
    Ok(status(&daemon.serve(&stop)))
}

/// Reports whether the daemon would start now, in the form in which `upm check` reports on files.
fn check(args: &ServeArgs, common: Common) -> Result<u8, Failure> {
    let checked = checked(args);
    let status = checked.as_ref().map_or_else(|failure| failure.status, |_| 0);
    let finding = checked.map(ValidFile::new).map_err(|failure| failure.lines);
    show(&[(&args.config, finding)], common)?;
    Ok(status)
}

/// Summary on one line of a daemon that would start now.
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

fn spec_of(args: &ServeArgs) -> Result<DaemonSpec, Failure> {
    let mut spec = DaemonSpec::load(&args.config).map_err(Failure::of_files)?;
    if let Some(listen) = args.listen {
        spec.listen = listen;
    }
    if let Some(data) = &args.data {
        spec.data.clone_from(data);
    }
    Ok(spec)
}

/// Blocks SIGUSR1, which stops every plate, in this thread and in those that it starts. Called before there is a second
/// thread, so that it does not end the process; an early signal stays pending for [`attend_sigusr1`].
pub(crate) fn hold_back_sigusr1() {
    if let Err(error) = sigusr1().thread_block() {
        errln!("upm: SIGUSR1 will not stop the plates: {error}");
    }
}

fn sigusr1() -> SigSet {
    [Signal::SIGUSR1].into_iter().collect()
}

/// Stops every plate when SIGUSR1 comes.
fn attend_sigusr1(stop: EmergencyStops) {
    signals::attend(sigusr1(), move || {
        for EStopped { plate, silent, persisted, .. } in stop.stop_all("SIGUSR1") {
            if silent && persisted {
                tracing::warn!(plate, "stopped by SIGUSR1: motors silent, on the disk");
            } else {
                tracing::error!(plate, silent, persisted, "stopped by SIGUSR1, not whole yet");
            }
        }
    });
}

fn start_failure(fault: StartError) -> Failure {
    match &fault {
        StartError::Listen(address, error) if error.kind() == ErrorKind::AddrInUse => {
            Failure::failed(format!("{address} is in use: is another daemon running? --listen takes another one"))
        }
        StartError::Store(StoreError::Other { .. }) => Failure::bad_input(fault),
        _ => Failure::failed(fault),
    }
}

fn status(ended: &ExitReport) -> u8 {
    let ExitReport { plates_left, dropped, in_order } = ended;
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
    use std::path::Path;

    use super::*;
    use crate::cli::args::LogFormat;
    use crate::cli::output::BAD_INPUT;

    fn args(config: &str, listen: SocketAddr) -> ServeArgs {
        let config = Path::new(env!("CARGO_MANIFEST_DIR")).join(config);
        ServeArgs { config, listen: Some(listen), data: None, check: true, trace: None, log: LogFormat::Text }
    }

    #[test]
    fn check_reports_file_faults_and_an_address_in_use() {
        let free = "127.0.0.1:0".parse().unwrap();
        let says = checked(&args("configs/daemon.json", free)).unwrap();
        assert!(says.starts_with("daemon on 127.0.0.1:0, plates: upm-1, "), "{says}");

        let other = TcpListener::bind(free).unwrap();
        let taken = other.local_addr().unwrap();
        let failure = checked(&args("configs/daemon.json", taken)).err().unwrap();
        assert_eq!(failure.status, NOT_REACHED, "its files are right");
        assert!(failure.lines[0].starts_with(&format!("{taken}: cannot be listened on: ")), "{failure:?}");

        let failure = checked(&args("configs/plus-sign.json", free)).err().unwrap();
        assert_eq!(failure.status, BAD_INPUT);
    }
}
