//! Fault diagnosis of a pulse: whether the plate moved as planned and, if not, which coil or accelerometer channel
//! explains it.
//!
//! Every explanation predicts the accelerometer readings ([`accelerometer_phasors`]). A prediction is compared with the
//! reading by `score² = mean of |difference|² / tolerance²` over all coefficients, and accepted up to a limit near 1.
//! The simplest accepted explanation is the verdict: the plan, then one coil, channel or pair of coils, the best of
//! those accepted.
//!
//! A coil or channel without a share in the planned motion cannot be judged by it: such a pulse is as planned.

mod coils;
mod reading;

use nalgebra::{Complex, Vector3};

use self::reading::{DEVIATIONS, TraceReading};
use super::accelerometer_phasors::{AccelerometerPhasors, Velocity, accelerometer_phasors};
use super::{AccelerometerPair, FitFault, PlateFit, WEAKEST_MPS2};
use upm_core::geometry::Vec2;
use upm_core::phasor::magnitude;
use upm_core::signal::{CHANNELS, Drive, MOTORS, TwistHarmonic, TwistWave};

pub use self::coils::BEARABLE_GAINS;

/// [`DEVIATIONS`] when a single period was read. The fit's polynomial then follows the plate's resonance only in part:
/// healthy coefficients are up to 8 standard deviations off.
const DEVIATIONS_ONE_PERIOD: f64 = 14.0;

/// Allowed error of the library's response, as a fraction of the planned acceleration, or of the explained one where
/// that is larger. Over two periods or more healthy pulses are off by up to 0.013 on the strong rig and 0.022 on the
/// weak one, noise included.
const RESPONSE_ERROR: f64 = 0.02;

/// Smallest gain error that is attributed to its coil or channel.
const LEAST_GAIN_ERROR: f64 = 0.05;

/// Planned acceleration from which a pulse must be readable, in units of [`WEAKEST_MPS2`].
const STRONG: f64 = 4.0;

/// Fraction of the measured acceleration's energy by which two accelerometers may differ along the line between them.
const RIGID: f64 = 0.04;

/// Base periods of sustain from which a pulse must be readable: one, and a margin since samples do not fall on the
/// edges.
const READABLE_PERIODS: f64 = 1.05;

/// The planned motion of a pulse.
#[derive(Clone, Copy, Debug)]
pub struct ExpectedMotion<'a> {
    /// Drive sent to the motors.
    pub drive: &'a Drive,
    /// For each voice coil and harmonic k, at index `k - 1`: the plate's steady velocity under one count of `cos kwt`
    /// of that coil alone, times from the start of the pulse.
    pub coils: &'a [Vec<TwistHarmonic>; MOTORS],
    /// Most that the friction of the parts on the plate changes its acceleration by, m/s². Calibration moves few.
    pub load_mps2: f64,
    /// Deviation, in tolerances, from which on a motion is not as planned, and an explanation does not hold.
    pub limit: f64,
}

/// Deviation of a pulse from the plan, and its explanation.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MotionJudgement {
    /// Difference from the plan; `None` where the trace could not be read.
    pub mismatch: Option<Mismatch>,
    /// Explanation of the difference.
    pub verdict: MotionVerdict,
    /// The best explanation by another coil, channel or pair of coils, where one coil, channel or pair is the verdict.
    pub runner_up: Option<RunnerUp>,
}

/// The explanation that the senses can tell least from the verdict.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RunnerUp {
    /// The explanation.
    pub verdict: MotionVerdict,
    /// Odds of the judgement's verdict over it: the ratio of their likelihoods, were each tolerance a standard
    /// deviation. Tolerances are wider, so the true odds are higher.
    pub odds: f64,
}

/// Difference between the planned and the measured motion.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Mismatch {
    /// Norm of measured minus planned acceleration, all channels and harmonics, over that of the planned.
    pub relative: f64,
    /// The same difference in units of the tolerance; up to the limit the pulse is as planned.
    pub score: f64,
}

