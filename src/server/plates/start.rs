use std::fs;
use std::io;
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::mpsc::sync_channel;
use std::thread::{self, JoinHandle};
use std::time::Duration;

use super::Pause;
use super::crier::{Item, cry};
use super::disk::{Disk, DiskGuard, Rates};
use super::latch::Latches;
use super::plate::Plate;
use super::shared::Shared;
use super::standing::{Standing, StandingSetup};
use super::watchdog::{TICK, Watchdog, ms};
use super::worker::{Place, Worker};
use crate::store::{Displaced, Ledger};
use upm_core::priority::step_back;
use upm_core::rig::{Interlock, Trip};
use upm_core::time::{Clock, MonotonicClock};
use upm_library::Library;
use upm_runner::config::{RigSpec, WatchdogSpec};
use upm_viewer::LiveServer;

/// The watchdog is alive that looked no longer ago than this.
const LOOKS_WITHIN: Duration = Duration::from_secs(1);
/// News that may wait for a plate's crier.
const WAITING: usize = 1024;

/// One plate to be made.
#[derive(Clone, Debug)]
pub struct PlateSetup {
    /// Its name, fit for a file.
    pub name: String,
    /// True when the store knew it before this start: a latch file that is missing then counts as stopped.
    pub known: bool,
    /// The simulated rig.
    pub rig: RigSpec,
    /// The library its jobs use unless they bring their own.
    pub library: Arc<Library>,
    /// Why it must not move at first; `None` when it may.
    pub paused: Option<Pause>,
    /// Port of its live stream; `None` for any free one.
    pub live_port: Option<u16>,
    /// The job that runs whenever its queue is empty.
    pub standing: Option<StandingSetup>,
    /// True to take jobs that make the simulated rig fail on purpose.
    pub allow_faults: bool,
}

/// What all plates need.
#[derive(Clone, Debug)]
pub struct Surroundings {
    /// Where jobs come from and go to.
    pub ledger: Arc<dyn Ledger>,
    /// Folder of run folders.
    pub runs: PathBuf,
    /// Folder of the latches.
    pub latches: PathBuf,
    /// The daemon's clock.
    pub clock: MonotonicClock,
    /// False to make no recordings.
    pub record: bool,
    /// When a plate is stopped because something is wrong.
    pub watchdog: WatchdogSpec,
    /// With fewer bytes than this left on the disk recordings are stopped.
    pub min_free_bytes: u64,
    /// Bytes a live stream keeps for viewers that come later; `None` for no live streams.
    pub live_history_bytes: Option<u64>,
    /// Whether a job may bring a library that does not agree with the plate's own.
    pub allow_inline_libraries: bool,
}

/// All plates of the daemon.
#[derive(Debug)]
pub struct Plates {
    plates: Vec<Plate>,
    clock: MonotonicClock,
    watchdog: JoinHandle<()>,
    /// When the watchdog looked last, ms.
    looked_ms: Arc<AtomicU64>,
    disk: Arc<Disk>,
    // dropped after the plates: what they latched last goes to the disk
    latches: Latches,
}

impl Plates {
    /// Makes the plates and starts their threads. A plate whose latch is stopped stays stopped.
    pub fn start(setups: Vec<PlateSetup>, around: &Surroundings) -> io::Result<Self> {
        let names: Vec<(String, bool)> = setups.iter().map(|setup| (setup.name.clone(), setup.known)).collect();
        let latches = Latches::open(&around.latches, &names)?;
        fs::create_dir_all(&around.runs)?;
        let clock = around.clock;
        let disk = Arc::new(Disk::new(&around.runs, around.min_free_bytes, &clock));
        let mut plates = Vec::new();
        for (setup, latch) in setups.into_iter().zip(latches.latches()) {
            let interlock = Interlock::timed(Arc::new(around.clock));
            if latch.is_stopped() {
                interlock.trip(Trip::EStop);
            }
            let (live, standing) = (live(&setup, around), setup.standing.clone());
            let mut shared = Shared::new(setup, Arc::clone(&around.ledger), latch.clone(), interlock, live);
            shared.allow_inline_libraries = around.allow_inline_libraries;
            shared.standing = standing.map(|setup| Standing::new(&setup, &shared)).transpose()?;
            plates.push(plate(Arc::new(shared), around, &disk, latches.keeper())?);
        }
        let watched = || plates.iter().map(|plate| Arc::clone(&plate.shared)).collect();
        let (folder, guarded) = (around.runs.clone(), Arc::clone(&disk));
        let guard = DiskGuard { disk: guarded, folder, plates: watched(), clock };
        thread::Builder::new().name("disk".into()).spawn(move || guard.run())?;
        let looked_ms = Arc::new(AtomicU64::new(ms(clock.elapsed())));
        let watch = Watch {
            plates: watched(),
            disk: Arc::clone(&disk),
            spec: around.watchdog,
            clock,
            looked_ms: Arc::clone(&looked_ms),
        };
        let watchdog = thread::Builder::new().name("watchdog".into()).spawn(move || watch.run())?;
        Ok(Self { plates, clock, watchdog, looked_ms, disk, latches })
    }

