use std::fmt;
use std::ops::Deref;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, OnceLock};
use std::thread::{self, Thread};
use std::time::Duration;

use parking_lot::{Condvar, Mutex};

use crate::job::StopCause;
use crate::time::{Clock, PlateTime};

/// Why an interlock tripped.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Trip {
    /// A person pressed stop.
    EStop,
    /// Nobody drove the rig for [`Interlock::LEASE_S`] of plate time while its motors sounded.
    Lease,
    /// Whoever watches the plate saw that something is wrong.
    Watchdog,
    /// The program ends.
    Shutdown,
}

impl Trip {
    /// All of them.
    pub const ALL: [Self; 4] = [Self::EStop, Self::Lease, Self::Watchdog, Self::Shutdown];
}

impl fmt::Display for Trip {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::EStop => "emergency stop",
            Self::Lease => "the drive lease ran out, nobody drove the motors for 0.1 s",
            Self::Watchdog => "the watchdog stopped it",
            Self::Shutdown => "the program ends",
        })
    }
}

impl From<Trip> for StopCause {
    fn from(trip: Trip) -> Self {
        match trip {
            Trip::EStop => Self::Estop,
            Trip::Lease => Self::LeaseExpired,
            Trip::Watchdog => Self::Watchdog,
            Trip::Shutdown => Self::Shutdown,
        }
    }
}

/// When motors fell silent that were told to.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct StopTimes {
    /// Plate time of the request.
    pub requested_at: PlateTime,
    /// Plate time from which on the motors' force is zero; that of the request where they were silent already.
    pub silent_at: PlateTime,
    /// What lies between on the wall; zero for an interlock without a clock.
    pub wall: Duration,
}

/// Keeps motors silent. Any thread trips it, at any time, past everything else; the rig it is fitted to asks it
/// before every step and cuts its motors within that step.
///
/// Tripping takes no lock and never waits for the rig, nor the rig for who trips it. The one lock is for those who wait for
/// silence: they hold it while they look, the rig for a moment once its motors have fallen silent after a trip.
///
/// An interlock belongs to a plate, not to a run. Whoever owns the plate makes one, keeps it for life and fits it to
/// the rig of each run in turn; a run on its own makes one for itself. A rig holds it ([`Fitted`]) from
/// [`Interlock::fit`] until the rig is dropped. A trip stays while a rig is fitted: a run that was stopped can only
/// end. After that [`Interlock::release`] takes the trip back, or the next rig finds it tripped and plays nothing.
#[derive(Clone, Debug, Default)]
pub struct Interlock(Arc<Shared>);

#[derive(Default)]
struct Shared {
    /// Trip, fitted, sounding and the plate time of the trip, in one word, so that each change sees all of them.
    word: AtomicU64,
    now_ns: AtomicU64,
    silent_at_ns: AtomicU64,
    requested_wall_ns: AtomicU64,
    silent_wall_ns: AtomicU64,
    driver: OnceLock<Thread>,
    silence: (Mutex<()>, Condvar),
    clock: Option<Arc<dyn Clock + Send + Sync>>,
}

/// The parts of [`Shared::word`].
#[derive(Clone, Copy, PartialEq, Eq)]
struct Word(u64);

impl Word {
    const FITTED: u64 = 1 << 63;
    const SOUNDING: u64 = 1 << 62;
    const TRIP_SHIFT: u32 = 59;
    const TRIP: u64 = 0b111 << Self::TRIP_SHIFT;
    /// Nanoseconds for eighteen years.
    const TIME: u64 = (1 << Self::TRIP_SHIFT) - 1;

    #[inline]
    fn trip(self) -> Option<Trip> {
        let number = ((self.0 & Self::TRIP) >> Self::TRIP_SHIFT) as usize;
        number.checked_sub(1).and_then(|index| Trip::ALL.get(index).copied())
    }

    #[inline]
    fn has(self, bit: u64) -> bool {
        self.0 & bit != 0
    }

