//! Fault diagnosis of a pulse: whether the plate moved as planned and, if not, which coil or accelerometer channel
//! explains it.
//!
//! Every explanation predicts the accelerometer readings ([`accelerometer_phasors`]). A prediction is compared with the
//! reading by `score² = mean of |difference|² / tolerance²` over all coefficients, and accepted up to a limit near 1.
//! The simplest accepted explanation is the verdict: the plan, then one coil, channel or pair of coils, the best of
//! those accepted.
//!
//! A coil or channel without a share in the planned motion cannot be judged by it: such a pulse is as planned.

use nalgebra::{DVector, SMatrix, SVector, Vector3};

use super::accelerometer_phasors::{Velocity, accelerometer_phasors};
use super::take_over::TakeOver;
use super::{AccelerometerPair, FitError, PlateFit, WEAKEST_MPS2, WaveFit};
use upm_core::geometry::Vec2;
use upm_core::signal::{AccelTrace, CHANNELS, Drive, Harmonic, MOTORS, TwistHarmonic, TwistWave};

/// Tolerance of a coefficient in standard deviations when two periods or more were read, and when a single one was: the
/// fit's polynomial then follows the plate's resonance only in part, and healthy coefficients are up to 8 off.
const DEVIATIONS: f64 = 8.0;
const DEVIATIONS_ONE_PERIOD: f64 = 14.0;

/// Allowed error of the library's response, as a fraction of the planned acceleration, or of the explained one where
/// that is larger. Over two periods or more healthy pulses are off by up to 0.013 on the strong rig and 0.022 on the
/// weak one, noise included.
const RESPONSE_ERROR: f64 = 0.02;

/// Gains of a coil or channel that are not attributed to it as its fault.
const FAULTLESS_GAINS: std::ops::RangeInclusive<f64> = 0.95..=1.05;

/// Plausible gains of an amplifier and its coil; a gain outside them is the error of something else, attributed to a
/// coil with hardly any share in the motion.
const COIL_GAINS: std::ops::RangeInclusive<f64> = -1.6..=2.0;

/// Gains of a coil with which a run goes on, since the next observation compensates for them: those that an amplifier's
/// supply gives all its coils.
pub const BEARABLE_GAINS: std::ops::RangeInclusive<f64> = 0.7..=1.4;

/// Planned acceleration from which a pulse must be readable, in units of [`WEAKEST_MPS2`].
const STRONG: f64 = 4.0;

/// Fraction of the measured acceleration's energy by which two accelerometers may differ along the line between them.
const RIGID: f64 = 0.04;

/// Base periods of sustain from which a pulse must be readable: one, and a margin since samples do not fall on the
/// edges.
const READABLE_PERIODS: f64 = 1.05;

/// Coefficients of a harmonic: a real and an imaginary one of each channel.
const COEFFICIENTS: usize = 2 * CHANNELS;

/// Acceleration coefficients, m/s², harmonic by harmonic; those of channel k are at `2 k` and `2 k + 1` of each.
type Readings = DVector<f64>;

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
    /// The motion that fades while this one rises, and the trace of that; `None` for pulses with a sustain.
    pub take_over: Option<&'a TakeOver>,
}

/// Deviation of a pulse from the plan, and its explanation.
#[derive(Clone, Debug, PartialEq)]
pub struct MotionJudgement {
    /// Norm of measured minus planned acceleration, all channels and harmonics, over that of the planned; 0 where the
    /// trace could not be read.
    pub off: f64,
    /// The same difference in units of the tolerance; `None` where the trace could not be read.
    pub score: Option<f64>,
    /// Explanation of the difference.
    pub verdict: MotionVerdict,
    /// The best explanation by another coil, channel or pair of coils, where one coil, channel or pair is the verdict,
    /// and the odds of the verdict over it: the ratio of their likelihoods, were each tolerance a standard deviation.
    /// Tolerances are wider, so the true odds are higher.
    pub runner_up: Option<(MotionVerdict, f64)>,
}

