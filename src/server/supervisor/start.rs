use std::io;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, AtomicUsize, Ordering};
use std::thread::{self, JoinHandle};
use std::time::Duration;

use parking_lot::Mutex;

use super::current_job::CurrentJob;
use super::emergency_stop::EmergencyStop;
use super::latch::{Latch, make_folder};
use super::plate::PlateHandle;
use super::preview::FramePreview;
use super::shared::PlateInner;
use super::standing::Standing;
use super::validate::JobRules;
use super::watchdog::{TICK, Watchdog, ms};
use super::worker::PlateWorker;
use super::{PlateSetup, SharedServices};
use upm_core::rig::Interlock;
use upm_core::time::{Clock, MonotonicClock};
use upm_runner::config::WatchdogSpec;
use upm_viewer::LiveServer;

/// Longest time since the last check of a watchdog that is alive.
const WATCHDOG_INTERVAL_LIMIT: Duration = Duration::from_secs(1);

/// All plates of the daemon.
#[derive(Debug)]
pub struct PlateSupervisor {
    plates: Vec<PlateHandle>,
    clock: MonotonicClock,
    watchdog: JoinHandle<()>,
    /// Time of the watchdog's last check, ms.
    looked_ms: Arc<AtomicU64>,
}

impl PlateSupervisor {
    /// Creates the plates and starts their threads. A plate whose latch is stopped stays stopped.
    pub fn start(setups: Vec<PlateSetup>, around: &SharedServices) -> io::Result<Self> {
        make_folder(&around.latches)?;
        let clock = around.clock;
        let mut plates = Vec::new();
        for setup in setups {
            plates.push(plate(Arc::new(shared(setup, around)?), around)?);
        }
        let looked_ms = Arc::new(AtomicU64::new(ms(clock.elapsed())));
        let watch = PlatesWatch {
            plates: plates.iter().map(|plate| Arc::clone(&plate.shared)).collect(),
            spec: around.watchdog,
            clock,
            looked_ms: Arc::clone(&looked_ms),
        };
        let watchdog = thread::Builder::new().name("watchdog".into()).spawn(move || watch.run())?;
        Ok(Self { plates, clock, watchdog, looked_ms })
    }

    /// The plate of that name.
    pub fn get(&self, name: &str) -> Option<&PlateHandle> {
        self.plates.iter().find(|plate| plate.name() == name)
    }

    /// All plates, in the order of `setups`.
    pub fn iter(&self) -> impl Iterator<Item = &PlateHandle> {
        self.plates.iter()
    }

    /// Writes the stops and pauses that could not be written; false when one still is not on the disk.
    pub fn persist_again(&self) -> bool {
        // of every plate, also after one that fails
        self.plates.iter().filter(|plate| !plate.persist_again()).count() == 0
    }

    /// `Ok` while the watchdog checks and every plate's threads run; otherwise a sentence that says which do not.
    pub fn alive(&self) -> Result<(), String> {
        let unchecked =
            self.clock.elapsed().saturating_sub(Duration::from_millis(self.looked_ms.load(Ordering::Relaxed)));
        if self.watchdog.is_finished() || unchecked > WATCHDOG_INTERVAL_LIMIT {
            return Err(format!("the watchdog thread has not run for {:.1} s", unchecked.as_secs_f64()));
        }
        let dead = self.plates.iter().find(|plate| plate.has_ended());
        dead.map_or(Ok(()), |plate| Err(format!("the worker of plate {} has died", plate.name())))
    }

    /// Shuts all plates down: motors to zero, runs ended as interrupted, threads ended. Waits at most `within`; returns
    /// the names of the plates that did not end in time.
    pub fn shutdown(&self, within: Duration) -> Vec<String> {
        for plate in &self.plates {
            plate.shared.shut_down();
            plate.wake();
        }
        let until = self.clock.elapsed() + within;
        let busy = |plate: &&PlateHandle| !plate.has_ended();
        let busy_still = || self.plates.iter().any(|plate| busy(&plate)) || !self.watchdog.is_finished();
        while busy_still() && self.clock.elapsed() < until {
            thread::sleep(Duration::from_millis(2));
        }
        self.plates.iter().filter(busy).map(|plate| plate.name().to_owned()).collect()
    }
}

/// The thread of the watchdog.
struct PlatesWatch {
    plates: Vec<Arc<PlateInner>>,
    spec: WatchdogSpec,
    clock: MonotonicClock,
    looked_ms: Arc<AtomicU64>,
}

impl PlatesWatch {
    /// Watches all plates until they end.
    fn run(self) {
        let Self { plates, spec, clock, looked_ms } = self;
        let watchdog = |shared: &PlateInner| Watchdog::with_camera(spec, shared.rules.rig.model.frame_hz);
        let mut watched: Vec<(Arc<PlateInner>, Watchdog)> =
            plates.into_iter().map(|shared| (Arc::clone(&shared), watchdog(&shared))).collect();
        while !watched.iter().all(|(shared, _)| shared.ending.load(Ordering::SeqCst)) {
            for (shared, watchdog) in &mut watched {
                let Some((job, journal)) = shared.job.driven() else {
                    watchdog.rest();
                    continue;
                };
                if let Some(why) = watchdog.check(clock.elapsed(), &shared.job.heartbeat, journal.waits_since()) {
                    shared.fail_job(&job, why);
                }
            }
            looked_ms.store(ms(clock.elapsed()), Ordering::Relaxed);
            thread::sleep(TICK);
        }
    }
}

/// The live stream of a plate, if one is configured. The plate also works without it.
fn live(setup: &PlateSetup, around: &SharedServices) -> Option<LiveServer> {
    let history_bytes = around.live_history_bytes?;
    let fault = match LiveServer::start(setup.live_port, history_bytes) {
        Ok(live) => {
            tracing::info!(plate = setup.name, "live stream at {}", live.uri());
            return Some(live);
        }
        Err(fault) => fault,
    };
    let port = setup.live_port.map_or_else(|| "any port".to_owned(), |port| format!("port {port}"));
    tracing::error!(plate = setup.name, "there is no live stream on {port}: {fault}");
    None
}

/// The shared state of a plate at its start, without a job.
fn shared(setup: PlateSetup, around: &SharedServices) -> io::Result<PlateInner> {
    let rules = JobRules::new(&setup);
    let standing = setup.standing.as_ref().map(|standing| Standing::new(standing, &rules)).transpose()?;
    let job = CurrentJob::default();
    let latch = Latch::open(&around.latches, &setup.name, setup.known)?;
    let interlock = Interlock::timed(Arc::new(around.clock));
    Ok(PlateInner {
        live: live(&setup, around),
        name: setup.name,
        rules,
        store: Arc::clone(&around.store),
        emergency_stop: EmergencyStop::new(latch, interlock, Arc::clone(&job.end_run)),
        job,
        ending: AtomicBool::new(false),
        preview: FramePreview::default(),
        standing,
        paused: Mutex::new(setup.paused),
        pausing: Mutex::default(),
        unnoted: Mutex::default(),
        recorders: AtomicUsize::new(0),
        #[cfg(test)]
        idled: AtomicU64::new(0),
    })
}

fn plate(shared: Arc<PlateInner>, around: &SharedServices) -> io::Result<PlateHandle> {
    let SharedServices { clock, record, min_free_bytes, .. } = *around;
    let worker = PlateWorker { shared: Arc::clone(&shared), clock, record, min_free_bytes };
    let name = format!("plate-{}", shared.name);
    let worker = thread::Builder::new().name(name).spawn(move || worker.work())?;
    Ok(PlateHandle { shared, clock, worker })
}