/// Explanation of a measured motion.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum MotionVerdict {
    /// The plate moved as planned.
    AsPlanned,
    /// The plate moved as planned, but one accelerometer channel does not show it.
    Channel {
        /// Index of the channel.
        channel: usize,
        /// Deviation of its signal from the plan.
        kind: ChannelFault,
    },
    /// One coil's force is not as planned.
    Coil {
        /// Index into [`upm_core::signal::Motor::ALL`].
        coil: usize,
        /// Its force over the planned one: 0 for a dead coil, -1 for a reversed one.
        gain: f64,
    },
    /// Two coils are exchanged: each plays the other's signal.
    Swapped {
        /// Indices into [`upm_core::signal::Motor::ALL`].
        coils: [usize; 2],
    },
    /// The channels contradict each other: no rigid motion of the plate gives these readings.
    Channels,
    /// Not as planned, and no single coil, channel or pair of coils explains it.
    Other,
    /// The trace could not be read, or the noise exceeds the motion.
    Unreadable {
        /// True when the planned motion is strong and long enough to be read, so that plate or sensors have failed.
        strong: bool,
    },
}

/// Fault of an accelerometer channel.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum ChannelFault {
    /// Shows the motion with this gain: 0 where it is dead, -1 where its sign is wrong.
    Gain(f64),
    /// Shows something else; the other three agree with the plan.
    Erratic,
}

/// Judges a pulse by the fit of its trace.
pub fn judge(
    expected: &ExpectedMotion<'_>,
    fit: Result<&PlateFit, &FitFault>,
    sensors: &AccelerometerPair,
) -> MotionJudgement {
    let fault = match fit {
        Ok(fit) => return PulseJudge::new(expected, TraceReading::of(fit), sensors).judgement(),
        Err(fault) => fault,
    };
    let harmonics = expected.drive.motors.iter().map(Vec::len).max().unwrap_or(0);
    let planned = expected.readings(harmonics, AS_PLANNED, sensors);
    // these two mean that this rig's traces can never be read this way, whatever the plate does
    let never = matches!(fault, FitFault::Unreadable(_) | FitFault::Undetermined { .. });
    let verdict = MotionVerdict::Unreadable { strong: !never && is_strong(expected, &planned) };
    MotionJudgement { mismatch: None, verdict, runner_up: None }
}

/// True for a motion strong enough that accelerometers have to show it.
fn is_strong(expected: &ExpectedMotion<'_>, planned: &AccelerometerPhasors) -> bool {
    let largest_mps2 = planned.iter().flatten().map(|a| magnitude(*a)).fold(0.0, f64::max);
    expected.periods() >= READABLE_PERIODS && largest_mps2 >= STRONG * WEAKEST_MPS2
}

/// For each coil, the one whose signal it is assumed to play, and the share of that.
type PlayedSignals = [(usize, f64); MOTORS];

/// Every coil plays its own signal.
const AS_PLANNED: PlayedSignals = [(0, 1.0), (1, 1.0), (2, 1.0), (3, 1.0)];

impl ExpectedMotion<'_> {
    /// The plate's velocity at full height, times from the start of the pulse.
    pub fn wave(&self) -> TwistWave {
        let Drive { base_radps, motors, .. } = self.drive;
        let harmonics = motors.iter().map(Vec::len).max().unwrap_or(0);
        let harmonics = self.velocity(harmonics, AS_PLANNED).iter().map(TwistHarmonic::from_phasor).collect();
        TwistWave { base_radps: *base_radps, harmonics }
    }

    /// Base periods of the pulse's sustain.
    fn periods(&self) -> f64 {
        self.drive.envelope.sustain_s * self.drive.base_radps / std::f64::consts::TAU
    }

    /// The accelerometers' readings of [`Self::velocity`].
    fn readings(&self, harmonics: usize, played: PlayedSignals, sensors: &AccelerometerPair) -> AccelerometerPhasors {
        accelerometer_phasors(&self.velocity(harmonics, played), self.drive.base_radps, sensors.position_m)
    }

    /// The plate's velocity in `harmonics` harmonics; those absent from drive or response are zero.
    fn velocity(&self, harmonics: usize, played: PlayedSignals) -> Velocity {
        let mut velocity = vec![Vector3::zeros(); harmonics];
        for (answers, (of, share)) in self.coils.iter().zip(played) {
            for ((sum, answer), counts) in velocity.iter_mut().zip(answers).zip(&self.drive.motors[of]) {
                *sum += answer.phasor() * (counts.phasor() * share);
            }
        }
        velocity
    }
}

