use std::ops::Deref;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, OnceLock};
use std::thread::{self, Thread};
use std::time::Duration;

use parking_lot::{Condvar, Mutex};

use crate::job::{Finding, StopCause, StopRequest};
use crate::time::{Clock, PlateTime};

/// Cause of an interlock's trip.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, thiserror::Error)]
pub enum Trip {
    /// An operator pressed the emergency stop.
    #[error("emergency stop")]
    EStop,
    /// The rig was not driven for [`Interlock::LEASE_S`] of plate time while its motors were playing.
    #[error("the drive lease expired: the control loop did not drive the motors for 0.1 s")]
    Lease,
    /// The plate's watchdog detected a fault.
    #[error("the watchdog stopped it")]
    Watchdog,
    /// The program is ending.
    #[error("the program ends")]
    Shutdown,
}

impl Trip {
    /// All causes, in the order of the variants.
    pub const ALL: [Self; 4] = [Self::EStop, Self::Lease, Self::Watchdog, Self::Shutdown];
}

impl From<Trip> for StopCause {
    fn from(trip: Trip) -> Self {
        match trip {
            Trip::EStop => StopRequest::Estop.into(),
            Trip::Lease => Finding::LeaseExpired.into(),
            Trip::Watchdog => Finding::Watchdog.into(),
            Trip::Shutdown => StopRequest::Shutdown.into(),
        }
    }
}

/// Times of a stop request and of the motors' silence.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct StopTimes {
    /// Plate time of the request.
    pub requested_at: PlateTime,
    /// Plate time from which on the motors' force is zero; that of the request where they were silent already.
    pub motors_off_at: PlateTime,
    /// Wall time between the two; zero for an interlock without a clock.
    pub wall: Duration,
}

/// Keeps motors silent once tripped. Any thread can trip it at any time, without going through other layers; the rig it
/// is attached to checks it before every step and cuts its motors within that step.
///
/// Tripping takes no lock and never waits for the rig, nor the rig for the tripping thread. The one lock is for threads
/// that wait for silence: they hold it while they check, the rig for a moment once its motors have fallen silent after
/// a trip.
///
/// An interlock belongs to a plate, not to a run. The owner of the plate creates it, keeps it for life and attaches it
/// to the rig of each run in turn; a run without a plate creates one for itself. A rig holds it ([`InterlockGuard`])
/// from [`Interlock::attach`] until the rig is dropped. A trip stays while a rig is attached: a run that was stopped
/// can only end. After that [`Interlock::release`] clears the trip; otherwise the next rig finds it tripped and plays
/// nothing.
#[derive(Clone, Debug, Default)]
pub struct Interlock(Arc<InterlockState>);

#[derive(Debug, Default)]
struct InterlockState {
    /// Trip, attached, driving and the plate time of the trip, in one word, so that each change sees all of them.
    word: AtomicU64,
    now_ns: AtomicU64,
    silent_at_ns: AtomicU64,
    requested_wall_ns: AtomicU64,
    silent_wall_ns: AtomicU64,
    driver: OnceLock<Thread>,
    silence: (Mutex<()>, Condvar),
    clock: Option<Arc<dyn Clock + Send + Sync>>,
}

/// The fields of [`InterlockState::word`].
#[derive(Clone, Copy, PartialEq, Eq)]
struct StateWord(u64);

impl StateWord {
    const ATTACHED: u64 = 1 << 63;
    const DRIVING: u64 = 1 << 62;
    const TRIP_SHIFT: u32 = 59;
    const TRIP: u64 = 0b111 << Self::TRIP_SHIFT;
    /// Mask of the plate time, ns: room for eighteen years.
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

    fn tripped(self, why: Trip, at_ns: u64) -> Self {
        let number = why as u64 + 1;
        Self(self.released().0 | number << Self::TRIP_SHIFT | at_ns.min(Self::TIME))
    }

    fn released(self) -> Self {
        Self(self.0 & (Self::ATTACHED | Self::DRIVING))
    }
}

impl Interlock {
    /// Plate time for which motors play on when the rig is no longer driven, s.
    pub const LEASE_S: f64 = 0.1;

    /// An interlock that also measures the wall time in which motors fall silent.
    pub fn timed(clock: Arc<dyn Clock + Send + Sync>) -> Self {
        Self(Arc::new(InterlockState { clock: Some(clock), ..InterlockState::default() }))
    }

    /// Trips the interlock. True when that changed anything: the first trip remains, but an emergency stop replaces
    /// others.
    ///
    /// Never blocks: it retries only when a pulse starts or ends, a rig is attached or dropped, or another thread trips
    /// it at the same moment.
    pub fn trip(&self, why: Trip) -> bool {
        let shared = &*self.0;
        let asked_at_ns = shared.wall_ns();
        let changed = shared.change(|word| {
            let stands = word.trip().is_some_and(|earlier| earlier == why || why != Trip::EStop);
            (!stands).then(|| {
                // set before the trip becomes visible, so that the silence after it is never earlier
                shared.requested_wall_ns.store(asked_at_ns, Ordering::Relaxed);
                word.tripped(why, shared.now_ns.load(Ordering::Relaxed))
            })
        });
        if let (true, Some(driver)) = (changed.is_ok(), shared.driver.get()) {
            driver.unpark();
        }
        changed.is_ok()
    }

    /// The cause of the trip, if it is tripped.
    #[inline]
    pub fn tripped(&self) -> Option<Trip> {
        self.0.word(Ordering::Acquire).trip()
    }