/// Explanation of a measured motion.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum MotionVerdict {
    /// The plate moved as planned, or was planned to move so little or briefly that it need not be readable.
    AsPlanned,
    /// The plate moved as planned, but the accelerometer channel of this index does not show it. Beside it the gain
    /// with which it shows the motion: 0 where it is dead, -1 where its sign is wrong; `None` where it shows something
    /// else, and the other three agree with the plan.
    Channel(usize, Option<f64>),
    /// The coil at this index into [`upm_core::signal::Motor::ALL`] does not give its planned force. Beside it the
    /// share that it gives: 0 for a dead coil, -1 for a reversed one.
    Coil(usize, f64),
    /// The coils at these indices are exchanged: each plays the other's signal.
    Swapped([usize; 2]),
    /// The channels contradict each other: no rigid motion of the plate gives these readings.
    Channels,
    /// Not as planned, and no single coil, channel or pair of coils explains it.
    Other,
    /// The trace could not be read, or the noise exceeds the motion, which is strong and long enough to be read: plate
    /// or sensors have failed.
    Unreadable,
}

/// Judges a pulse by the fit of its trace.
pub fn judge(
    expected: &ExpectedMotion<'_>,
    fit: Result<&PlateFit, &FitError>,
    sensors: &AccelerometerPair,
) -> MotionJudgement {
    let fault = match fit {
        Ok(fit) => return PulseJudge::new(expected, fit.motion(), sensors).judgement(),
        Err(fault) => fault,
    };
    let planned = expected.readings(expected.harmonics(), sensors);
    // these two mean that this rig's traces can never be read this way, whatever the plate does
    let never = matches!(fault, FitError::Unreadable(_) | FitError::Undetermined { .. });
    let is_fault = !never && expected.must_be_readable(&planned);
    let verdict = if is_fault { MotionVerdict::Unreadable } else { MotionVerdict::AsPlanned };
    MotionJudgement { off: 0.0, score: None, verdict, runner_up: None }
}

impl ExpectedMotion<'_> {
    /// The plate's velocity at full height, times from the start of the pulse.
    pub fn wave(&self) -> TwistWave {
        let harmonics = self.velocity(self.drive, self.harmonics()).iter().map(TwistHarmonic::from_phasor).collect();
        TwistWave { base_radps: self.drive.base_radps, harmonics }
    }

    /// Fits the plate's motion to the trace of a take-over.
    ///
    /// # Errors
    /// As [`super::fit_wave`], and [`FitError::Unreadable`] for a motion that takes over from none.
    pub fn fit_take_over(&self, trace: &AccelTrace, sensors: &AccelerometerPair) -> Result<WaveFit, FitError> {
        let take_over = self.take_over.ok_or(FitError::Unreadable("no motion takes over"))?;
        take_over.fit(trace, self.drive, |drive| self.velocity(drive, self.harmonics()), sensors)
    }

    fn harmonics(&self) -> usize {
        self.drive.motors.iter().map(Vec::len).max().unwrap_or(0)
    }

    /// Base periods of the pulse's sustain.
    fn periods(&self) -> f64 {
        self.drive.envelope.sustain_s * self.drive.base_radps / std::f64::consts::TAU
    }

    /// True for a motion strong and long enough that accelerometers have to show it.
    fn must_be_readable(&self, planned: &Readings) -> bool {
        let is_strong = |a: &[f64; 2]| a[0] * a[0] + a[1] * a[1] >= (STRONG * WEAKEST_MPS2).powi(2);
        let is_long = self.take_over.is_some() || self.periods() >= READABLE_PERIODS;
        is_long && planned.as_slice().as_chunks().0.iter().any(is_strong)
    }

    /// The accelerometers' readings of [`Self::velocity`].
    fn readings(&self, harmonics: usize, sensors: &AccelerometerPair) -> Readings {
        if let Some(take_over) = self.take_over {
            let velocity = |drive: &Drive| self.velocity(drive, harmonics);
            let coefficients = take_over.coefficients(self.drive, velocity, sensors.position_m);
            // cos and sin of a channel are the parts of its phasor `cos - j sin`
            return Readings::from_fn(COEFFICIENTS * harmonics, |i, _| {
                let (harmonic, channel) = (i / COEFFICIENTS, channel_of(i));
                coefficients[(2 * harmonic + i % 2, channel)] * [1.0, -1.0][i % 2]
            });
        }
        let phasors =
            accelerometer_phasors(&self.velocity(self.drive, harmonics), self.drive.base_radps, sensors.position_m);
        Readings::from_iterator(COEFFICIENTS * harmonics, phasors.iter().flatten().flat_map(|a| [a.re, a.im]))
    }

    /// The plate's velocity under `drive` in `harmonics` harmonics; those absent from drive or response are zero.
    fn velocity(&self, drive: &Drive, harmonics: usize) -> Velocity {
        let mut velocity = vec![Vector3::zeros(); harmonics];
        for (answers, wave) in self.coils.iter().zip(&drive.motors) {
            for ((sum, answer), counts) in velocity.iter_mut().zip(answers).zip(wave) {
                *sum += answer.phasor() * counts.phasor();
            }
        }
        velocity
    }
}