/// A reading and the planned one, under comparison.
struct PulseJudge<'a> {
    expected: &'a ExpectedMotion<'a>,
    sensors: &'a AccelerometerPair,
    read: TraceReading,
    planned: AccelerometerPhasors,
    /// Square of the tolerance of each coefficient for noise and load alone, (m/s²)², harmonic by harmonic.
    noise: Vec<f64>,
    /// Inverse square of the tolerance of each coefficient of the planned motion, (m/s²)⁻², harmonic by harmonic.
    weights: Vec<f64>,
}

impl<'a> PulseJudge<'a> {
    fn new(expected: &'a ExpectedMotion<'a>, read: TraceReading, sensors: &'a AccelerometerPair) -> Self {
        let planned = expected.readings(read.variance.len(), AS_PLANNED, sensors);
        let deviations = if expected.periods() < 2.0 { DEVIATIONS_ONE_PERIOD } else { DEVIATIONS };
        // the residual of a channel full of noise says nothing about the others
        let others = CHANNELS as f64 / (CHANNELS - 1) as f64;
        let share = read.noisy.map_or(1.0, |(_, share)| (1.0 - share) * others);
        let load = expected.load_mps2 * expected.load_mps2 / (2 * read.variance.len().max(1)) as f64;
        let noise = read.variance.iter().map(|variance| deviations * deviations * share * variance + load);
        let noise: Vec<f64> = noise.collect();
        let response = response_variance(&planned);
        let weights = noise.iter().map(|noise| (noise + response).recip()).collect();
        Self { expected, sensors, read, planned, noise, weights }
    }

    /// The judgement, without a channel that is full of noise.
    fn judgement(&self) -> MotionJudgement {
        let without = self.read.noisy.map(|(channel, _)| channel);
        let size: f64 = self.planned.iter().map(|of| distance(of, &Default::default(), without)).sum();
        let rows = self.planned.iter().zip(&self.read.accel_mps2);
        let difference: f64 = rows.map(|(a, b)| distance(a, b, without)).sum();
        let mismatch = Mismatch { relative: (difference / size).sqrt(), score: self.score(&self.planned, without) };
        let (verdict, runner_up) = match (without, mismatch.score <= self.expected.limit) {
            (None, false) => self.explanation(),
            (None, true) if self.is_drowned() && is_strong(self.expected, &self.planned) => {
                (MotionVerdict::Unreadable { strong: true }, None)
            }
            (None, true) => (MotionVerdict::AsPlanned, None),
            (Some(_), false) => (MotionVerdict::Other, None),
            (Some(channel), true) => (MotionVerdict::Channel { channel, kind: ChannelFault::Erratic }, None),
        };
        MotionJudgement { mismatch: Some(mismatch), verdict, runner_up }
    }

    /// The best explanation, if one is accepted, and its runner-up.
    fn explanation(&self) -> (MotionVerdict, Option<RunnerUp>) {
        let pairs = (0..MOTORS).flat_map(|a| (a + 1..MOTORS).map(move |b| [a, b]));
        let coils = (0..MOTORS).map(|coil| self.coil(coil));
        let channels = (0..CHANNELS).map(|channel| self.channel(channel));
        let swaps = pairs.map(|coils| self.swap(coils));
        let mut ranked: Vec<(f64, MotionVerdict)> = coils.chain(channels).chain(swaps).collect();
        ranked.sort_by(|(a, _), (b, _)| a.total_cmp(b));
        if let [(best, verdict), (other, runner_up), ..] = ranked[..]
            && best <= self.expected.limit
        {
            let coefficients = (2 * CHANNELS * self.noise.len()) as f64;
            let odds = libm::exp(0.5 * coefficients * (other * other - best * best));
            return (verdict, other.is_finite().then_some(RunnerUp { verdict: runner_up, odds }));
        }
        let erratic = (0..CHANNELS).map(|channel| (self.score(&self.planned, Some(channel)), channel));
        let verdict = match erratic.min_by(|(a, _), (b, _)| a.total_cmp(b)) {
            Some((score, channel)) if score <= self.expected.limit => {
                MotionVerdict::Channel { channel, kind: ChannelFault::Erratic }
            }
            _ if !self.is_rigid() => MotionVerdict::Channels,
            _ => self.one_coil_of_weak_ones().unwrap_or(MotionVerdict::Other),
        };
        (verdict, None)
    }

