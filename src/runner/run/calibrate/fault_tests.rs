//! Small calibrations of a rig with one fault each, which must be refused with the right cause.

use super::tests::small;
use super::*;
use upm_control::calibration::{CoilFault, MiswiredChannel, RigComponent};
use upm_core::rig::{Rig, RigFault};
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
    fn now(&self) -> PlateTime {
        self.rig.now()
    }

    fn play(&mut self, drive: &Drive) -> Result<(), RigFault> {
        let mut drive = drive.clone();
        match self.alteration {
            Alteration::Coil(coil, factor) if self.is_altered() => scale_coil(&mut drive, coil, factor),
            Alteration::Swap(a, b) if self.is_altered() => swap_coils(&mut drive, a, b),
            _ => {}
        }
        self.rig.play(&drive)
    }

    fn settled_at(&self) -> PlateTime {
        self.rig.settled_at()
    }

    fn capture(&mut self, frame: &mut Frame) -> Result<(), RigFault> {
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

    fn stop(&mut self) {
        self.rig.stop();
    }
}

fn made(alteration: Alteration, from_s: f64) -> Result<Library, CalibrationFault> {
    made_with(MotorArrangement::Around, alteration, from_s)
}

fn made_with(arrangement: MotorArrangement, alteration: Alteration, from_s: f64) -> Result<Library, CalibrationFault> {
    let (mut rig, params) = small();
    (rig.model.motor_arrangement, rig.sim.motors.arrangement) = (arrangement, arrangement);
    let mut altered = AlteredRig { rig: simulated(&rig, 1).unwrap(), from_s, alteration, last: None };
    let stop = AtomicBool::new(false);
    calibration::calibrate(&mut altered, &rig.model, &rig.fingerprint, &params, &stop, &mut |_| ())
}

fn refusal(alteration: Alteration, from_s: f64) -> CalibrationFault {
    made(alteration, from_s).unwrap_err()
}

/// "Kinematically equivalent" (UPM paper, section 3.1).
#[test]
fn libraries_of_both_motor_arrangements_differ_in_signs_alone() {
    let [around, mut beside] =
        MotorArrangement::ALL.map(|arrangement| made_with(arrangement, Alteration::Nothing, 0.0).unwrap());
    for entry in &mut beside.entries {
        let [x1, x2, y1, y2] = entry.amplitudes;
        entry.amplitudes = [x1, -x2, y1, -y2];
    }
    assert_eq!(Library { motor_arrangement: MotorArrangement::Around, ..beside }, around);
}

#[test]
fn dead_coil_is_refused_by_name() {
    for (k, motor) in Motor::ALL.into_iter().enumerate() {
        let fault = refusal(Alteration::Coil(k, 0.0), 0.0);
        let dead =
            |coil| matches!(fault, CalibrationFault::Coil { coil: c, fault: CoilFault::Dead { .. } } if c == coil);
        assert!(dead(motor), "{fault}");
    }
}

#[test]
fn reversed_coil_is_refused_by_name() {
    for (k, motor) in Motor::ALL.into_iter().enumerate() {
        match refusal(Alteration::Coil(k, -1.0), 0.0) {
            CalibrationFault::Coil { coil, fault: CoilFault::Reversed { gain } } => {
                assert!(coil == motor && (gain + 1.0).abs() < 0.2, "{coil:?} {gain}");
            }
            fault => panic!("{fault}"),
        }
    }
}

#[test]
fn swapped_coils_are_refused_by_their_names() {
    for arrangement in MotorArrangement::ALL {
        for (a, b) in [(0, 1), (0, 2), (0, 3), (1, 2), (1, 3), (2, 3)] {
            match made_with(arrangement, Alteration::Swap(a, b), 0.0).unwrap_err() {
                CalibrationFault::Coil { coil, fault: CoilFault::Swapped { other } } => {
                    // beside each other X2 and Y1, exchanged, act on each axis as X1 and Y2 do
                    let alike = arrangement == MotorArrangement::Beside && a + b == 3;
                    let pair = [coil, other].map(|coil| coil as usize);
                    assert!(pair == [a, b] || alike && pair[0] + pair[1] == 3, "{pair:?} {a} {b}");
                }
                // beside each other they push alike: exchanged, the pulse of spin only squeezes the plate
                CalibrationFault::Still { axis: "axis spin", .. } if arrangement == MotorArrangement::Beside => {
                    assert!(b == a + 1 && a % 2 == 0, "{a} {b}");
                }
                fault => panic!("{fault}"),
            }
        }
    }
}

