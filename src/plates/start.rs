use std::io;
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::sync::mpsc::sync_channel;
use std::thread::{self, JoinHandle};
use std::time::Duration;

use super::crier::{Item, cry};
use super::latch::Latches;
use super::plate::Plate;
use super::shared::{Beginning, Cause, Shared};
use super::watchdog::{TICK, Watchdog};
use super::worker::{Place, Worker};
use crate::config::RigSpec;
use crate::library::Library;
use crate::rig::{Interlock, Trip};
use crate::store::Ledger;
use crate::time::{Clock, MonotonicClock};

/// News that may wait for a plate's crier.
const WAITING: usize = 1024;

/// One plate to be made.
#[derive(Clone, Debug)]
pub struct PlateSetup {
    /// Its name, fit for a file.
    pub name: String,
    /// The simulated rig.
    pub rig: RigSpec,
    /// The library its jobs use unless they bring their own.
    pub library: Arc<Library>,
    /// Why it must not move at first; `None` when it may.
    pub paused: Option<String>,
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
}

/// All plates of the daemon.
#[derive(Debug)]
pub struct Plates {
    plates: Vec<Plate>,
    clock: MonotonicClock,
    watchdog: JoinHandle<()>,
    // dropped after the plates: what they latched last goes to the disk
    _latches: Latches,
}

impl Plates {
    /// Makes the plates and starts their threads. A plate whose latch is stopped stays stopped.
    pub fn start(setups: Vec<PlateSetup>, around: &Surroundings) -> io::Result<Self> {
        let names: Vec<String> = setups.iter().map(|setup| setup.name.clone()).collect();
        let latches = Latches::open(&around.latches, &names)?;
        let mut plates = Vec::new();
        for (setup, latch) in setups.into_iter().zip(latches.latches()) {
            let PlateSetup { name, rig, library, paused } = setup;
            let interlock = Interlock::timed(Arc::new(around.clock));
            if latch.is_stopped() {
                interlock.trip(Trip::EStop);
            }
            let (ledger, latch) = (Arc::clone(&around.ledger), latch.clone());
            let shared = Arc::new(Shared::new(Beginning { name, rig, library, ledger, latch, interlock, paused }));
            plates.push(plate(shared, around, latches.keeper())?);
        }
        let watched = plates.iter().map(|plate| Arc::clone(&plate.shared)).collect();
        let clock = around.clock;
        let watchdog = thread::Builder::new().name("watchdog".into()).spawn(move || watch(watched, clock))?;
        Ok(Self { plates, clock, watchdog, _latches: latches })
    }

    /// The plate of that name.
    pub fn get(&self, name: &str) -> Option<&Plate> {
        self.plates.iter().find(|plate| plate.name() == name)
    }

    /// All of them, in the order they were set up.
    pub fn iter(&self) -> impl Iterator<Item = &Plate> {
        self.plates.iter()
    }

    /// Ends everything: motors to zero, runs ended as interrupted, threads joined. Names of the plates that did not
    /// end in time.
    pub fn shutdown(mut self, within: Duration) -> Vec<String> {
        for plate in &self.plates {
            plate.shared.ending.store(true, Ordering::SeqCst);
            plate.shared.interlock.trip(Trip::Shutdown);
            plate.shared.stop.store(true, Ordering::SeqCst);
            plate.wake();
        }
        let until = self.clock.elapsed() + within;
        let busy = |plate: &Plate| !plate.threads_ended();
        let busy_still = |this: &Self| this.plates.iter().any(busy) || !this.watchdog.is_finished();
        while busy_still(&self) && self.clock.elapsed() < until {
            thread::sleep(Duration::from_millis(2));
        }
        self.plates.retain(busy);
        self.plates.iter().map(|plate| plate.name().to_owned()).collect()
    }
}

/// Watches all plates until they end.
fn watch(plates: Vec<Arc<Shared>>, clock: MonotonicClock) {
    let mut watched: Vec<(Arc<Shared>, Watchdog)> =
        plates.into_iter().map(|shared| (shared, Watchdog::default())).collect();
    while !watched.iter().all(|(shared, _)| shared.ending.load(Ordering::SeqCst)) {
        for (shared, dog) in &mut watched {
            if shared.job().is_none() {
                dog.rest();
            } else if let Some(why) = dog.look(clock.elapsed(), &shared.vitals, shared.deadlines()) {
                shared.end_run(None, Cause::Watchdog(why));
                shared.interlock.trip(Trip::Watchdog);
            }
        }
        thread::sleep(TICK);
    }
}

fn plate(shared: Arc<Shared>, around: &Surroundings, keeper: thread::Thread) -> io::Result<Plate> {
    let (sender, items) = sync_channel(WAITING);
    let Surroundings { runs, clock, record, .. } = around.clone();
    let place = Place { runs, clock, record };
    let (of_crier, of_worker) = (Arc::clone(&shared), Arc::clone(&shared));
    let crier = thread::Builder::new().name(format!("crier-{}", shared.name)).spawn(move || cry(&of_crier, &items))?;
    let work = move || {
        let worker = Worker { shared: of_worker, crier: sender, place };
        worker.work();
        worker.crier.send(Item::End).ok();
    };
    let worker = thread::Builder::new().name(format!("plate-{}", shared.name)).spawn(work)?;
    Ok(Plate { shared, clock, keeper, worker, crier })
}
