use std::thread::{self, ScopedJoinHandle};
use std::time::Duration;

use serde::Serialize;

use super::client::{Client, ClientRefusal, on_one_line, plate_path};
use super::{jobs, local_stop};
use crate::cli::args::Common;
use crate::cli::client_args::{EstopArgs, ResetArgs, ResumeArgs};
use crate::cli::output::{Failure, NOT_REACHED, print, print_json};
use upm_core::time::{Clock, MonotonicClock};
use upm_server::api::{EStopped, Plate, Plates, ResetRequest};
use upm_server::daemon::LocalStopAnswer;
use upm_server::http::STOP_PATH;

/// Attempts before a stop counts as failed.
const ATTEMPTS: u32 = 3;

/// Pause between two attempts.
const PAUSE: Duration = Duration::from_millis(50);

/// Result of the stop of one plate.
#[derive(Debug, Serialize)]
pub(super) struct Stop {
    pub plate: String,
    /// The answer of the daemon.
    pub answer: Option<EStopped>,
    /// Error message if there is no answer.
    pub error: Option<String>,
    /// `socket` or `http`.
    pub via: &'static str,
    pub attempts: u32,
    /// Time from the first attempt to the answer, s.
    pub wall_s: f64,
    #[serde(skip)]
    status: u8,
}

impl Stop {
    /// Result by the last answer. The exit status is 0 only if the motors are known to be silent and the stop is
    /// stored, so that it outlasts a restart.
    fn of(plate: &str, answer: Result<EStopped, Failure>, via: &'static str, attempts: u32, wall_s: f64) -> Self {
        let is_whole = |answer: &EStopped| answer.silent && answer.persisted;
        let (answer, error, status) = match answer {
            Ok(answer) if is_whole(&answer) => (Some(answer), None, 0),
            Ok(answer) => (Some(answer), None, NOT_REACHED),
            Err(failure) => (None, Some(failure.lines.join("; ")), failure.status),
        };
        Self { plate: plate.to_owned(), answer, error, via, attempts, wall_s, status }
    }
}

pub(super) fn estop(args: &EstopArgs, common: Common) -> Result<u8, Failure> {
    let clock = MonotonicClock::new();
    let local = local_stop::stop(args).map(|stops| (stops, "socket"));
    let stops = match local.or_else(|| Some((stop_at_listener(args)?, "http"))) {
        Some((stops, via)) => {
            let wall_s = clock.elapsed().as_secs_f64();
            let is_unknown = |name: &&String| !stops.iter().any(|stop| stop.plate == **name);
            let refused = || Err(Failure::bad_input("there is no such plate"));
            let unknown = args.plates.iter().filter(is_unknown).map(|name| Stop::of(name, refused(), via, 1, 0.0));
            let unknown: Vec<Stop> = unknown.collect();
            let stopped = |stop: EStopped| Stop::of(&stop.plate.clone(), Ok(stop), via, 1, wall_s);
            stops.into_iter().map(stopped).chain(unknown).collect()
        }
        None => {
            let client = Client::for_stop(&args.daemon)?;
            let names = if args.plates.is_empty() { all_plates(&client)? } else { args.plates.clone() };
            stop_all(&client, &names)
        }
    };
    if common.json {
        print_json(&serde_json::json!({ "stops": stops }))?;
    }
    for stop in &stops {
        report(stop, common)?;
    }
    Ok(stops.iter().map(|stop| stop.status).max().unwrap_or(0))
}

/// Stops every plate through the listener that does nothing else. `None` when plates are named, its address is not
/// known or it does not answer; then the API is asked.
fn stop_at_listener(args: &EstopArgs) -> Option<Vec<EStopped>> {
    let url = args.stop_url.clone().or_else(|| std::env::var("UPM_STOP_URL").ok());
    let url = url.filter(|_| args.plates.is_empty())?;
    let listener = Client::for_stop(&args.daemon).and_then(|client| client.elsewhere(&url));
    let answer = listener.and_then(|client| Ok(client.post::<LocalStopAnswer>(STOP_PATH, "", None)?));
    match answer {
        Ok(answer) => Some(answer.stops),
        Err(failure) => {
            failure.report();
            None
        }
    }
}