    /// The plate of that name.
    pub fn get(&self, name: &str) -> Option<&Plate> {
        self.plates.iter().find(|plate| plate.name() == name)
    }

    /// All of them, in the order they were set up.
    pub fn iter(&self) -> impl Iterator<Item = &Plate> {
        self.plates.iter()
    }

    /// Whether all that must work does: the watchdog looks, and every plate's threads are there. What does not.
    pub fn alive(&self) -> Result<(), String> {
        let unlooked =
            self.clock.elapsed().saturating_sub(Duration::from_millis(self.looked_ms.load(Ordering::Relaxed)));
        if self.watchdog.is_finished() || unlooked > LOOKS_WITHIN {
            return Err(format!("the watchdog has not looked for {:.1} s", unlooked.as_secs_f64()));
        }
        if !self.latches.is_alive() {
            return Err("the thread that keeps emergency stops has died".to_owned());
        }
        self.plates.iter().find_map(Plate::dead).map_or(Ok(()), Err)
    }

    /// Compares the paths of the latch files with the files held open; the first that is displaced. Waits for the disk.
    pub fn check_paths(&self) -> Result<(), Displaced> {
        self.latches.check_paths()
    }

    /// Pauses every plate that is not paused. A run of a standing job ends between two cycles, any other at its own end.
    pub fn pause_all(&self, why: &Pause) {
        self.plates.iter().for_each(|plate| plate.pause(why.clone()));
    }

    /// What is free on the disk of the run folders, in bytes; `None` when it does not say.
    pub fn free_bytes(&self) -> Option<u64> {
        self.disk.free_bytes(self.clock.elapsed())
    }

    /// Ends everything: motors to zero, runs ended as interrupted, and every thread that is at its end. Names of the
    /// plates that did not end in time. What was latched last goes to the disk when all of this is dropped.
    pub fn shutdown(&self, within: Duration) -> Vec<String> {
        self.disk.end();
        for plate in &self.plates {
            plate.shared.ending.store(true, Ordering::SeqCst);
            plate.shared.interlock.trip(Trip::Shutdown);
            plate.shared.stop.store(true, Ordering::SeqCst);
            plate.wake();
        }
        let until = self.clock.elapsed() + within;
        let busy = |plate: &&Plate| !plate.threads_ended();
        let busy_still = || self.plates.iter().any(|plate| busy(&plate)) || !self.watchdog.is_finished();
        while busy_still() && self.clock.elapsed() < until {
            thread::sleep(Duration::from_millis(2));
        }
        self.plates.iter().filter(busy).map(|plate| plate.name().to_owned()).collect()
    }
}

/// The thread of the watchdog.
struct Watch {
    plates: Vec<Arc<Shared>>,
    disk: Arc<Disk>,
    spec: WatchdogSpec,
    clock: MonotonicClock,
    looked_ms: Arc<AtomicU64>,
}

impl Watch {
    /// Watches all plates until they end.
    fn run(self) {
        let Self { plates, disk, spec, clock, looked_ms } = self;
        let mut watched: Vec<(Arc<Shared>, Watchdog)> =
            plates.into_iter().map(|shared| (shared, Watchdog::new(spec))).collect();
        while !watched.iter().all(|(shared, _)| shared.ending.load(Ordering::SeqCst)) {
            for (shared, dog) in &mut watched {
                let Some((job, journal)) = shared.driven() else {
                    dog.rest();
                    continue;
                };
                if let Some(why) = dog.look(clock.elapsed(), &shared.vitals, shared.deadlines(), journal.waits_since())
                {
                    shared.bark(&job, why);
                }
            }
            disk.heed(clock.elapsed());
            looked_ms.store(ms(clock.elapsed()), Ordering::Relaxed);
            thread::sleep(TICK);
        }
    }
}

/// The live stream of a plate, if there shall be one. A plate works without it, too.
fn live(setup: &PlateSetup, around: &Surroundings) -> Option<LiveServer> {
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

fn plate(shared: Arc<Shared>, around: &Surroundings, disk: &Arc<Disk>, keeper: thread::Thread) -> io::Result<Plate> {
    let (sender, items) = sync_channel(WAITING);
    let Surroundings { runs, clock, record, .. } = around.clone();
    let place = Place { runs, clock, record, disk: Arc::clone(disk) };
    let (of_crier, of_worker) = (Arc::clone(&shared), Arc::clone(&shared));
    let crier = thread::Builder::new().name(format!("crier-{}", shared.name)).spawn(move || {
        step_back();
        cry(&of_crier, &items);
    })?;
    let work = move || {
        let mut worker = Worker { shared: of_worker, crier: sender, place, rates: Rates::default() };
        worker.work();
        worker.crier.send(Item::End).ok();
    };
    let worker = thread::Builder::new().name(format!("plate-{}", shared.name)).spawn(work)?;
    Ok(Plate { shared, clock, keeper, worker, crier })
}
