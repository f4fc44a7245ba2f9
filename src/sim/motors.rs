//! From the drive's counts to the forces on the plate: waveform generator (whole counts, held between samples),
//! low-pass, voice coils, and the sum of their forces on the plate (UPM paper, sections 3.1 and 3.2, Eq. 7).

use std::f64::consts::{FRAC_1_SQRT_2, TAU};

use super::MotorParams;
use super::drive_sequence::DriveSequence;
use super::faults::CoilFaults;
use super::oscillator::{ModeState, Oscillator};
use super::plate::Wrench;
use upm_core::signal::{Drive, Envelope, MOTORS};

/// A drive's largest sample relative to the largest over the phases of [`Drive::peak_counts`], at most.
const PHASES_MISS: f64 = 1.003;

/// Four voice coils with their amplifiers.
#[derive(Clone, Debug)]
pub(crate) struct Motors {
    params: MotorParams,
    step_s: f64,
    low_pass: LowPass,
    filtered: [ModeState; MOTORS],
    drives: DriveSequence,
    /// Samples that play in the place of drives, whole counts.
    samples: Vec<[i16; MOTORS]>,
    steps: u64,
    held_sample: Option<u64>,
    held_counts: [f64; MOTORS],
    faults: CoilFaults,
    /// Coils whose amplifier has an additional low-pass.
    slow: [Option<(LowPass, ModeState)>; MOTORS],
}

/// A second-order Butterworth filter.
#[derive(Clone, Copy, Debug)]
struct LowPass {
    oscillator: Oscillator,
    gain: f64,
}

impl LowPass {
    fn new(corner_hz: f64, step_s: f64) -> Self {
        let corner_radps = TAU * corner_hz;
        let oscillator = Oscillator::new(corner_radps, FRAC_1_SQRT_2, step_s);
        Self { oscillator, gain: corner_radps * corner_radps }
    }

    fn step(&self, from: ModeState, input: f64) -> ModeState {
        self.oscillator.step(from, self.gain * input)
    }

    /// True if its output is below a thousandth of a count and stays so without input.
    fn has_decayed(&self, filtered: &ModeState) -> bool {
        filtered.position.abs() < 1e-3 && filtered.velocity.abs() < 1e-3 * self.gain.sqrt()
    }
}

impl Motors {
    /// Silent motors for steps of `step_s`.
    pub fn new(params: &MotorParams, step_s: f64) -> Self {
        Self {
            params: *params,
            step_s,
            low_pass: LowPass::new(params.low_pass_hz, step_s),
            filtered: [ModeState::default(); MOTORS],
            drives: DriveSequence::default(),
            samples: Vec::new(),
            steps: 0,
            held_sample: None,
            held_counts: [0.0; MOTORS],
            faults: CoilFaults::default(),
            slow: [None; MOTORS],
        }
    }

    /// Replaces all faults of the coils by `faults`.
    pub fn set_faults(&mut self, faults: &CoilFaults) {
        let CoilFaults { stuck: was_stuck, low_pass_hz: were_hz, .. } = std::mem::replace(&mut self.faults, *faults);
        for ((slow, corner_hz), was_hz) in self.slow.iter_mut().zip(faults.low_pass_hz).zip(were_hz) {
            // the output of a coil that stays slow goes on
            if corner_hz != was_hz {
                let slow_coil = || (LowPass::new(corner_hz, self.step_s), ModeState::default());
                *slow = corner_hz.is_finite().then(slow_coil);
            }
        }
        if self.is_over() {
            // without a drive the amplifiers receive zero, so a freed coil returns to it; under a drive the next sample
            // sets it
            let freed = was_stuck.iter().zip(faults.stuck).map(|(was, is)| *was && !is);
            self.held_counts.iter_mut().zip(freed).filter(|(_, freed)| *freed).for_each(|(held, _)| *held = 0.0);
        }
    }

    /// Samples a second.
    pub fn sample_hz(&self) -> f64 {
        self.params.sample_hz
    }

    /// Starts `drive` now, replacing any other.
    pub fn start(&mut self, drive: Drive) {
        self.drives = DriveSequence::start(drive);
        (self.samples, self.steps, self.held_sample) = (Vec::new(), 0, None);
    }

