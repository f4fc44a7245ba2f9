//! Small calibrations of a rig with one fault each, which must be refused with the right cause.

use super::super::testing::as_its_rig;
use super::tests::small;
use super::*;
use upm_control::calibration::{CoilError, MiswiredChannel, RigComponent};
use upm_core::rig::{Rig, RigError};
use upm_core::signal::{AccelTrace, Drive, Frame, Motor, MotorArrangement, Shaping};
use upm_core::time::PlateTime;

/// Alteration of a drive before it is played, or of a trace or frame before it is read.
enum Alteration {
    /// None.
    Nothing,
    /// Coil and factor of its force.
    Coil(usize, f64),
    /// Two coils to be exchanged.
    Swap(usize, usize),
    /// Channel and factor of its counts.
    Channel(usize, f64),
    /// The camera repeats the same picture.
    Camera,
}

/// A simulated rig with an alteration from a plate time on.
struct AlteredRig {
    rig: SimRig,
    from_s: f64,
    alteration: Alteration,
    last: Option<Frame>,
}

impl AlteredRig {
    fn is_altered(&self) -> bool {
        self.rig.now().secs() >= self.from_s
    }
}

fn scale_coil(drive: &mut Drive, coil: usize, factor: f64) {
    let Drive { motors, shaping, .. } = drive;
    let flanks = match shaping {
        Shaping::Displacement(flanks) => &mut flanks[coil][..],
        Shaping::Velocity => &mut [],
    };
    for harmonic in motors[coil].iter_mut().chain(flanks.iter_mut().flatten()) {
        (harmonic.cos, harmonic.sin) = (factor * harmonic.cos, factor * harmonic.sin);
    }
}

fn swap_coils(drive: &mut Drive, a: usize, b: usize) {
    drive.motors.swap(a, b);
    if let Shaping::Displacement(flanks) = &mut drive.shaping {
        flanks.swap(a, b);
    }
}

impl Rig for AlteredRig {
    as_its_rig! { now settled_at stop }

    fn play(&mut self, drive: &Drive) -> Result<(), RigError> {
        let mut drive = drive.clone();
        match self.alteration {
            Alteration::Coil(coil, factor) if self.is_altered() => scale_coil(&mut drive, coil, factor),
            Alteration::Swap(a, b) if self.is_altered() => swap_coils(&mut drive, a, b),
            _ => {}
        }
        self.rig.play(&drive)
    }

    fn capture(&mut self, frame: &mut Frame) -> Result<(), RigError> {
        self.rig.capture(frame)?;
        if !matches!(self.alteration, Alteration::Camera) {
            return Ok(());
        }
        match &self.last {
            Some(last) if self.is_altered() => frame.pixels.clone_from(&last.pixels),
            _ => self.last = Some(frame.clone()),
        }
        Ok(())
    }

    fn trace(&self) -> AccelTrace {
        let mut trace = self.rig.trace();
        if let Alteration::Channel(channel, factor) = self.alteration
            && self.is_altered()
        {
            trace.counts[channel].iter_mut().for_each(|count| *count = (f64::from(*count) * factor).round() as i16);
        }
        trace
    }
}

fn made(alteration: Alteration, from_s: f64) -> Result<Library, CalibrationError> {
    made_with(MotorArrangement::Around, alteration, from_s)
}

fn made_with(arrangement: MotorArrangement, alteration: Alteration, from_s: f64) -> Result<Library, CalibrationError> {
    let (mut rig, params) = small();
    (rig.model.motor_arrangement, rig.sim.motors.arrangement) = (arrangement, arrangement);
    let simulated = simulated(&rig, 1).unwrap();
    // only what the camera shows needs its pictures
    let is_seen = matches!(alteration, Alteration::Camera);
    let simulated = if is_seen { simulated } else { simulated.without_pixels(&Streams::new(1)) };
    let mut altered = AlteredRig { rig: simulated, from_s, alteration, last: None };
    let stop = AtomicBool::new(false);
    CalibrationSession::new(&mut altered, &rig.model, &stop, &mut |_| ()).library(&rig.fingerprint, &params)
}

fn refusal(alteration: Alteration, from_s: f64) -> CalibrationError {
    made(alteration, from_s).unwrap_err()
}

/// "Kinematically equivalent" (UPM paper, section 3.1).
#[test]
fn libraries_of_both_motor_arrangements_differ_in_signs_alone_and_know_the_noise() {
    let [around, mut beside] =
        MotorArrangement::ALL.map(|arrangement| made_with(arrangement, Alteration::Nothing, 0.0).unwrap());
    for entry in &mut beside.entries {
        let [x1, x2, y1, y2] = entry.amplitudes;
        entry.amplitudes = [x1, -x2, y1, -y2];
    }
    // positions without pixels have a stated noise
    let (camera, found) = (small().0.sim.camera, around.camera_noise.unwrap());
    let place_px = found.place_m * camera.focal_px / camera.position_m.z;
    assert!((place_px / 0.0055 - 1.0).abs() < 0.1, "{found:?}");
    assert_eq!(Library { motor_arrangement: MotorArrangement::Around, ..beside }, around);
}

