//! Open loop: true trajectories of given parts under given pulses.

use super::motors::forces_of_wrench;
use super::{PartParams, Parts, Plant, PlateMotion, SimParams, Wrench};
use upm_core::geometry::{Pose, Twist, Vec2};
use upm_core::job::PlateMode;
use upm_core::random::Streams;
use upm_core::signal::{Drive, Envelope, Harmonic, MOTORS, TwistHarmonic, TwistWave};

/// Largest number of harmonics of a pulse, the limit of [`Drive::peak_counts`].
const MOST_HARMONICS: usize = 16;

/// One pulse: plate velocity `env(t) · Σ (cos_k cos kwt + sin_k sin kwt)`, t from the pulse's start.
#[derive(Clone, Debug, PartialEq)]
pub struct OpenPulse {
    /// Harmonic `k` of the base frequency w at index `k - 1`.
    pub harmonics: Vec<TwistHarmonic>,
    /// Envelope of the velocity.
    pub envelope: Envelope,
}

impl OpenPulse {
    /// `amplitude · (cos wt - ½ cos 2wt)`: parts are pumped along the field of `amplitude`; a twist without spin gives
    /// a translation.
    pub fn pump(amplitude: Twist, envelope: Envelope) -> Self {
        Self { harmonics: TwistHarmonic::pump(amplitude).to_vec(), envelope }
    }

    /// Pump rotation about `cor_m` at `spin_radps`, counter-clockwise when positive.
    pub fn about(cor_m: Vec2, spin_radps: f64, envelope: Envelope) -> Self {
        Self::pump(Twist::about(cor_m, spin_radps), envelope)
    }
}

/// True trajectory of one part in the table frame.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct PartTrajectory {
    /// Position along x, m.
    pub x_m: Vec<f64>,
    /// Position along y, m.
    pub y_m: Vec<f64>,
    /// Heading, rad.
    pub theta_rad: Vec<f64>,
}

/// True trajectories of all parts at common instants.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct OpenLoopTrajectories {
    /// Instants, s, from zero at the sampling rate to the end of the last pulse's rest.
    pub t_s: Vec<f64>,
    /// Trajectory of each part, with one position per instant.
    pub parts: Vec<PartTrajectory>,
}

/// Checks `pulses`; refuses those that [`simulate`] would refuse.
///
/// # Errors
/// The first bad pulse and its fault: amplitudes that are not numbers, too many harmonics or lengths out of range; on a
/// dynamic plate also too many counts for the generator or too much force for a coil.
pub fn check_pulses(params: &SimParams, mode: PlateMode, pulses: &[OpenPulse], base_radps: f64) -> Result<(), String> {
    let checked = |pulse: &OpenPulse| {
        check(pulse)?;
        if mode == PlateMode::Dynamic { ideal_drive(params, pulse, base_radps).map(drop) } else { Ok(()) }
    };
    pulses.iter().enumerate().try_for_each(|(i, pulse)| checked(pulse).map_err(|why| format!("pulses[{i}]: {why}")))
}

/// Plays `pulses` one after another, each with its rest, on `parts` at rest. Deterministic.
///
/// A kinematic plate has exactly the requested velocity; parts move in that field at their positions on the table. The
/// motors of a dynamic one play the forces that would give a free mass that velocity; rods, low-pass, whole counts and
/// the parts' reaction act on the plate.
///
/// # Errors
/// That of [`check_pulses`], and that base frequency and sampling rate must be positive numbers.
pub fn simulate(
    params: &SimParams,
    mode: PlateMode,
    parts: &[(PartParams, Pose)],
    pulses: &[OpenPulse],
    base_radps: f64,
    sample_hz: f64,
) -> Result<OpenLoopTrajectories, String> {
    if ![base_radps, sample_hz].iter().all(|f| f.is_finite() && *f > 0.0) {
        return Err("base frequency and sampling rate must be positive".to_owned());
    }
    check_pulses(params, mode, pulses, base_radps)?;
    let step_s = params.step_s;
    let done = OpenLoopTrajectories { t_s: Vec::new(), parts: vec![PartTrajectory::default(); parts.len()] };
    let mut recorder = TrajectoryRecorder { sample_hz, done };
    match mode {
        PlateMode::Kinematic => {
            let mut moving = Parts::new(parts, &params.contact, params.plate.side_m, step_s);
            let mut steps = 0u64;
            for pulse in pulses {
                let wave = TwistWave { base_radps, harmonics: pulse.harmonics.clone() };
                let length = (pulse.envelope.total_s() / step_s).round() as u64;
                for i in 0..length {
                    recorder.take_until(steps as f64 * step_s, step_s, &moving);
                    let t_s = (i as f64 + 0.5) * step_s;
                    let twist = wave.at(t_s) * pulse.envelope.at(t_s);
                    moving.step(&PlateMotion { twist, ..Default::default() });
                    steps += 1;
                }
            }
            recorder.take_until(steps as f64 * step_s, step_s, &moving);
        }
        PlateMode::Dynamic => {
            let mut plant = Plant::new(params, parts, &Streams::new(0));
            for pulse in pulses {
                let drive = ideal_drive(params, pulse, base_radps)?;
                let length = (drive.envelope.total_s() / step_s).round() as u64;
                plant.play(drive);
                for _ in 0..length {
                    recorder.take_until(plant.now().secs(), step_s, plant.parts());
                    plant.step();
                }
            }
            recorder.take_until(plant.now().secs(), step_s, plant.parts());
        }
    }
    Ok(recorder.done)
}