    /// Plays `samples` now, in the place of any drive.
    pub fn start_samples(&mut self, samples: Vec<[i16; MOTORS]>) {
        self.drives = DriveSequence::default();
        (self.samples, self.steps, self.held_sample) = (samples, 0, None);
    }

    /// True when nothing plays.
    #[inline(always)]
    fn is_over(&self) -> bool {
        self.drives.is_over() && self.samples.is_empty()
    }

    /// Lets `drive` take over from the playing one; returns the time until then, s. `None` where it is too late.
    pub fn take_over(&mut self, drive: Drive) -> Option<f64> {
        let now_s = self.steps as f64 * self.step_s;
        self.drives.take_over(drive, now_s).map(|start_s| start_s - now_s)
    }

    /// Start and envelope of a drive that took over in the last step; see [`DriveSequence::taken_over`].
    #[inline(always)]
    pub fn taken_over(&mut self) -> Option<(f64, Envelope)> {
        self.drives.taken_over()
    }

    /// Largest count of any motor in `drive`, which starts from rest, sample by sample.
    pub fn peak_of(&self, drive: &Drive) -> f64 {
        self.peak_until(drive.envelope.driven_s(), |t_s| drive.counts_at(t_s))
    }

    /// Largest count of any motor while `drive` takes over and, where the drive alone may pass `limit_counts`, to its
    /// end.
    pub fn peak_of_take_over(&self, drive: &Drive, limit_counts: f64) -> f64 {
        let is_within = drive.peak_above(limit_counts / PHASES_MISS).is_none();
        let until_s = if is_within { self.drives.fade_s() } else { drive.envelope.driven_s() };
        self.peak_until(until_s, |t_s| self.drives.counts_of_take_over(drive, t_s))
    }

    fn peak_until(&self, until_s: f64, counts_at: impl Fn(f64) -> [f64; MOTORS]) -> f64 {
        let samples = (until_s * self.params.sample_hz).ceil() as u64;
        let counts = (0..samples).flat_map(|sample| counts_at(sample as f64 / self.params.sample_hz));
        counts.fold(0.0, |peak: f64, counts| peak.max(counts.abs()))
    }

    /// Cuts the amplifiers: no force from now on.
    pub fn stop(&mut self) {
        (self.drives, self.samples) = (DriveSequence::default(), Vec::new());
        self.held_counts = [0.0; MOTORS];
        self.filtered = [ModeState::default(); MOTORS];
        self.slow.iter_mut().flatten().for_each(|(_, filtered)| *filtered = ModeState::default());
    }

    /// True when no drive plays and the amplifiers' last current has decayed (below a thousandth of a count). A coil
    /// that a fault made slow may still push, which the controller does not know.
    pub fn is_idle(&self) -> bool {
        self.is_over() && self.filtered.iter().all(|filtered| self.low_pass.has_decayed(filtered))
    }

    /// True when idle, and slow coils have decayed, too.
    pub fn is_forceless(&self) -> bool {
        self.is_idle() && self.slow.iter().flatten().all(|(low_pass, filtered)| low_pass.has_decayed(filtered))
    }

    /// Advances one step and returns the wrench at its end. A step uses the generator's sample that is held at the
    /// step's middle, which is exact when steps divide samples.
    #[inline(always)]
    pub fn step(&mut self) -> Wrench {
        self.hold_sample();
        for (filtered, counts) in self.filtered.iter_mut().zip(self.held_counts) {
            *filtered = self.low_pass.step(*filtered, counts);
        }
        for (slow, filtered) in self.slow.iter_mut().zip(&self.filtered) {
            if let Some((low_pass, slowed)) = slow {
                *slowed = low_pass.step(*slowed, filtered.position);
            }
        }
        self.steps += 1;
        self.wrench()
    }

    #[inline(always)]
    fn hold_sample(&mut self) {
        if self.is_over() {
            return;
        }
        let sample = ((self.steps as f64 + 0.5) * self.step_s * self.params.sample_hz) as u64;
        if self.held_sample == Some(sample) {
            return;
        }
        self.held_sample = Some(sample);
        let counts = match self.samples.get(sample as usize) {
            Some(counts) => Some(counts.map(f64::from)),
            None => self.drives.counts_at(sample as f64 / self.params.sample_hz),
        };
        let Some(counts) = counts else {
            self.samples.clear();
            self.hold(|_| 0.0);
            return;
        };
        let limit = self.params.count_limit;
        let played = counts.map(|counts| counts.round().max(-limit).min(limit));
        self.hold(|motor| played[motor]);
    }