/// A reading and the planned one, under comparison.
struct PulseJudge<'a> {
    expected: &'a ExpectedMotion<'a>,
    sensors: &'a AccelerometerPair,
    read: Readings,
    /// Variance of each coefficient, (m/s²)²: the mean of cos and sin coefficient of its harmonic.
    variance: Readings,
    /// The channel that is full of noise, if one is.
    noisy: Option<usize>,
    planned: Readings,
    /// Square of the tolerance of each coefficient for noise and load alone, (m/s²)².
    noise: Readings,
}

impl<'a> PulseJudge<'a> {
    fn new(expected: &'a ExpectedMotion<'a>, read: &WaveFit, sensors: &'a AccelerometerPair) -> Self {
        let WaveFit { accel_mps2, accel_sd_mps2, channel_residual_mps2, .. } = read;
        let harmonics = accel_sd_mps2.len();
        let planned = expected.readings(harmonics, sensors);
        let read = Readings::from_fn(planned.len(), |i, _| {
            let [cos, sin] = accel_mps2[channel_of(i)].get(i / COEFFICIENTS).copied().unwrap_or_default();
            [cos, -sin][i % 2]
        });
        let variance = Readings::from_fn(planned.len(), |i, _| {
            let [cos, sin] = accel_sd_mps2[i / COEFFICIENTS];
            0.5 * (cos * cos + sin * sin)
        });
        let (noisy, share) = noisy(channel_residual_mps2);
        let is_short = expected.take_over.is_none() && expected.periods() < 2.0;
        let deviations = if is_short { DEVIATIONS_ONE_PERIOD } else { DEVIATIONS };
        let load = expected.load_mps2 * expected.load_mps2 / (2 * harmonics.max(1)) as f64;
        let noise = (&variance * (deviations * deviations * share)).add_scalar(load);
        Self { expected, sensors, read, variance, noisy, planned, noise }
    }

    /// The judgement, without a channel that is full of noise.
    fn judgement(&self) -> MotionJudgement {
        let without = self.noisy;
        let off = (energy(&(&self.planned - &self.read), without) / energy(&self.planned, without)).sqrt();
        let score = self.score(&self.planned, without);
        let (verdict, runner_up) = match (without, score <= self.expected.limit) {
            (None, false) => self.explanation(),
            (None, true) if self.is_drowned() && self.expected.must_be_readable(&self.planned) => {
                (MotionVerdict::Unreadable, None)
            }
            (None, true) => (MotionVerdict::AsPlanned, None),
            (Some(_), false) => (MotionVerdict::Other, None),
            (Some(channel), true) => (MotionVerdict::Channel(channel, None), None),
        };
        MotionJudgement { off, score: Some(score), verdict, runner_up }
    }

