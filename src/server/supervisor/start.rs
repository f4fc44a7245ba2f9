use std::fs;
use std::io;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Arc, OnceLock};
use std::thread::{self, JoinHandle};
use std::time::Duration;

use parking_lot::Mutex;

use super::PlateHandle;
use super::current_job::CurrentJob;
use super::emergency_stop::EmergencyStop;
use super::job_rules::{JobRules, Standing};
use super::latch::Latch;
use super::preview::FramePreview;
use super::watchdog::{TICK, Watchdog, ms};
use crate::store::{RecoveryReport, Store};
use upm_core::files::sync_folder;
use upm_core::rig::Interlock;
use upm_core::time::{Clock, MonotonicClock};
use upm_planning::cor_library::Library;
use upm_runner::config::{DaemonSpec, PlateSpec, WatchdogSpec};
use upm_viewer::USUAL_MODE;

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
    /// Creates the plates of the daemon with their `libraries` and starts their threads. A plate whose latch is stopped
    /// stays stopped, and so does a known one without a latch file.
    pub fn start(
        daemon: &DaemonSpec,
        libraries: Vec<Arc<Library>>,
        store: &Arc<Store>,
        recovery: &RecoveryReport,
        clock: MonotonicClock,
    ) -> io::Result<Self> {
        let latches = daemon.data.join("latch");
        fs::create_dir_all(&latches)?;
        // without this a power cut could remove it
        sync_folder(&daemon.data)?;
        let start = |(spec, library): (&PlateSpec, Arc<Library>)| -> io::Result<Arc<PlateHandle>> {
            let PlateSpec { name, rig, waits_after_jobs, .. } = spec.clone();
            let latch = Latch::open(&latches, &name, recovery.known.contains(&name))?;
            let paused = recovery.paused.iter().find(|(of, _)| *of == name).map(|(_, pause)| pause.clone());
            let rules = JobRules { plate: name, rig, library, allow_faults: daemon.allow_faults };
            let standing = spec.standing.as_ref().map(|standing| Standing::new(standing, daemon.pace, &rules));
            let standing = standing.transpose()?;
            let job = CurrentJob::default();
            let interlock = Interlock::timed(Arc::new(clock));
            let plate = Arc::new(PlateHandle {
                clock,
                worker: OnceLock::new(),
                rules,
                store: Arc::clone(store),
                emergency_stop: EmergencyStop::new(latch, interlock, Arc::clone(&job.end_run)),
                job,
                ending: AtomicBool::new(false),
                preview: FramePreview::default(),
                rerun: daemon.rerun.clone().unwrap_or(USUAL_MODE),
                min_free_bytes: daemon.min_free_bytes,
                waits_after_jobs,
                standing,
                paused: Mutex::new(paused),
                resumed_by: Mutex::default(),
                pausing: Mutex::default(),
                unnoted: Mutex::default(),
                recorders: Arc::default(),
                #[cfg(test)]
                idled: AtomicU64::new(0),
            });
            let (thread, shared) = (thread::Builder::new().name(format!("plate-{}", plate.name())), Arc::clone(&plate));
            let worker = thread.spawn(move || shared.work())?;
            plate.worker.get_or_init(|| worker);
            Ok(plate)
        };
        let plates: Vec<Arc<PlateHandle>> =
            daemon.plates.iter().zip(libraries).map(start).collect::<io::Result<_>>()?;
        let looked_ms = Arc::new(AtomicU64::new(ms(clock.elapsed())));
        let (watched, spec, looked) = (plates.clone(), daemon.watchdog, Arc::clone(&looked_ms));
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
        self.plates.iter().for_each(|plate| plate.shut_down());
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
