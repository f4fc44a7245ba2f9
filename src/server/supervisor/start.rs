use std::io;
use std::sync::atomic::{AtomicBool, AtomicU64, AtomicUsize, Ordering};
use std::sync::{Arc, OnceLock};
use std::thread::{self, JoinHandle};
use std::time::Duration;

use parking_lot::Mutex;

use super::current_job::CurrentJob;
use super::emergency_stop::EmergencyStop;
use super::latch::{Latch, make_folder};
use super::preview::FramePreview;
use super::standing::Standing;
use super::validate::JobRules;
use super::watchdog::{TICK, Watchdog, ms};
use super::worker::PlateWorker;
use super::{PlateHandle, PlateSetup, SharedServices};
use upm_core::rig::Interlock;
use upm_core::time::{Clock, MonotonicClock};
use upm_runner::config::WatchdogSpec;

/// Longest time since the last check of a watchdog that is alive.
const WATCHDOG_INTERVAL_LIMIT: Duration = Duration::from_secs(1);

/// All plates of the daemon.
#[derive(Debug)]
pub struct PlateSupervisor {
    plates: Vec<Arc<PlateHandle>>,
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
        let plates: Vec<Arc<PlateHandle>> =
            setups.into_iter().map(|setup| start_plate(setup, around)).collect::<io::Result<_>>()?;
        let looked_ms = Arc::new(AtomicU64::new(ms(clock.elapsed())));
        let (watched, spec, looked) = (plates.clone(), around.watchdog, Arc::clone(&looked_ms));
        let watchdog = thread::Builder::new().name("watchdog".into());
        let watchdog = watchdog.spawn(move || watch(&watched, spec, clock, &looked))?;
        Ok(Self { plates, clock, watchdog, looked_ms })
    }

    /// The plate of that name.
    pub fn get(&self, name: &str) -> Option<&Arc<PlateHandle>> {
        self.plates.iter().find(|plate| plate.name() == name)
    }

    /// All plates, in the order of `setups`.
    pub fn iter(&self) -> impl Iterator<Item = &Arc<PlateHandle>> {
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
            plate.shut_down();
            plate.wake();
        }
        let until = self.clock.elapsed() + within;
        let busy = |plate: &&Arc<PlateHandle>| !plate.has_ended();
        let busy_still = || self.plates.iter().any(|plate| busy(&plate)) || !self.watchdog.is_finished();
        while busy_still() && self.clock.elapsed() < until {
            thread::sleep(Duration::from_millis(2));
        }
        self.plates.iter().filter(busy).map(|plate| plate.name().to_owned()).collect()
    }
}

/// Watches all plates until they end.
fn watch(plates: &[Arc<PlateHandle>], spec: WatchdogSpec, clock: MonotonicClock, looked_ms: &AtomicU64) {
    let watchdog = |plate: &PlateHandle| Watchdog::with_camera(spec, plate.rules.rig.model.frame_hz);
    let mut watchdogs: Vec<Watchdog> = plates.iter().map(|plate| watchdog(plate)).collect();
    while !plates.iter().all(|plate| plate.ending.load(Ordering::SeqCst)) {
        for (plate, watchdog) in plates.iter().zip(&mut watchdogs) {
            let Some((job, journal)) = plate.job.driven() else {
                watchdog.rest();
                continue;
            };
            if let Some(why) = watchdog.check(clock.elapsed(), &plate.job.heartbeat, journal.waits_since()) {
                plate.fail_job(&job, why);
            }
        }
        looked_ms.store(ms(clock.elapsed()), Ordering::Relaxed);
        thread::sleep(TICK);
    }
}

/// A plate without a job, and its thread.
fn start_plate(
    PlateSetup { spec, known, library, paused }: PlateSetup,
    around: &SharedServices,
) -> io::Result<Arc<PlateHandle>> {
    let SharedServices { clock, min_free_bytes, allow_faults, pace, .. } = *around;
    let rules = JobRules { plate: spec.name.clone(), rig: spec.rig, library, allow_faults };
    let standing = spec.standing.map(|standing| Standing::new(&standing, pace, &rules)).transpose()?;
    let job = CurrentJob::default();
    let latch = Latch::open(&around.latches, &spec.name, known)?;
    let interlock = Interlock::timed(Arc::new(clock));
    let plate = Arc::new(PlateHandle {
        clock,
        worker: OnceLock::new(),
        rules,
        store: Arc::clone(&around.store),
        emergency_stop: EmergencyStop::new(latch, interlock, Arc::clone(&job.end_run)),
        job,
        ending: AtomicBool::new(false),
        preview: FramePreview::default(),
        standing,
        paused: Mutex::new(paused),
        pausing: Mutex::default(),
        unnoted: Mutex::default(),
        recorders: AtomicUsize::new(0),
        #[cfg(test)]
        idled: AtomicU64::new(0),
        name: spec.name,
    });
    let worker = PlateWorker { shared: Arc::clone(&plate), clock, rerun: around.rerun.clone(), min_free_bytes };
    let thread = thread::Builder::new().name(format!("plate-{}", plate.name));
    let worker = thread.spawn(move || worker.work())?;
    plate.worker.get_or_init(|| worker);
    Ok(plate)
}