#[test]
fn dead_reversed_and_weak_coils_are_refused_by_name() {
    for (k, motor) in Motor::ALL.into_iter().enumerate() {
        for (factor, wanted) in [(0.0, "dead"), (-1.0, "reversed"), (0.6, "unlike")] {
            let CalibrationError::Coil { coil, fault } = refusal(Alteration::Coil(k, factor), 0.0) else { panic!() };
            let found = match fault {
                CoilError::Dead { .. } => "dead",
                CoilError::Reversed { gain } if (gain + 1.0).abs() < 0.2 => "reversed",
                CoilError::Unlike { .. } => "unlike",
                _ => "another fault",
            };
            assert_eq!((coil, found), (motor, wanted), "{fault:?}");
        }
    }
}

#[test]
fn swapped_coils_are_refused_by_their_names() {
    for arrangement in MotorArrangement::ALL {
        for (a, b) in [(0, 1), (0, 2), (0, 3), (1, 2), (1, 3), (2, 3)] {
            match made_with(arrangement, Alteration::Swap(a, b), 0.0).unwrap_err() {
                CalibrationError::Coil { coil, fault: CoilError::Swapped { other } } => {
                    // beside each other X2 and Y1, exchanged, act on each axis as X1 and Y2 do
                    let alike = arrangement == MotorArrangement::Beside && a + b == 3;
                    let pair = [coil, other].map(|coil| coil as usize);
                    assert!(pair == [a, b] || alike && pair[0] + pair[1] == 3, "{pair:?} {a} {b}");
                }
                // beside each other they push alike: exchanged, the pulse of spin only squeezes the plate
                CalibrationError::Still { axis: "axis spin", .. } if arrangement == MotorArrangement::Beside => {
                    assert!(b == a + 1 && a % 2 == 0, "{a} {b}");
                }
                fault => panic!("{fault}"),
            }
        }
    }
}

#[test]
fn coils_far_off_their_nominal_force_are_refused() {
    let (mut rig, params) = small();
    rig.model.newtons_per_count *= 1.6;
    let mut simulated = simulated(&rig, 1).unwrap();
    let stop = AtomicBool::new(false);
    let made = CalibrationSession::new(&mut simulated, &rig.model, &stop, &mut |_| ()).library("", &params);
    let fault = made.unwrap_err();
    assert!(matches!(fault, CalibrationError::Coil { fault: CoilError::Gain { .. }, .. }), "{fault}");
}

#[test]
fn miswired_accelerometer_channels_are_refused_by_name() {
    let dead_or_reversed = (0..4).flat_map(|channel| [(channel, 0.0, "dead"), (channel, -1.0, "reversed")]);
    for (channel, factor, wanted) in dead_or_reversed.chain([(2, 0.7, "gain")]) {
        let refused = refusal(Alteration::Channel(channel, factor), 0.0);
        let CalibrationError::Channel { channel: named, fault } = refused else { panic!("{refused}") };
        let found = match fault {
            MiswiredChannel::Dead { .. } => "dead",
            MiswiredChannel::Reversed { .. } => "reversed",
            MiswiredChannel::Gain { .. } => "gain",
        };
        assert_eq!((named, found), (channel, wanted), "{fault:?}");
    }
}

/// Plate times within the small calibration's steps: coins' steps are measured from 48 s to 120 s, centres from 120 s
/// to 126 s.
const DURING_STEPS_S: f64 = 60.0;
const DURING_CENTRES_S: f64 = 121.0;

#[test]
fn changes_within_a_calibration_are_refused_by_what_sees_them() {
    let fault = refusal(Alteration::Channel(1, -1.0), DURING_STEPS_S);
    assert!(matches!(fault, CalibrationError::Changed { component: RigComponent::Channel(1), .. }), "{fault}");
    let fault = refusal(Alteration::Coil(2, 0.6), DURING_STEPS_S);
    assert!(matches!(fault, CalibrationError::StepChanged { .. }), "{fault}");
    let fault = refusal(Alteration::Coil(2, 0.6), DURING_CENTRES_S);
    assert!(matches!(fault, CalibrationError::Changed { component: RigComponent::Coil(Motor::Y1), .. }), "{fault}");
    let fault = refusal(Alteration::Camera, DURING_STEPS_S);
    assert!(matches!(&fault, CalibrationError::Unseen(reason) if reason.contains("same picture again")), "{fault}");
}
