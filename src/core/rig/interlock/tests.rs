use std::sync::atomic::AtomicU64;

use super::*;

const STEP_NS: u64 = 50_000;

fn at(steps: u64) -> PlateTime {
    PlateTime::from_nanos(steps * STEP_NS)
}

/// A clock that is set by the test.
#[derive(Debug, Default)]
struct HandClock(AtomicU64);

impl HandClock {
    fn pass(&self, nanos: u64) {
        self.0.fetch_add(nanos, Ordering::Relaxed);
    }
}

impl Clock for HandClock {
    fn elapsed(&self) -> Duration {
        Duration::from_nanos(self.0.load(Ordering::Relaxed))
    }
}

#[test]
fn first_trip_is_kept_unless_an_emergency_stop_follows() {
    let others = [Trip::Lease, Trip::Watchdog, Trip::Shutdown];
    for first in others {
        let interlock = Interlock::default();
        assert_eq!(interlock.tripped(), None);
        assert!(interlock.trip(first));
        others.iter().for_each(|&later| assert!(!interlock.trip(later), "{later:?} after {first:?}"));
        assert_eq!(interlock.tripped(), Some(first));
        assert!(interlock.trip(Trip::EStop));
        assert!(!interlock.trip(Trip::EStop));
        others.iter().for_each(|&later| assert!(!interlock.trip(later)));
        assert_eq!(interlock.tripped(), Some(Trip::EStop));
    }
}

#[test]
fn a_trip_is_answered_when_motors_are_at_zero() {
    let clock = Arc::new(HandClock::default());
    let interlock = Interlock::timed(clock.clone());
    let rig = interlock.attach(PlateTime::ZERO).unwrap();
    rig.energize().unwrap();
    assert_eq!(rig.step(at(4)), None);
    clock.pass(1_000);
    interlock.trip(Trip::EStop);
    assert_eq!(interlock.stop_times(), None, "the motors do not know yet");
    clock.pass(30);
    assert_eq!(rig.step(at(5)), Some(Trip::EStop));
    rig.motors_off(at(5));
    let times = StopTimes { requested_at: at(4), motors_off_at: at(5), wall: Duration::from_nanos(30) };
    assert_eq!(interlock.stop_times(), Some(times));
    clock.pass(30);
    rig.motors_off(at(9));
    assert_eq!(interlock.stop_times(), Some(times), "silent once");
}

#[test]
fn idle_rig_reports_motors_off_at_once() {
    let clock = Arc::new(HandClock::default());
    let interlock = Interlock::timed(clock.clone());
    assert_eq!(interlock.stop_times(), None);
    interlock.trip(Trip::EStop);
    let without_a_rig = interlock.stop_times().unwrap();
    assert_eq!((without_a_rig.requested_at, without_a_rig.motors_off_at), (PlateTime::ZERO, PlateTime::ZERO));
    assert!(interlock.release(Trip::EStop));

    let rig = interlock.attach(at(10)).unwrap();
    rig.energize().unwrap();
    rig.step(at(20));
    rig.motors_off(at(21));
    clock.pass(500);
    rig.step(at(70));
    interlock.trip(Trip::Watchdog);
    let answer = interlock.stop_times().unwrap();
    assert_eq!((answer.requested_at, answer.motors_off_at, answer.wall), (at(70), at(70), Duration::ZERO));
}

#[test]
fn a_stop_while_another_one_is_under_way_is_answered_for_itself() {
    let clock = Arc::new(HandClock::default());
    let interlock = Interlock::timed(clock.clone());
    let rig = interlock.attach(PlateTime::ZERO).unwrap();
    rig.energize().unwrap();
    rig.step(at(7));
    interlock.trip(Trip::Shutdown);
    clock.pass(40);
    interlock.trip(Trip::EStop);
    clock.pass(60);
    rig.step(at(8));
    rig.motors_off(at(8));
    assert_eq!(interlock.stop_times().unwrap().wall, Duration::from_nanos(60));
    let other = Interlock::timed(clock.clone());
    other.trip(Trip::Lease);
    clock.pass(40);
    other.trip(Trip::EStop);
    assert_eq!(other.stop_times().unwrap().wall, Duration::ZERO, "silent before the second");
}

#[test]
fn motors_cannot_be_energized_once_tripped() {
    let interlock = Interlock::default();
    let rig = interlock.attach(PlateTime::ZERO).unwrap();
    interlock.trip(Trip::Shutdown);
    assert_eq!(rig.energize(), Err(Trip::Shutdown));
    assert!(interlock.stop_times().is_some());
}

#[test]
fn a_trip_stays_while_a_rig_is_fitted_and_is_released_by_its_own_reason_alone() {
    let interlock = Interlock::default();
    let first = interlock.attach(PlateTime::ZERO).unwrap();
    assert!(interlock.attach(PlateTime::ZERO).is_none(), "one rig at a time");
    interlock.trip(Trip::Lease);
    assert!(!interlock.release(Trip::Lease));
    drop(first);
    assert!(!interlock.release(Trip::EStop));
    assert_eq!(interlock.tripped(), Some(Trip::Lease));
    assert!(interlock.release(Trip::Lease));
    assert!(!interlock.release(Trip::Lease));
    let second = interlock.attach(PlateTime::ZERO).unwrap();
    assert_eq!(second.energize(), Ok(()));
}

#[test]
fn dropped_rig_counts_as_motors_off() {
    let interlock = Interlock::default();
    let rig = interlock.attach(PlateTime::ZERO).unwrap();
    rig.energize().unwrap();
    rig.step(at(3));
    interlock.trip(Trip::EStop);
    drop(rig);
    assert_eq!(interlock.stop_times().unwrap().motors_off_at, at(3));
    assert!(interlock.release(Trip::EStop));
}

#[test]
fn trip_unparks_the_driver_thread() {
    let interlock = Interlock::default();
    let driver = {
        let interlock = interlock.clone();
        thread::spawn(move || {
            interlock.set_driver_thread();
            while interlock.tripped().is_none() {
                thread::park();
            }
        })
    };
    while interlock.0.driver.get().is_none() {
        thread::yield_now();
    }
    interlock.trip(Trip::EStop);
    driver.join().unwrap();
}

#[test]
fn of_many_at_once_one_trips_and_an_emergency_stop_is_never_lost() {
    for _ in 0..200 {
        let interlock = Interlock::default();
        let rig = interlock.attach(PlateTime::ZERO).unwrap();
        let changed = thread::scope(|scope| {
            let trip = |why| {
                let interlock = &interlock;
                scope.spawn(move || interlock.trip(why))
            };
            let threads = [Trip::Lease, Trip::Watchdog, Trip::EStop, Trip::Shutdown, Trip::EStop].map(trip);
            // pulses that start and end meanwhile
            while rig.energize().is_ok() {
                rig.motors_off(at(1));
            }
            threads.map(|thread| thread.join().unwrap())
        });
        assert_eq!(interlock.tripped(), Some(Trip::EStop));
        assert!(changed[2] != changed[4], "one of the two made it: {changed:?}");
        assert!(changed.iter().filter(|&&changed| changed).count() <= 2, "{changed:?}");
        assert!(interlock.stop_times().is_some());
    }
}
