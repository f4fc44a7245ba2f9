use super::*;
use crate::pump_tests::rig_params;
use std::f64::consts::TAU;
use upm_core::geometry::{Lens, Vec2};
use upm_core::signal::{Envelope, Harmonic};

const ENVELOPE: Envelope = Envelope { attack_s: 0.01, sustain_s: 0.06, rest_s: 0.05 };

fn model(params: &SimParams) -> RigModel {
    RigModel {
        name: "test".to_owned(),
        plate_side_m: params.plate.side_m,
        lever_arm_m: params.motors.lever_arm_m,
        motor_arrangement: params.motors.arrangement,
        plate_mass_kg: params.plate.mass_kg,
        plate_inertia_kgm2: params.plate.inertia_kgm2,
        newtons_per_count: params.motors.newtons_per_count,
        count_limit: params.motors.count_limit,
        base_radps: TAU * 60.0,
        attack_s: 0.01,
        rest_s: 0.05,
        max_sustain_s: 0.2,
        fields: None,
        accelerometer_in_plate_m: params.accelerometers.position_m,
        frame_size_px: params.camera.size_px,
        frame_hz: params.camera.frame_hz,
        exposure_s: params.camera.exposure_s,
        lens: Lens::ideal(1000.0, Vec2::new(320.0, 240.0)),
        dark_parts: true,
    }
}

pub(super) fn rig(seed: u64) -> SimRig {
    let penny = PartParams::PENNY;
    let at = |x, y| Pose { position_m: Vec2::new(x, y), heading_rad: 0.0 };
    let params = rig_params();
    SimRig::new(model(&params), params, vec![(penny, at(0.05, 0.02)), (penny, at(-0.04, 0.0))], Streams::new(seed))
}

/// A drive of spin about the plate's centre, both harmonics.
pub(super) fn drive(counts: f64) -> Drive {
    let wave = |sign: f64| {
        let first = Harmonic { cos: 0.0, sin: -sign * counts };
        vec![first, Harmonic { cos: 0.0, sin: sign * counts }]
    };
    let motors = [wave(-1.0), wave(-1.0), wave(1.0), wave(1.0)];
    Drive { base_radps: TAU * 60.0, motors, envelope: ENVELOPE, ..Drive::default() }
}

fn capture(rig: &mut SimRig) -> Frame {
    let mut frame = Frame::new(1, 1);
    rig.capture(&mut frame).unwrap();
    frame
}

#[test]
fn frames_come_at_their_rate_and_time_passes_only_there() {
    let mut rig = rig(1);
    assert_eq!(rig.now(), PlateTime::ZERO);
    let params = rig.camera.params;
    for index in 1..200u64 {
        if index == 20 {
            rig.play(&drive(200.0)).unwrap();
        }
        let frame = capture(&mut rig);
        assert_eq!(frame.index, index);
        assert_eq!(frame.exposed_at, PlateTime::from_secs(index as f64 / params.frame_hz));
        assert_eq!(rig.probe().read().at, frame.exposed_at);
        let late = rig.now() - frame.exposed_at - 0.5 * params.exposure_s;
        assert!((-1e-9..5.1e-5).contains(&late), "{late}");
    }
}

#[test]
fn positions_have_the_times_and_places_of_pictures() {
    let (mut pictured, mut measured) = (rig(1), rig(1).without_pixels(&Streams::new(1)));
    for index in 1..60 {
        if index == 5 {
            pictured.play(&drive(300.0)).unwrap();
            measured.play(&drive(300.0)).unwrap();
        }
        let (frame, other) = (capture(&mut pictured), capture(&mut measured));
        assert_eq!((frame.index, frame.exposed_at), (other.index, other.exposed_at));
        assert_eq!(pictured.probe().read(), measured.probe().read());
        let positions = other.positions.unwrap();
        assert!(other.pixels.is_empty() && frame.positions.is_none() && positions.corners_px.is_some());
        for (disc, part) in positions.discs.iter().zip(&measured.probe().read().parts) {
            let height_m = PartParams::PENNY.thickness_m;
            let true_px = measured.image_from_table(part.part_in_table.position_m, height_m);
            // a part on the way is measured in the mean of the exposure
            let off_px = (disc.center_px - true_px).norm();
            assert!(off_px < if part.velocity_mps.norm() > 0.0 { 0.5 } else { 5.0 * disc.sd_px }, "{off_px}");
        }
    }
}

