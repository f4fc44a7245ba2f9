use std::io::ErrorKind;
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, sync_channel};
use std::thread;
use std::time::Duration;

use jiff::Timestamp;
use nix::sys::signal::{SigSet, Signal};
use serde_json::{Value, json};

use super::client::on_one_line;
use crate::cli::args::{Common, ServeArgs};
use crate::cli::output::{Failure, NOT_REACHED, print_json};
use upm_core::time::MonotonicClock;
use upm_runner::config::DaemonSpec;
use upm_runner::run::PaceCheck;
use upm_server::daemon::{
    Daemon, EmergencyStops, ExitReport, NotifyEnv, Prepared, ServiceManager, StartFault, keep_files_private, prepare,
};

/// Longest time allowed for repairs after a crash.
const LONGEST_START: Duration = Duration::from_secs(600);

/// Advice for a computer that does not keep up.
const WHAT_TO_DO: &str =
    "jobs complete all the same; \"pace\": \"max\", fewer plates or a smaller camera frame would do";

const VERSION: &str = env!("CARGO_PKG_VERSION");

pub(crate) fn serve(args: &ServeArgs, common: Common) -> Result<u8, Failure> {
    if args.check {
        return check(args, common);
    }
    keep_files_private();
    let spec = spec_of(args)?;
    let mut prepared = prepare(&spec).map_err(Failure::faults)?;
    let manager = service_manager()?;
    let (stop, shutdown_requested) = stop_signals();
    prepared.shutdown_requested = shutdown_requested;
    manager.extend(LONGEST_START);
    let names = spec.plate_names();
    let daemon = Daemon::start(spec, prepared, MonotonicClock::new(), Timestamp::now, VERSION);
    let daemon = daemon.map_err(start_failure)?;
    let address = daemon.address().map_err(Failure::failed)?;
    attend_sigusr1(daemon.emergency_stop());
    outln!("http://{address}")?;
    tracing::info!(%address, plates = names.join(", "), "upm {VERSION} serves");
    Ok(status(&daemon.serve(&stop, &manager)))
}

/// Reports whether the daemon would start now, in the form in which `upm check` reports on files, and whether this
/// computer keeps up with its plates. A computer that is too slow is not a fault, since jobs complete nevertheless.
fn check(args: &ServeArgs, common: Common) -> Result<u8, Failure> {
    let checked = checked(args);
    let measure = |startable: &Startable| startable.prepared.check_pace(&startable.spec, &MonotonicClock::new());
    let paces = checked.as_ref().map(measure).unwrap_or_default();
    if !common.json {
        outln!("{}: {}", args.config.display(), checked?.says)?;
        paces.iter().try_for_each(|(plate, pace)| outln!("{}", pace_line(plate, pace)))?;
        return Ok(0);
    }
    print_json(&row(&args.config, &checked, &paces))?;
    Ok(checked.map_or_else(|failure| failure.status, |_| 0))
}

/// Result of the checks of a daemon that would start now.
struct Startable {
    /// Summary on one line.
    says: String,
    spec: DaemonSpec,
    prepared: Prepared,
}

fn row(file: &Path, checked: &Result<Startable, Failure>, paces: &[(String, Result<PaceCheck, String>)]) -> Value {
    json!({
        "file": file.display().to_string(),
        "valid": checked.is_ok(),
        "says": checked.as_ref().ok().map(|startable| &startable.says),
        "faults": checked.as_ref().err().map(|failure| &failure.lines),
        "plates": paces.iter().map(|(plate, pace)| pace_row(plate, pace)).collect::<Vec<_>>(),
    })
}

fn checked(args: &ServeArgs) -> Result<Startable, Failure> {
    let spec = spec_of(args)?;
    let prepared = prepare(&spec).map_err(Failure::faults)?;
    let refused = Daemon::refused_addresses(&spec);
    if !refused.is_empty() {
        let lines = refused.iter().map(ToString::to_string).collect();
        return Err(Failure { status: NOT_REACHED, lines });
    }
    let says = format!("daemon on {}, plates: {}", spec.listen, spec.plate_names().join(", "));
    Ok(Startable { says, spec, prepared })
}

/// One line that says whether this computer keeps up with a plate.
fn pace_line(plate: &str, pace: &Result<PaceCheck, String>) -> String {
    let pace = match pace {
        Ok(pace) => pace,
        Err(why) => return on_one_line(&format!("{plate}: pace not measured: {why}")),
    };
    let [p50_ms, p99_ms, period_ms] = [pace.loop_p50_s, pace.loop_p99_s, pace.period_s].map(|s| 1e3 * s);
    let measured = format!("loop time per frame {p50_ms:.1} ms (p50), {p99_ms:.1} ms (p99) of {period_ms:.1} ms");
    if pace.keeps_up() {
        return format!("{plate}: {measured}: keeps up");
    }
    let behind_s = pace.behind_s_per_minute;
    format!("{plate}: {measured}: too slow: falls behind by {behind_s:.1} s per minute; {WHAT_TO_DO}")
}

fn pace_row(plate: &str, pace: &Result<PaceCheck, String>) -> Value {
    match pace {
        Ok(pace) => json!({
            "plate": plate,
            "period_s": pace.period_s,
            "loop_p50_s": pace.loop_p50_s,
            "loop_p99_s": pace.loop_p99_s,
            "behind_s_per_minute": pace.behind_s_per_minute,
            "keeps_up": pace.keeps_up(),
        }),
        Err(why) => json!({ "plate": plate, "why": why }),
    }
}