#[test]
fn coil_weak_by_two_fifths_is_refused_by_name() {
    for (k, motor) in Motor::ALL.into_iter().enumerate() {
        let fault = refusal(Alteration::Coil(k, 0.6), 0.0);
        let unlike =
            |coil| matches!(fault, CalibrationFault::Coil { coil: c, fault: CoilFault::Unlike { .. } } if c == coil);
        assert!(unlike(motor), "{fault}");
    }
}

#[test]
fn coils_far_off_their_nominal_force_are_refused() {
    let (mut rig, params) = small();
    rig.model.newtons_per_count *= 1.6;
    let mut simulated = simulated(&rig, 1).unwrap();
    let stop = AtomicBool::new(false);
    let fault = calibration::calibrate(&mut simulated, &rig.model, "", &params, &stop, &mut |_| ()).unwrap_err();
    assert!(matches!(fault, CalibrationFault::Coil { fault: CoilFault::Gain { .. }, .. }), "{fault}");
}

#[test]
fn dead_accelerometer_channel_is_refused_by_name() {
    for channel in 0..4 {
        let fault = refusal(Alteration::Channel(channel, 0.0), 0.0);
        let dead = matches!(fault, CalibrationFault::Channel { channel: c, fault: MiswiredChannel::Dead { .. } } if c == channel);
        assert!(dead, "{fault}");
    }
}

#[test]
fn reversed_accelerometer_channel_is_refused_by_name() {
    for channel in 0..4 {
        let fault = refusal(Alteration::Channel(channel, -1.0), 0.0);
        let reversed = matches!(
            fault, CalibrationFault::Channel { channel: c, fault: MiswiredChannel::Reversed { .. } } if c == channel
        );
        assert!(reversed, "{fault}");
    }
}

#[test]
fn accelerometer_channel_of_another_gain_is_refused_by_name() {
    let fault = refusal(Alteration::Channel(2, 0.7), 0.0);
    assert!(matches!(fault, CalibrationFault::Channel { channel: 2, fault: MiswiredChannel::Gain { .. } }), "{fault}");
}

/// Plate time within the small calibration's steps: coins' steps are measured from 48 s to 120 s, centres from 120 s to
/// 126 s.
const DURING_STEPS_S: f64 = 60.0;
const DURING_CENTRES_S: f64 = 121.0;

#[test]
fn channel_reversed_half_way_is_refused_by_the_closing_pulse() {
    let fault = refusal(Alteration::Channel(1, -1.0), DURING_STEPS_S);
    assert!(matches!(fault, CalibrationFault::Changed { component: RigComponent::Channel(1), .. }), "{fault}");
}

#[test]
fn coil_weak_half_way_is_refused_by_the_steps_of_the_coins() {
    let fault = refusal(Alteration::Coil(2, 0.6), DURING_STEPS_S);
    assert!(matches!(fault, CalibrationFault::StepChanged { .. }), "{fault}");
}

#[test]
fn coil_weak_at_the_end_is_refused_by_the_closing_pulse() {
    let fault = refusal(Alteration::Coil(2, 0.6), DURING_CENTRES_S);
    assert!(matches!(fault, CalibrationFault::Changed { component: RigComponent::Coil(Motor::Y1), .. }), "{fault}");
}

#[test]
fn camera_frozen_half_way_is_refused_by_its_guard() {
    let fault = refusal(Alteration::Camera, DURING_STEPS_S);
    assert!(matches!(&fault, CalibrationFault::Unseen(reason) if reason.contains("same picture again")), "{fault}");
}