    /// Sets each motor to its `counts` from now on; a stuck coil keeps its own.
    fn hold(&mut self, counts: impl Fn(usize) -> f64) {
        let CoilFaults { source, stuck, .. } = self.faults;
        for ((held, source), stuck) in self.held_counts.iter_mut().zip(source).zip(stuck) {
            if !stuck {
                *held = counts(source);
            }
        }
    }

    /// The present wrench of the coils on the plate.
    pub fn wrench(&self) -> Wrench {
        let params = &self.params;
        let mut forces_n = [0.0; MOTORS];
        for (motor, force) in forces_n.iter_mut().enumerate() {
            let filtered = self.slow[motor].map_or(self.filtered[motor], |(_, slowed)| slowed);
            let wanted = filtered.position * params.newtons_per_count * (1.0 + params.gain_error[motor]);
            *force = (wanted * self.faults.gain[motor]).max(-params.force_limit_n).min(params.force_limit_n);
        }
        wrench_of_forces(params.arrangement.turned(forces_n), params.lever_arm_m)
    }
}

/// The wrench of forces (N, order of [`upm_core::signal::Motor::ALL`]) of motors around the plate (Eq. 7).
pub(crate) fn wrench_of_forces([x1, x2, y1, y2]: [f64; MOTORS], lever_arm_m: f64) -> Wrench {
    Wrench::new(x1 - x2, y1 - y2, lever_arm_m * ((y1 + y2) - (x1 + x2)))
}