    /// True when noise exceeds the planned motion in every harmonic.
    fn is_drowned(&self) -> bool {
        let planned = self.planned.iter().map(|of| of.iter().map(Complex::norm_sqr).sum::<f64>());
        planned.zip(&self.read.variance).all(|(planned, variance)| planned < 2.0 * CHANNELS as f64 * variance)
    }

    /// True when a rigid plate can move as the channels show: both accelerometers show the same along the line between
    /// them.
    fn is_rigid(&self) -> bool {
        let along: Vec2 = self.sensors.position_m / self.sensors.position_m.norm();
        let (x, y) = (along.x, along.y);
        let apart = |[x1, y1, x2, y2]: &[Complex<f64>; CHANNELS]| ((x1 - x2) * x + (y1 - y2) * y).norm_sqr();
        let apart: f64 = self.read.accel_mps2.iter().map(apart).sum();
        let noise = 4.0 * self.read.variance.iter().sum::<f64>();
        apart < DEVIATIONS * DEVIATIONS * noise + RIGID * energy(&self.read.accel_mps2)
    }

    /// Score and verdict for the gain of `channel` that fits the reading best.
    fn channel(&self, channel: usize) -> (f64, MotionVerdict) {
        let only = channel..channel + 1;
        let information = self.dot(&self.planned, &self.planned, only.clone());
        let gain = self.dot(&self.planned, &self.read.accel_mps2, only) / information;
        let shown = self.planned.iter().map(|planned| {
            let mut shown = *planned;
            shown[channel] *= gain;
            shown
        });
        let score = if is_fault(gain) { self.score(&shown.collect(), None) } else { f64::INFINITY };
        (score, MotionVerdict::Channel { channel, kind: ChannelFault::Gain(gain) })
    }

    /// Deviation of the reading from `predicted` in tolerances, root mean square over all channels or those `without`
    /// one. The response's error grows with the motion: a coil that gives more than planned, or the other way, may move
    /// the plate farther than planned.
    fn score(&self, predicted: &AccelerometerPhasors, without: Option<usize>) -> f64 {
        let response = response_variance(predicted).max(response_variance(&self.planned));
        let rows = predicted.iter().zip(&self.read.accel_mps2).zip(&self.noise);
        let sum: f64 = rows.map(|((a, b), noise)| distance(a, b, without) / (noise + response)).sum();
        let channels = CHANNELS - usize::from(without.is_some());
        (sum / (2 * channels * self.noise.len()) as f64).sqrt()
    }

    /// Weighted inner product over `channels`.
    fn dot(&self, a: &AccelerometerPhasors, b: &AccelerometerPhasors, channels: std::ops::Range<usize>) -> f64 {
        let rows = a.iter().zip(b).zip(&self.weights);
        rows.map(|((a, b), weight)| weight * channels.clone().map(|c| (a[c].conj() * b[c]).re).sum::<f64>()).sum()
    }
}

/// True for a gain far enough from 1 to be reported as a fault.
fn is_fault(gain: f64) -> bool {
    (gain - 1.0).abs() >= LEAST_GAIN_ERROR
}

/// Square of the tolerance of each coefficient for the response's error in the motion `accelerometer_phasors`,
/// (m/s²)².
fn response_variance(accelerometer_phasors: &AccelerometerPhasors) -> f64 {
    RESPONSE_ERROR * RESPONSE_ERROR * energy(accelerometer_phasors)
        / (2 * CHANNELS * accelerometer_phasors.len()) as f64
}

fn energy(accelerometer_phasors: &AccelerometerPhasors) -> f64 {
    accelerometer_phasors.iter().flatten().map(Complex::norm_sqr).sum()
}

/// Square of the difference in all channels or those `without` one.
fn distance(a: &[Complex<f64>; CHANNELS], b: &[Complex<f64>; CHANNELS], without: Option<usize>) -> f64 {
    let channels = (0..CHANNELS).filter(|channel| Some(*channel) != without);
    channels.map(|channel| (a[channel] - b[channel]).norm_sqr()).sum()
}

#[cfg(test)]
mod tests;