    /// The first explanation that is accepted, and the next one with its odds where both have rank 0.
    fn explanation(&self) -> (MotionVerdict, Option<(MotionVerdict, f64)>) {
        let mut ranked = self.explanations();
        ranked.sort_by(|a, b| a.0.cmp(&b.0).then(a.1.total_cmp(&b.1)));
        let accepted = ranked.iter().position(|(_, score, _)| *score <= self.expected.limit);
        let (verdict, rank, best) =
            accepted.map_or((MotionVerdict::Other, 1, 0.0), |i| (ranked[i].2, ranked[i].0, ranked[i].1));
        let odds = |other: f64| libm::exp(0.5 * self.read.len() as f64 * (other * other - best * best));
        let runner_up = ranked.get(1).filter(|(other, ..)| rank + other == 0);
        (verdict, runner_up.map(|(_, other, runner_up)| (*runner_up, odds(*other))))
    }

    /// All explanations with their ranks and their scores at the gains that fit the reading best. The simpler come
    /// first: 0 for one coil, channel or pair of coils; 1 for a channel that shows something else; 2 for channels that
    /// disagree; 3 for one coil with one gain while the other three share another, as under a sagging supply.
    fn explanations(&self) -> Vec<(u8, f64, MotionVerdict)> {
        let mut all = Vec::new();
        for coil in 0..MOTORS {
            let others = self.driven(|motors| motors[coil].clear());
            let own = &self.planned - &others;
            if let Some((score, [gain])) = self.fitted(&others, [&own])
                && !FAULTLESS_GAINS.contains(&gain)
                && COIL_GAINS.contains(&gain)
            {
                all.push((0, score, MotionVerdict::Coil(coil, gain)));
            }
            if let Some((score, [gain, shared])) = self.fitted(&(&own * 0.0), [&own, &others])
                && !FAULTLESS_GAINS.contains(&(gain / shared))
                && COIL_GAINS.contains(&gain)
                && BEARABLE_GAINS.contains(&shared)
            {
                all.push((3, score, MotionVerdict::Coil(coil, gain)));
            }
            for other in coil + 1..MOTORS {
                let swapped = self.driven(|motors| motors.swap(coil, other));
                all.push((0, self.score(&swapped, None), MotionVerdict::Swapped([coil, other])));
            }
        }
        for channel in 0..CHANNELS {
            let own = self.planned.map_with_location(|i, _, a| if channel_of(i) == channel { a } else { 0.0 });
            if let Some((score, [gain])) = self.fitted(&(&self.planned - &own), [&own])
                && !FAULTLESS_GAINS.contains(&gain)
            {
                all.push((0, score, MotionVerdict::Channel(channel, Some(gain))));
            }
            all.push((1, self.score(&self.planned, Some(channel)), MotionVerdict::Channel(channel, None)));
        }
        all.push((2, if self.is_rigid() { f64::INFINITY } else { 0.0 }, MotionVerdict::Channels));
        all
    }

    /// Score of the sum of `rest` and `parts`, each at the gain that fits the reading best.
    fn fitted<const N: usize>(&self, rest: &Readings, parts: [&Readings; N]) -> Option<(f64, [f64; N])> {
        let tolerance2 = self.noise.add_scalar(response_variance(&self.planned));
        let dot = |a: &Readings, b: &Readings| a.component_div(&tolerance2).dot(b);
        let normal = SMatrix::<f64, N, N>::from_fn(|row, column| dot(parts[row], parts[column]));
        let seen = SVector::<f64, N>::from_fn(|row, _| dot(parts[row], &(&self.read - rest)));
        let gains: [f64; N] = (normal.try_inverse()? * seen).into();
        let predicted = parts.iter().zip(gains).fold(rest.clone(), |sum, (part, gain)| sum + *part * gain);
        Some((self.score(&predicted, None), gains))
    }