    #[inline]
    fn tripped(self, why: Trip, at_ns: u64) -> Self {
        let number = match why {
            Trip::EStop => 1,
            Trip::Lease => 2,
            Trip::Watchdog => 3,
            Trip::Shutdown => 4,
        };
        Self(self.released().0 | number << Self::TRIP_SHIFT | at_ns.min(Self::TIME))
    }

    #[inline]
    fn released(self) -> Self {
        Self(self.0 & (Self::FITTED | Self::SOUNDING))
    }

    #[inline]
    fn requested_at(self) -> PlateTime {
        PlateTime::from_nanos(self.0 & Self::TIME)
    }
}

impl Interlock {
    /// Plate time for which motors sound on when nobody drives them any more, s.
    pub const LEASE_S: f64 = 0.1;

    /// One that also measures on the wall how fast motors fall silent.
    #[inline]
    pub fn timed(clock: Arc<dyn Clock + Send + Sync>) -> Self {
        Self(Arc::new(Shared { clock: Some(clock), ..Shared::default() }))
    }

    /// Trips it. True when that changed anything: the first trip stands, but an emergency stop goes before others.
    ///
    /// It waits for nobody: another try is only needed when a pulse starts or ends, a rig comes or goes, or somebody
    /// else trips it in this very moment.
    pub fn trip(&self, why: Trip) -> bool {
        let shared = &*self.0;
        let asked_at_ns = shared.wall_ns();
        let changed = shared.change(|word| {
            let stands = word.trip().is_some_and(|earlier| earlier == why || why != Trip::EStop);
            (!stands).then(|| {
                // before the trip can be seen, so that the silence after it never comes earlier
                shared.requested_wall_ns.store(asked_at_ns, Ordering::Relaxed);
                word.tripped(why, shared.now_ns.load(Ordering::Relaxed))
            })
        });
        if let (true, Some(driver)) = (changed.is_ok(), shared.driver.get()) {
            driver.unpark();
        }
        changed.is_ok()
    }

    /// Why it is tripped, if it is.
    #[inline]
    pub fn tripped(&self) -> Option<Trip> {
        self.0.word(Ordering::Acquire).trip()
    }

    /// The plate time of the rig it is fitted to, or of the last one.
    #[inline]
    pub fn now(&self) -> PlateTime {
        PlateTime::from_nanos(self.0.now_ns.load(Ordering::Relaxed))
    }

    /// Takes back a trip for `why`. False while a rig is fitted, and when it is not tripped for that reason.
    #[inline]
    pub fn release(&self, why: Trip) -> bool {
        let free = |word: Word| !word.has(Word::FITTED) && word.trip() == Some(why);
        self.0.change(|word| free(word).then(|| word.released())).is_ok()
    }

    /// Fits it to a rig whose time is `now` and whose motors are silent; `None` while it is fitted to another.
    #[inline]
    pub fn fit(&self, now: PlateTime) -> Option<Fitted> {
        let shared = &*self.0;
        shared.change(|word| (!word.has(Word::FITTED)).then_some(Word(word.0 | Word::FITTED))).ok()?;
        shared.now_ns.store(now.nanos(), Ordering::Relaxed);
        shared.silent_at_ns.store(now.nanos(), Ordering::Relaxed);
        Some(Fitted(self.clone()))
    }

    /// The calling thread drives the rig: a trip wakes it when it is parked. The first thread that says so is the one.
    #[inline]
    pub fn driven_from_here(&self) {
        self.0.driver.get_or_init(thread::current);
    }

    /// The rig is about to sound; refused once tripped.
    #[inline]
    pub fn sound(&self) -> Result<(), Trip> {
        let sounding = |word: Word| word.trip().is_none().then_some(Word(word.0 | Word::SOUNDING));
        self.0.change(sounding).map_err(|word| word.trip().unwrap_or(Trip::EStop))
    }