fn check(pulse: &OpenPulse) -> Result<(), String> {
    const LONGEST_S: f64 = 600.0;
    let is_finite = |twist: &Twist| (twist.velocity_mps.norm() + twist.spin_radps).is_finite();
    let Envelope { attack_s, sustain_s, rest_s } = pulse.envelope;
    if !pulse.harmonics.iter().all(|harmonic| is_finite(&harmonic.cos) && is_finite(&harmonic.sin)) {
        Err("its motion is not a number".to_owned())
    } else if pulse.harmonics.len() > MOST_HARMONICS {
        Err("it has more than 16 harmonics".to_owned())
    } else if ![attack_s, sustain_s, rest_s].iter().all(|s| (0.0..=LONGEST_S).contains(s)) {
        Err("attack, sustain and rest lie between 0 and 600 s".to_owned())
    } else {
        Ok(())
    }
}

/// The drive whose forces give a free mass the pulse's velocity, `f = m dv/dt` on each axis, shared evenly among the
/// motors. Spring and damper are ignored.
pub(super) fn ideal_drive(params: &SimParams, pulse: &OpenPulse, base_radps: f64) -> Result<Drive, String> {
    let motors = &params.motors;
    let mut drive = Drive { base_radps, envelope: pulse.envelope, ..Default::default() };
    for (k, harmonic) in (1..).zip(&pulse.harmonics) {
        let counts = |twist: Twist| counts_of_acceleration(params, twist * (f64::from(k) * base_radps));
        // d/dt (c cos kwt + s sin kwt) = kw (s cos kwt - c sin kwt)
        let (cos, sin) = (counts(harmonic.sin), counts(-harmonic.cos));
        for ((motor, cos), sin) in drive.motors.iter_mut().zip(cos).zip(sin) {
            motor.push(Harmonic { cos, sin });
        }
    }

    let peak_counts = drive.peak_counts();
    let beyond = |limit: f64, digits: usize, unit: &str, peak: f64| {
        format!("expected up to {limit:.digits$} {unit} at each motor, found a peak of {peak:.digits$}; make it slower")
    };
    if peak_counts > motors.count_limit {
        return Err(beyond(motors.count_limit, 0, "counts", peak_counts));
    }
    let peak_n = peak_counts * motors.newtons_per_count;
    if peak_n > motors.force_limit_n {
        return Err(beyond(motors.force_limit_n, 1, "N", peak_n));
    }
    Ok(drive)
}

/// Counts of each motor that give the free plate `acceleration` (m/s², rad/s²).
fn counts_of_acceleration(params: &SimParams, acceleration: Twist) -> [f64; MOTORS] {
    let (plate, motors) = (&params.plate, &params.motors);
    let force_n = acceleration.velocity_mps * plate.mass_kg;
    let wrench = Wrench::new(force_n.x, force_n.y, acceleration.spin_radps * plate.inertia_kgm2);
    motors.arrangement.turned(forces_of_wrench(wrench, motors.lever_arm_m)).map(|n| n / motors.newtons_per_count)
}

/// Samples trajectories at exact instants from steps of another length.
struct TrajectoryRecorder {
    sample_hz: f64,
    done: OpenLoopTrajectories,
}

impl TrajectoryRecorder {
    /// Takes all samples due up to `now_s`, the time of `parts`, none older than one step.
    fn take_until(&mut self, now_s: f64, step_s: f64, parts: &Parts) {
        const ROUNDING_S: f64 = 1e-9;
        loop {
            let due_s = self.done.t_s.len() as f64 / self.sample_hz;
            if due_s > now_s + ROUNDING_S {
                return;
            }
            let before_s = (now_s - due_s).clamp(0.0, step_s);
            for (trajectory, part) in self.done.parts.iter_mut().zip(parts.motions()) {
                let pose = part.pose_before(before_s);
                trajectory.x_m.push(pose.position_m.x);
                trajectory.y_m.push(pose.position_m.y);
                trajectory.theta_rad.push(pose.heading_rad);
            }
            self.done.t_s.push(due_s);
        }
    }
}