    /// The readings of another drive than the planned one.
    fn driven(&self, change: impl Fn(&mut [Vec<Harmonic>; MOTORS])) -> Readings {
        let mut drive = self.expected.drive.clone();
        change(&mut drive.motors);
        let mut take_over = self.expected.take_over.cloned();
        take_over.iter_mut().filter_map(|t| t.last.as_mut()).for_each(|last| change(&mut last.motors));
        ExpectedMotion { drive: &drive, take_over: take_over.as_ref(), ..*self.expected }
            .readings(self.planned.len() / COEFFICIENTS, self.sensors)
    }

    /// True when noise exceeds the planned motion in every harmonic.
    fn is_drowned(&self) -> bool {
        let harmonics = self.planned.as_slice().chunks(COEFFICIENTS).zip(self.variance.as_slice().chunks(COEFFICIENTS));
        harmonics
            .into_iter()
            .all(|(planned, variance)| planned.iter().map(|a| a * a).sum::<f64>() < variance.iter().sum())
    }

    /// True when a rigid plate can move as the channels show: both accelerometers show the same along the line between
    /// them.
    fn is_rigid(&self) -> bool {
        let along: Vec2 = self.sensors.position_m / self.sensors.position_m.norm();
        let apart = |a: &[f64; COEFFICIENTS]| {
            [0, 1].map(|i| ((a[i] - a[4 + i]) * along.x + (a[2 + i] - a[6 + i]) * along.y).powi(2)).iter().sum::<f64>()
        };
        let apart: f64 = self.read.as_slice().as_chunks().0.iter().map(apart).sum();
        apart < 0.5 * DEVIATIONS * DEVIATIONS * self.variance.sum() + RIGID * self.read.norm_squared()
    }

    /// Deviation of the reading from `predicted` in tolerances, root mean square over all channels or those `without`
    /// one. The response's error grows with the motion: a coil that gives more than planned, or the other way, may move
    /// the plate farther than planned.
    fn score(&self, predicted: &Readings, without: Option<usize>) -> f64 {
        let response = response_variance(predicted).max(response_variance(&self.planned));
        let tolerance = self.noise.map(|noise| (noise + response).sqrt());
        let channels = CHANNELS - usize::from(without.is_some());
        let coefficients = (self.read.len() / CHANNELS * channels) as f64;
        (energy(&(predicted - &self.read).component_div(&tolerance), without) / coefficients).sqrt()
    }
}

/// Channel of a coefficient.
fn channel_of(coefficient: usize) -> usize {
    coefficient / 2 % CHANNELS
}

/// The channel full of noise, if one is: its residual is more standard deviations than a coefficient may be off, each
/// the largest other residual or [`WEAKEST_MPS2`]. Beside it the variance of the others over that of all four: the
/// residual of such a channel says nothing about the others.
fn noisy(residual_mps2: &[f64; CHANNELS]) -> (Option<usize>, f64) {
    let mut squares: Vec<(f64, usize)> = residual_mps2.iter().map(|rms| rms * rms).zip(0..).collect();
    squares.sort_by(|(a, _), (b, _)| b.total_cmp(a));
    let (most, channel) = squares[0];
    if most <= DEVIATIONS * DEVIATIONS * squares[1].0.max(WEAKEST_MPS2 * WEAKEST_MPS2) {
        return (None, 1.0);
    }
    let mean = |of: &[(f64, usize)]| of.iter().map(|(square, _)| square).sum::<f64>() / of.len() as f64;
    (Some(channel), mean(&squares[1..]) / mean(&squares))
}

/// Square of the tolerance of each coefficient for the response's error in a motion with these readings, (m/s²)².
fn response_variance(readings: &Readings) -> f64 {
    RESPONSE_ERROR * RESPONSE_ERROR * readings.norm_squared() / readings.len() as f64
}

/// Sum of squares of all channels or those `without` one.
fn energy(of: &Readings, without: Option<usize>) -> f64 {
    let counted = of.iter().enumerate().filter(|(i, _)| Some(channel_of(*i)) != without);
    counted.map(|(_, a)| a * a).sum()
}

#[cfg(test)]
mod tests;