/// The weakest forces of motors around the plate with the given wrench: the inverse of Eq. 7.
pub(crate) fn forces_of_wrench(wrench: Wrench, lever_arm_m: f64) -> [f64; MOTORS] {
    let (half, turn) = (wrench * 0.5, wrench.z / (4.0 * lever_arm_m));
    [half.x - turn, -half.x - turn, half.y + turn, -half.y + turn]
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use upm_core::geometry::Vec2;
    use upm_core::signal::{Harmonic, MotorArrangement};

    const PARAMS: MotorParams = MotorParams {
        lever_arm_m: 0.05,
        arrangement: MotorArrangement::Around,
        newtons_per_count: 0.02,
        gain_error: [0.0; 4],
        sample_hz: 20_000.0,
        count_limit: 511.0,
        low_pass_hz: 800.0,
        force_limit_n: 8.0,
    };

    fn steady(counts: f64, envelope: Envelope) -> Drive {
        let wave = vec![Harmonic { cos: counts, sin: 0.0 }];
        Drive { base_radps: TAU * 60.0, motors: [wave, vec![], vec![], vec![]], envelope, ..Drive::default() }
    }

    /// Fig. 4: around the plate, and beside each other, where X2 and Y2 push along +x and +y on the same lines, so that
    /// their torques change sign, too.
    #[test]
    fn each_motor_pushes_as_in_the_paper() {
        let around = [(1.0, 0.0, -1.0), (-1.0, 0.0, -1.0), (0.0, 1.0, 1.0), (0.0, -1.0, 1.0)];
        let beside = [(1.0, 0.0, -1.0), (1.0, 0.0, 1.0), (0.0, 1.0, 1.0), (0.0, 1.0, -1.0)];
        for (arrangement, pushes) in [(MotorArrangement::Around, around), (MotorArrangement::Beside, beside)] {
            for (motor, (fx, fy, turn)) in pushes.into_iter().enumerate() {
                let mut motors = Motors::new(&MotorParams { arrangement, ..PARAMS }, 5e-5);
                motors.held_counts[motor] = 100.0;
                let wrench = (0..2000).map(|_| motors.step()).last().unwrap();
                assert!((wrench.xy() - Vec2::new(2.0 * fx, 2.0 * fy)).norm() < 1e-9);
                assert!((wrench.z - 0.1 * turn).abs() < 1e-9);
            }
        }
    }

    proptest! {
        #[test]
        fn the_force_map_turns_round(fx in -9.0..9.0f64, fy in -9.0..9.0f64, torque in -1.0..1.0f64) {
            let wrench = Wrench::new(fx, fy, torque);
            let back = wrench_of_forces(forces_of_wrench(wrench, 0.05), 0.05);
            prop_assert!((back - wrench).xy().norm() < 1e-12 && (back.z - torque).abs() < 1e-12);
        }
    }

    /// Gain and delay of hold and Butterworth filter at 60 Hz against their transfer functions.
    #[test]
    fn the_low_pass_is_a_butterworth() {
        let mut motors = Motors::new(&PARAMS, 5e-5);
        motors.start(steady(200.0, Envelope { attack_s: 0.0, sustain_s: 1.0, rest_s: 0.0 }));
        let (mut cos, mut sin, w) = (0.0, 0.0, TAU * 60.0);
        for i in 1..=20_000 {
            let (s, c) = (w * f64::from(i) * 5e-5).sin_cos();
            let force = motors.step().x;
            if i > 10_000 {
                cos += force * c * 2e-4;
                sin += force * s * 2e-4;
            }
        }
        let x = 60.0 / PARAMS.low_pass_hz;
        let gain = (1.0 + x.powi(4)).sqrt().recip();
        let delay = (std::f64::consts::SQRT_2 * x).atan2(1.0 - x * x) + w * 2.5e-5;
        assert!((f64::hypot(cos, sin) / (4.0 * gain) - 1.0).abs() < 2e-3);
        assert!((sin.atan2(cos) - delay).abs() < 2e-3, "{} {delay}", sin.atan2(cos));
    }

    #[test]
    fn counts_are_whole_and_limited_and_so_are_forces() {
        let always = Envelope { attack_s: 0.0, sustain_s: 1.0, rest_s: 0.0 };
        let peak = |params: &MotorParams, counts| {
            let mut motors = Motors::new(params, 5e-5);
            motors.start(steady(counts, always));
            (0..4000).map(|_| motors.step().x.abs()).fold(0.0, f64::max)
        };
        assert_eq!(peak(&PARAMS, 0.4), 0.0, "less than half a count is nothing");
        assert_eq!(peak(&PARAMS, 500.0), 8.0, "the coil's limit");
        let strong_coils = MotorParams { force_limit_n: 1e3, ..PARAMS };
        assert!(peak(&strong_coils, 5e4) < 1.2 * 511.0 * 0.02, "the generator's limit");
        let uneven = MotorParams { gain_error: [0.1, 0.0, 0.0, 0.0], ..PARAMS };
        assert!((peak(&uneven, 100.0) / peak(&PARAMS, 100.0) - 1.1).abs() < 1e-12);
    }

    #[test]
    fn a_take_over_is_as_strong_as_both_drives_and_then_as_its_own() {
        let envelope = Envelope { attack_s: 1.0 / 30.0, sustain_s: 0.02, rest_s: 0.0 };
        for (playing, next) in [(500.0, 300.0), (100.0, 300.0)] {
            let mut motors = Motors::new(&PARAMS, 5e-5);
            motors.start(steady(playing, envelope));
            let drive = steady(next, envelope);
            let whole = motors.peak_until(envelope.driven_s(), |t_s| motors.drives.counts_of_take_over(&drive, t_s));
            assert!(whole > 0.99 * f64::max(playing, next) && whole < 1.2 * f64::max(playing, next), "{whole}");
            assert_eq!(motors.peak_of_take_over(&drive, 250.0), whole, "all of a strong one is looked at");
            for limit in [400.0, 0.999 * whole, 1.001 * whole] {
                assert_eq!(motors.peak_of_take_over(&drive, limit) > limit, whole > limit, "{playing} {limit}");
            }
        }
    }

    #[test]
    fn slow_coil_pushes_on_when_the_motors_are_idle() {
        let mut motors = Motors::new(&PARAMS, 5e-5);
        motors.set_faults(&CoilFaults {
            low_pass_hz: [5.0, f64::INFINITY, f64::INFINITY, f64::INFINITY],
            ..CoilFaults::default()
        });
        motors.start(steady(200.0, Envelope { attack_s: 0.01, sustain_s: 0.02, rest_s: 0.0 }));
        for _ in 0..900 {
            motors.step();
        }
        assert!(motors.is_idle() && !motors.is_forceless());
        for _ in 0..20_000 {
            motors.step();
        }
        assert!(motors.is_forceless());
    }
}