    /// The rig calls this before every step: notes its time, and tells whether motors have to be silent in that step.
    #[inline]
    pub fn step(&self, now: PlateTime) -> Option<Trip> {
        self.0.now_ns.store(now.nanos(), Ordering::Relaxed);
        self.0.word(Ordering::Relaxed).trip()
    }

    /// The rig says that its motors are at zero from `at` on.
    pub fn silent(&self, at: PlateTime) {
        let shared = &*self.0;
        let word = shared.word(Ordering::Acquire);
        if !word.has(Word::SOUNDING) {
            return;
        }
        shared.silent_at_ns.store(at.nanos(), Ordering::Relaxed);
        if word.trip().is_some() {
            shared.silent_wall_ns.store(shared.wall_ns(), Ordering::Relaxed);
        }
        let before = Word(shared.word.fetch_and(!Word::SOUNDING, Ordering::AcqRel));
        if before.trip().is_some() {
            let (lock, condition) = &shared.silence;
            drop(lock.lock());
            condition.notify_all();
        }
    }

    /// Waits until the motors have answered the trip, at most `within`: how, as [`Self::answer`] has it.
    pub fn wait_for_answer(&self, within: Duration) -> Option<StopTimes> {
        let (lock, condition) = &self.0.silence;
        let is_sounding = |_: &mut ()| {
            let word = self.0.word(Ordering::Acquire);
            word.trip().is_some() && word.has(Word::SOUNDING)
        };
        condition.wait_while_for(&mut lock.lock(), is_sounding, within);
        self.answer()
    }

    /// How the trip was answered; `None` without a trip, and while motors still sound.
    pub fn answer(&self) -> Option<StopTimes> {
        let shared = &*self.0;
        let word = shared.word(Ordering::Acquire);
        if word.trip().is_none() || word.has(Word::SOUNDING) {
            return None;
        }
        let silent_at = PlateTime::from_nanos(shared.silent_at_ns.load(Ordering::Relaxed));
        // motors that fell silent before anybody asked were silent when asked
        let from_ns = shared.requested_wall_ns.load(Ordering::Relaxed);
        let wall_ns = shared.silent_wall_ns.load(Ordering::Relaxed).saturating_sub(from_ns);
        let requested_at = word.requested_at();
        let wall = Duration::from_nanos(wall_ns);
        Some(StopTimes { requested_at, silent_at: silent_at.max(requested_at), wall })
    }
}

impl Shared {
    #[inline]
    fn word(&self, order: Ordering) -> Word {
        Word(self.word.load(order))
    }

    /// Puts `next` of the word in its place; `Err` with the word for which there is none.
    #[inline]
    fn change(&self, next: impl Fn(Word) -> Option<Word>) -> Result<(), Word> {
        let put = |word| next(Word(word)).map(|word| word.0);
        self.word.fetch_update(Ordering::AcqRel, Ordering::Acquire, put).map(drop).map_err(Word)
    }

    #[inline]
    fn wall_ns(&self) -> u64 {
        let elapsed = self.clock.as_ref().map_or(Duration::ZERO, |clock| clock.elapsed());
        u64::try_from(elapsed.as_nanos()).unwrap_or(u64::MAX)
    }
}

impl fmt::Debug for Shared {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let word = self.word(Ordering::Acquire);
        f.debug_struct("Interlock")
            .field("trip", &word.trip())
            .field("fitted", &word.has(Word::FITTED))
            .field("sounding", &word.has(Word::SOUNDING))
            .finish_non_exhaustive()
    }
}

/// An [`Interlock`] as a rig holds it. Dropped with the rig, whose motors are then gone and silent.
#[derive(Debug)]
pub struct Fitted(Interlock);

impl Deref for Fitted {
    type Target = Interlock;

    #[inline]
    fn deref(&self) -> &Interlock {
        &self.0
    }
}

impl Drop for Fitted {
    #[inline]
    fn drop(&mut self) {
        let shared = &*self.0.0;
        self.0.silent(self.0.now());
        shared.word.fetch_and(!Word::FITTED, Ordering::AcqRel);
    }
}

#[cfg(test)]
mod tests;