/// Service manager according to the environment.
fn service_manager() -> Result<ServiceManager, Failure> {
    let text = |name: &str| std::env::var(name).ok();
    let (socket, usec, pid) = (std::env::var_os("NOTIFY_SOCKET"), text("WATCHDOG_USEC"), text("WATCHDOG_PID"));
    let notice = NotifyEnv { socket: socket.as_deref(), watchdog_usec: usec.as_deref(), watchdog_pid: pid.as_deref() };
    ServiceManager::new(notice, std::process::id()).map_err(Failure::bad_input)
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

/// A message for every termination signal, and a flag that stays set from the first one on.
fn stop_signals() -> (Receiver<()>, Arc<AtomicBool>) {
    let (sender, stop) = sync_channel(1);
    let requested = Arc::<AtomicBool>::default();
    let flag = Arc::clone(&requested);
    let handler = move || {
        flag.store(true, Ordering::SeqCst);
        sender.try_send(()).ok();
    };
    if let Err(error) = ctrlc::set_handler(handler) {
        tracing::warn!("signals will not stop the daemon in order: {error}");
    }
    (stop, requested)
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

/// Starts the thread that waits for SIGUSR1.
fn attend_sigusr1(stop: EmergencyStops) {
    let started = thread::Builder::new().name("signals".into()).spawn(move || {
        while sigusr1().wait().is_ok() {
            stop_all_plates(&stop);
        }
    });
    if let Err(error) = started {
        tracing::error!("SIGUSR1 will not stop the plates: {error}");
    }
}

fn stop_all_plates(stop: &EmergencyStops) {
    for stopped in stop.stop_all("SIGUSR1") {
        let (silent, persisted) = stopped.answer.map_or((false, false), |answer| (answer.silent, answer.persisted));
        if silent && persisted {
            tracing::warn!(plate = stopped.plate, "stopped by SIGUSR1: motors silent, on the disk");
        } else {
            tracing::error!(plate = stopped.plate, silent, persisted, "stopped by SIGUSR1, not whole yet");
        }
    }
}

fn start_failure(fault: StartFault) -> Failure {
    match &fault {
        StartFault::Listen(address, error) if error.kind() == ErrorKind::AddrInUse => {
            Failure::failed(format!("{address} is in use: is another daemon running? --listen takes another one"))
        }
        StartFault::OtherStoreVersion(_) => Failure::bad_input(fault),
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

    use super::*;
    use crate::cli::args::LogFormat;
    use crate::cli::output::BAD_INPUT;

    fn pace(behind_s_per_minute: f64) -> PaceCheck {
        PaceCheck { period_s: 1.0 / 60.0, loop_p50_s: 0.0041, loop_p99_s: 0.0212, behind_s_per_minute }
    }

    #[test]
    fn pace_check_reports_whether_the_computer_keeps_up_and_a_remedy() {
        let start = "upm-1: loop time per frame 4.1 ms (p50), 21.2 ms (p99) of 16.7 ms: ";
        assert_eq!(pace_line("upm-1", &Ok(pace(0.2))), format!("{start}keeps up"));
        let slow = pace_line("upm-1", &Ok(pace(12.34)));
        assert_eq!(slow, format!("{start}too slow: falls behind by 12.3 s per minute; {WHAT_TO_DO}"));
        let row = pace_row("upm-1", &Ok(pace(12.34)));
        assert_eq!((&row["keeps_up"], &row["behind_s_per_minute"]), (&json!(false), &json!(12.34)));
        let unmeasured = Err("no room".to_owned());
        assert_eq!(pace_line("upm-1", &unmeasured), "upm-1: pace not measured: no room");
        assert_eq!(pace_row("upm-1", &unmeasured)["why"], "no room");
    }

    fn args(config: &str, listen: SocketAddr) -> ServeArgs {
        let config = Path::new(env!("CARGO_MANIFEST_DIR")).join(config);
        ServeArgs { config, listen: Some(listen), data: None, check: true, log: LogFormat::Text }
    }

    #[test]
    fn check_reports_file_faults_and_an_address_in_use() {
        let free = "127.0.0.1:0".parse().unwrap();
        let good = args("configs/daemon.json", free);
        let checked_good = checked(&good);
        let line = row(&good.config, &checked_good, &[]);
        assert_eq!((&line["valid"], &line["faults"]), (&json!(true), &Value::Null));
        assert!(line["says"].as_str().unwrap().starts_with("daemon on 127.0.0.1:0, plates: upm-1, "), "{line}");

        let other = TcpListener::bind(free).unwrap();
        let taken = other.local_addr().unwrap();
        let failure = checked(&args("configs/daemon.json", taken)).err().unwrap();
        assert_eq!(failure.status, NOT_REACHED, "its files are right");
        assert!(failure.lines[0].starts_with(&format!("{taken}: cannot be listened on: ")), "{failure:?}");

        let bad = args("configs/plus-sign.json", free);
        let checked_bad = checked(&bad);
        let line = row(&bad.config, &checked_bad, &[]);
        assert_eq!((&line["valid"], &line["says"]), (&json!(false), &Value::Null));
        assert!(!line["faults"].as_array().unwrap().is_empty(), "{line}");
        assert_eq!(checked_bad.err().unwrap().status, BAD_INPUT);
    }
}