    /// The plate time of the rig it is attached to, or of the last such rig.
    pub fn now(&self) -> PlateTime {
        PlateTime::from_nanos(self.0.now_ns.load(Ordering::Relaxed))
    }

    /// Clears a trip for `why`. False while a rig is attached, and when it is not tripped for that cause.
    pub fn release(&self, why: Trip) -> bool {
        let free = |word: StateWord| !word.has(StateWord::ATTACHED) && word.trip() == Some(why);
        self.0.change(|word| free(word).then(|| word.released())).is_ok()
    }

    /// Attaches it to a rig whose time is `now` and whose motors are silent; `None` while it is attached to another
    /// rig.
    pub fn attach(&self, now: PlateTime) -> Option<InterlockGuard> {
        let shared = &*self.0;
        shared
            .change(|word| (!word.has(StateWord::ATTACHED)).then_some(StateWord(word.0 | StateWord::ATTACHED)))
            .ok()?;
        shared.now_ns.store(now.nanos(), Ordering::Relaxed);
        shared.silent_at_ns.store(now.nanos(), Ordering::Relaxed);
        Some(InterlockGuard(self.clone()))
    }

    /// Registers the calling thread as the one that drives the rig: a trip wakes it when it is parked. Only the first
    /// call counts.
    pub fn set_driver_thread(&self) {
        self.0.driver.get_or_init(thread::current);
    }

    /// Announces that the rig is about to play.
    ///
    /// # Errors
    /// The cause of the trip, once tripped: the rig must not play.
    pub fn energize(&self) -> Result<(), Trip> {
        let driving = |word: StateWord| word.trip().is_none().then_some(StateWord(word.0 | StateWord::DRIVING));
        self.0.change(driving).map_err(|word| word.trip().unwrap_or(Trip::EStop))
    }

    /// Records the rig's time before every step; `Some` when motors have to be silent in that step.
    #[inline]
    pub fn step(&self, now: PlateTime) -> Option<Trip> {
        self.0.now_ns.store(now.nanos(), Ordering::Relaxed);
        self.0.word(Ordering::Relaxed).trip()
    }

    /// Records that the rig's motors are at zero from `at` on.
    pub fn motors_off(&self, at: PlateTime) {
        let shared = &*self.0;
        let word = shared.word(Ordering::Acquire);
        if !word.has(StateWord::DRIVING) {
            return;
        }
        shared.silent_at_ns.store(at.nanos(), Ordering::Relaxed);
        if word.trip().is_some() {
            shared.silent_wall_ns.store(shared.wall_ns(), Ordering::Relaxed);
        }
        let before = StateWord(shared.word.fetch_and(!StateWord::DRIVING, Ordering::AcqRel));
        if before.trip().is_some() {
            let (lock, condition) = &shared.silence;
            drop(lock.lock());
            condition.notify_all();
        }
    }

    /// Waits for at most `within` until the motors have answered the trip; returns [`Self::stop_times`].
    pub fn wait_until_motors_off(&self, within: Duration) -> Option<StopTimes> {
        let (lock, condition) = &self.0.silence;
        let is_sounding = |_: &mut ()| {
            let word = self.0.word(Ordering::Acquire);
            word.trip().is_some() && word.has(StateWord::DRIVING)
        };
        condition.wait_while_for(&mut lock.lock(), is_sounding, within);
        self.stop_times()
    }

    /// Times of the motors' answer to the trip; `None` without a trip, and while motors still play.
    pub fn stop_times(&self) -> Option<StopTimes> {
        let shared = &*self.0;
        let word = shared.word(Ordering::Acquire);
        if word.trip().is_none() || word.has(StateWord::DRIVING) {
            return None;
        }
        let motors_off_at = PlateTime::from_nanos(shared.silent_at_ns.load(Ordering::Relaxed));
        // motors that fell silent before the request were silent at the request
        let from_ns = shared.requested_wall_ns.load(Ordering::Relaxed);
        let wall_ns = shared.silent_wall_ns.load(Ordering::Relaxed).saturating_sub(from_ns);
        let requested_at = PlateTime::from_nanos(word.0 & StateWord::TIME);
        let wall = Duration::from_nanos(wall_ns);
        Some(StopTimes { requested_at, motors_off_at: motors_off_at.max(requested_at), wall })
    }
}

impl InterlockState {
    #[inline]
    fn word(&self, order: Ordering) -> StateWord {
        StateWord(self.word.load(order))
    }

    /// Replaces the word by `next` of it; `Err` with the current word when `next` gives `None`.
    fn change(&self, next: impl Fn(StateWord) -> Option<StateWord>) -> Result<(), StateWord> {
        let put = |word| next(StateWord(word)).map(|word| word.0);
        self.word.fetch_update(Ordering::AcqRel, Ordering::Acquire, put).map(drop).map_err(StateWord)
    }

    fn wall_ns(&self) -> u64 {
        let elapsed = self.clock.as_ref().map_or(Duration::ZERO, |clock| clock.elapsed());
        u64::try_from(elapsed.as_nanos()).unwrap_or(u64::MAX)
    }
}

/// An [`Interlock`] held by a rig. It is dropped with the rig, whose motors are then gone and silent.
#[derive(Debug)]
pub struct InterlockGuard(Interlock);

impl Deref for InterlockGuard {
    type Target = Interlock;

    #[inline]
    fn deref(&self) -> &Interlock {
        &self.0
    }
}

impl Drop for InterlockGuard {
    fn drop(&mut self) {
        let shared = &*self.0.0;
        self.0.motors_off(self.0.now());
        shared.word.fetch_and(!StateWord::ATTACHED, Ordering::AcqRel);
    }
}

#[cfg(test)]
mod tests;
