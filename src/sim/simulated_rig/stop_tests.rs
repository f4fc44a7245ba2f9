use proptest::prelude::*;

use super::tests::{drive, rig};
use super::*;
use crate::Wrench;
use upm_core::rig::Trip;
use upm_core::signal::Envelope;

const STEP_S: f64 = 5e-5;
const LONG: Envelope = Envelope { attack_s: 0.01, sustain_s: 0.2, rest_s: 0.05 };

fn long_drive() -> Drive {
    Drive { envelope: LONG, ..drive(300.0) }
}

/// A rig under an interlock, shortly after the start of a long pulse.
fn driving() -> (SimRig, Interlock) {
    let (mut rig, interlock) = (rig(1), Interlock::default());
    rig.attach(interlock.clone()).unwrap();
    rig.play(&long_drive()).unwrap();
    (rig, interlock)
}

fn one_step(rig: &mut SimRig) -> Wrench {
    rig.advance_to(rig.now() + STEP_S);
    rig.plant.motors.wrench()
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(24))]

    #[test]
    fn force_is_zero_within_a_step_of_a_trip_at_any_time(after in 0u32..6000, why in 0usize..4, is_moving_on in any::<bool>()) {
        let (mut rig, interlock) = driving();
        if is_moving_on {
            rig.take_over(&Drive { envelope: LONG, ..drive(-200.0) }).unwrap();
        }
        let mut felt = Wrench::default();
        for _ in 0..after {
            felt = one_step(&mut rig);
        }
        prop_assert!(felt != Wrench::default() || !(1..4000).contains(&after), "it sounded before");
        interlock.trip(Trip::ALL[why]);
        let tripped_at = rig.now();
        for _ in 0..400 {
            prop_assert_eq!(one_step(&mut rig), Wrench::default());
        }
        let answer = interlock.stop_times().unwrap();
        prop_assert!(answer.motors_off_at - answer.requested_at <= STEP_S + 1e-12, "{answer:?}");
        prop_assert!((tripped_at - answer.requested_at).abs() <= STEP_S + 1e-12, "{answer:?}");
        prop_assert_eq!(rig.play(&long_drive()), Err(RigError::Stopped(Trip::ALL[why])));
        let mut frame = Frame::new(1, 1);
        prop_assert_eq!(rig.capture(&mut frame), Err(RigError::Stopped(Trip::ALL[why])));
    }

    #[test]
    fn expired_lease_turns_motors_off(before in 0u32..4000, away_s in 0.101..2.0f64) {
        let (mut rig, interlock) = driving();
        for _ in 0..before {
            one_step(&mut rig);
        }
        let left_at = rig.now();
        prop_assert_eq!(rig.pass(left_at + away_s), Err(RigError::Stopped(Trip::Lease)));
        prop_assert!((rig.now() - left_at - away_s).abs() <= STEP_S, "time passes all the same");
        let answer = interlock.stop_times().unwrap();
        prop_assert!((answer.motors_off_at - left_at - Interlock::LEASE_S).abs() <= STEP_S, "{answer:?} from {left_at}");
        prop_assert!(rig.settled_at() - answer.motors_off_at <= LONG.rest_s + 1e-9);
        prop_assert_eq!(rig.plant.motors.wrench(), Wrench::default());
    }
}

#[test]
fn a_lease_that_does_not_run_out_leaves_the_pulse_as_it_is() {
    let (mut rig, interlock) = driving();
    let mut other = self::rig(1);
    other.play(&long_drive()).unwrap();
    for _ in 0..3 {
        assert_eq!(rig.pass(rig.now() + 0.09), Ok(()));
        other.plant.advance_to(rig.now(), &mut InterlockPort::default());
        assert_eq!(rig.plant.plate(), other.plant.plate());
    }
    assert_eq!(interlock.tripped(), None);
    assert_eq!(rig.pass(rig.now() + 60.0), Ok(()), "silent: there is nothing to stop");
    assert_eq!(rig.play(&long_drive()), Ok(()));
}

#[test]
fn a_lease_runs_out_without_an_interlock_too() {
    let mut rig = rig(1);
    rig.play(&long_drive()).unwrap();
    assert_eq!(rig.pass(rig.now() + 1.0), Err(RigError::Stopped(Trip::Lease)));
    assert_eq!(rig.plant.motors.wrench(), Wrench::default());
}

#[test]
fn an_emergency_stop_goes_before_the_lease() {
    let (mut rig, interlock) = driving();
    interlock.trip(Trip::EStop);
    assert_eq!(rig.pass(rig.now() + 1.0), Err(RigError::Stopped(Trip::EStop)));
    assert!(interlock.stop_times().unwrap().motors_off_at - PlateTime::ZERO <= STEP_S);
}

#[test]
fn another_thread_stops_a_pulse_that_is_being_captured() {
    let (mut rig, interlock) = driving();
    let (fault, tripped_by) = std::thread::scope(|scope| {
        let presser = scope.spawn(|| {
            while interlock.now() < PlateTime::from_secs(0.03) {
                std::thread::yield_now();
            }
            assert!(interlock.trip(Trip::EStop));
            interlock.now()
        });
        let mut frame = Frame::new(1, 1);
        let fault = loop {
            match rig.capture(&mut frame) {
                Ok(()) => assert!(rig.now().secs() < 600.0, "never stopped"),
                Err(fault) => break fault,
            }
        };
        (fault, presser.join().unwrap())
    });
    assert_eq!(fault, RigError::Stopped(Trip::EStop));
    let answer = interlock.stop_times().unwrap();
    assert!(answer.requested_at.secs() >= 0.03 - STEP_S, "{answer:?}");
    assert!(answer.requested_at <= answer.motors_off_at, "{answer:?}");
    // the step in progress when the trip was set, and one whose start the other thread had not seen yet; the scheduler
    // may let any number of steps pass between the request and the trip
    assert!(answer.motors_off_at - tripped_by <= 2.0 * STEP_S + 1e-12, "{answer:?} {tripped_by:?}");
    assert_eq!(rig.plant.motors.wrench(), Wrench::default());
}

#[test]
fn the_next_rig_finds_the_trip_and_plays_nothing_until_it_is_released() {
    let (first, interlock) = driving();
    interlock.trip(Trip::Watchdog);
    assert_eq!(
        rig(2).attach(interlock.clone()).map_err(|fault| fault.to_string()).unwrap_err(),
        "the interlock is fitted to another rig"
    );
    drop(first);
    let mut second = rig(2);
    second.attach(interlock.clone()).unwrap();
    assert_eq!(second.play(&long_drive()), Err(RigError::Stopped(Trip::Watchdog)));
    assert!(!interlock.release(Trip::Watchdog));
    drop(second);
    assert!(interlock.release(Trip::Watchdog));
    let mut third = rig(3);
    third.attach(interlock).unwrap();
    assert_eq!(third.play(&long_drive()), Ok(()));
}

#[test]
fn an_interlock_that_does_not_trip_changes_nothing() {
    let run = |fitted: bool| {
        let mut rig = rig(5);
        if fitted {
            rig.attach(Interlock::default()).unwrap();
        }
        let mut frames = vec![Frame::new(1, 1); 40];
        for (i, frame) in frames.iter_mut().enumerate() {
            if i % 25 == 1 {
                rig.play(&drive(250.0)).unwrap();
            }
            rig.capture(frame).unwrap();
        }
        (rig.probe().read(), rig.trace(), frames)
    };
    assert!(run(true) == run(false));
}