#[test]
fn pulse_keeps_the_rig_busy_moves_parts_and_leaves_a_trace() {
    let mut rig = rig(1);
    capture(&mut rig);
    let before = rig.probe().read();
    let start = rig.now();
    rig.play(&drive(300.0)).unwrap();
    assert!((rig.settled_at() - start - ENVELOPE.total_s()).abs() < 1e-9);
    assert_eq!(rig.play(&drive(300.0)), Err(RigError::Busy(rig.settled_at())));
    assert!(rig.trace().is_empty());
    while rig.now() < rig.settled_at() {
        capture(&mut rig);
    }
    let (after, trace) = (rig.probe().read(), rig.trace());
    assert_eq!(trace.len(), (ENVELOPE.driven_s() * trace.sample_hz) as usize + 1);
    assert!(trace.counts.iter().all(|c| c.iter().any(|&n| n.abs() > 50)));
    for (a, b) in before.parts.iter().zip(&after.parts) {
        let moved = b.part_in_table.position_m - a.part_in_table.position_m;
        assert!(moved.norm() > 2e-4, "{moved}");
        assert!(moved.dot(&upm_core::geometry::perp(a.part_in_table.position_m)) > 0.0, "counter-clockwise");
    }
    rig.play(&drive(300.0)).unwrap();
    assert!(rig.trace().is_empty(), "a new pulse forgets the last trace");
}

#[test]
fn invalid_drives_are_refused() {
    let mut rig = rig(1);
    let with = |change: fn(&mut Drive)| {
        let mut drive = drive(300.0);
        change(&mut drive);
        drive
    };
    assert!(matches!(rig.play(&drive(1e4)), Err(RigError::DriveTooStrong { .. })));
    for bad in [
        with(|d| d.base_radps = f64::NAN),
        with(|d| d.base_radps = 0.0),
        with(|d| d.motors[2][0].cos = f64::INFINITY),
        with(|d| d.envelope.attack_s = -0.1),
        with(|d| d.envelope.sustain_s = 0.3),
        with(|d| d.envelope.rest_s = 1e9),
    ] {
        assert!(matches!(rig.play(&bad), Err(RigError::BadDrive(_))), "{bad:?}");
    }
    assert!(rig.plant.still);
}

#[test]
fn stop_ends_the_pulse_now() {
    let mut rig = rig(1);
    rig.stop();
    assert_eq!(rig.settled_at(), PlateTime::ZERO);
    rig.play(&drive(300.0)).unwrap();
    capture(&mut rig);
    capture(&mut rig);
    rig.stop();
    let (stopped, length) = (rig.now(), rig.trace().len());
    assert!((rig.settled_at() - stopped - ENVELOPE.rest_s).abs() < 1e-9);
    while rig.now() < rig.settled_at() {
        capture(&mut rig);
    }
    assert_eq!(rig.trace().len(), length);
    let peak = |rig: &SimRig| rig.plant.plate().twist.spin_radps.abs();
    let ringing = peak(&rig);
    (0..240).for_each(|_| drop(capture(&mut rig)));
    assert!(peak(&rig) < 1e-3 * ringing, "no force feeds the plate any more");
    rig.play(&drive(300.0)).unwrap();
}

#[test]
fn equal_seeds_give_equal_runs() {
    let run = |seed| {
        let mut rig = rig(seed);
        for i in 0..40 {
            if i % 12 == 1 {
                rig.play(&drive(250.0)).unwrap();
            }
            capture(&mut rig);
        }
        (rig.probe().read(), rig.trace())
    };
    assert_eq!(run(5), run(5));
    assert_ne!(run(5).1, run(6).1);
}