/// Names of all plates. If they cannot be read, the failure names other methods to stop.
fn all_plates(client: &Client) -> Result<Vec<String>, Failure> {
    let (listed, _) = with_retries(|| client.get::<Plates>("/v1/plates"));
    let plates = listed.map_err(|mut failure| {
        failure.lines.push("the plates could not be listed, so NOTHING WAS STOPPED: upm estop PLATE...".to_owned());
        failure
    })?;
    Ok(plates.plates.into_iter().map(|plate| plate.name).collect())
}

/// Stops these plates in parallel, so that none waits for another.
pub(super) fn stop_all(client: &Client, names: &[String]) -> Vec<Stop> {
    thread::scope(|scope| {
        let stop = |name| thread::Builder::new().spawn_scoped(scope, move || stop_one(client, name)).ok();
        let threads: Vec<_> = names.iter().map(String::as_str).map(|name| (name, stop(name))).collect();
        let wait = |thread: ScopedJoinHandle<'_, Stop>| thread.join().ok();
        threads
            .into_iter()
            .map(|(name, thread)| thread.and_then(wait).unwrap_or_else(|| stop_one(client, name)))
            .collect()
    })
}

fn stop_one(client: &Client, name: &str) -> Stop {
    let clock = MonotonicClock::new();
    let (answer, attempts) = match plate_path(name) {
        Ok(path) => with_retries(|| client.post::<EStopped>(&format!("{path}/estop"), "", None)),
        Err(failure) => (Err(failure), 0),
    };
    Stop::of(name, answer, "http", attempts, clock.elapsed().as_secs_f64())
}

/// Repeats a request that was refused for a reason that may pass. Every request opens a new connection.
fn with_retries<T>(ask: impl Fn() -> Result<T, ClientRefusal>) -> (Result<T, Failure>, u32) {
    let mut attempts = 1;
    loop {
        match ask() {
            Err(refusal) if refusal.may_pass() && attempts < ATTEMPTS => thread::sleep(PAUSE),
            answer => return (answer.map_err(Failure::from), attempts),
        }
        attempts += 1;
    }
}

fn report(stop: &Stop, common: Common) -> Result<(), Failure> {
    let Stop { plate, answer, error, attempts, wall_s, .. } = stop;
    let plate = on_one_line(plate);
    if let Some(error) = error {
        errln!("upm: {plate}: NOT STOPPED after {attempts} requests: {error}");
    }
    let Some(answer) = answer else { return Ok(()) };
    if !common.json {
        let silent = if answer.silent { "motors silent" } else { "motors NOT YET seen silent" };
        let held = if answer.persisted { "on the disk" } else { "NOT YET on the disk: a restart may lose it" };
        let sounded = answer.wall_s.filter(|&s| s > 0.0);
        let took = sounded.map(|s| format!("zero force after {:.2} ms, ", 1e3 * s)).unwrap_or_default();
        outln!("{plate}: {silent}, {held} ({took}answered after {:.1} ms)", 1e3 * wall_s)?;
    }
    Ok(())
}

pub(super) fn reset(args: &ResetArgs, common: Common) -> Result<u8, Failure> {
    let path = plate_path(&args.plate)?;
    let request = ResetRequest { operator: args.operator.clone(), reason: args.reason.clone() };
    if let Some((member, found, allowed)) = request.fault() {
        return Err(Failure::bad_input(format!("--{member}: expected {allowed}, found {found}")));
    }
    let body = serde_json::to_string(&request).map_err(Failure::failed)?;
    report_plate(&Client::new(&args.daemon)?.post(&format!("{path}/reset"), &body, None)?, common)
}

pub(super) fn resume(args: &ResumeArgs, common: Common) -> Result<u8, Failure> {
    let path = plate_path(&args.plate)?;
    let operator = args.operator.clone().or_else(|| std::env::var("USER").ok()).unwrap_or_default();
    let operator: String = operator.bytes().map(|byte| format!("%{byte:02x}")).collect();
    report_plate(&Client::new(&args.daemon)?.post(&format!("{path}/resume?operator={operator}"), "", None)?, common)
}

fn report_plate(plate: &Plate, common: Common) -> Result<u8, Failure> {
    print(common.json, plate, || outln!("{}", jobs::plate_line(plate)))
}
