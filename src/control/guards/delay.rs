use std::collections::VecDeque;

use nalgebra::{Complex, DVector, Vector3};

use super::{GROSS, PulseOutcome, SLIGHT};
use upm_core::phasor::polar;
use upm_core::signal::{Envelope, TwistWave};
use upm_perception::estimation::BEARABLE_GAINS;

/// Longest delay considered, frames, and the one that stands for pictures that contradict the drive at every delay.
const LONGEST: usize = 30;
pub const NEVER: usize = LONGEST + 1;
/// Delay from which on pictures are late, frames: exposure and transfer take up to one.
pub(super) const LATE: usize = 2;
/// Frames that are kept: the longest pulse has fewer than 64.
const KEPT: usize = 64 + LONGEST;
/// Larger displacements are clamped to this, px: the sides are followed no farther.
const FARTHEST_PX: f64 = 6.0;
/// Standard deviation of a corner's displacement by the picture's noise where calibration has not measured it, px.
pub(super) const NOISE_PX: f64 = 0.05;
/// Standard deviation of the swing that calibration predicts, as a share of its root mean square, until a run shows it.
const MODEL_ERROR: f64 = 0.1;
/// Pulses over which errors of the model are averaged: a motion and its error last as long, two seconds of segments.
const ALIKE: f64 = 30.0;
/// Log-likelihood ratio of one pulse that casts doubt: one in a hundred.
const DOUBTFUL: f64 = 4.6;

/// Measures the delay of the pictures from the displacement of the plate's corners in each frame: a sequential test of
/// the planned swing, shown in time, against the same swing shown later or not at all.
#[derive(Clone, Debug, Default)]
pub struct DelayGuard {
    frame_s: f64,
    limit: f64,
    /// Standard deviation of a corner's displacement by the picture's noise, px.
    noise_px: f64,
    /// Most evidence so far for any delay, or for another motion than the drive's.
    pub most: f64,
    /// Displacement of the corners seen and expected in the last frames, px, newest first; frames that never arrived
    /// keep their place.
    frames: VecDeque<(Option<f64>, f64)>,
    /// Number of the newest frame.
    newest: u64,
    /// The last two pulses with the time of their beginning, s of plate time, newest first.
    pulses: VecDeque<(f64, PlateSwing)>,
    /// For each delay the evidence for it, a log-likelihood ratio that does not fall below zero (CUSUM; Page,
    /// Biometrika 41, 1954). The first two entries, pictures in time, stay zero.
    late: [f64; NEVER + 1],
    /// Sum over the last pulses of the share of the swing's squares that the best explanation left, and their number.
    unexplained: (f64, f64),
}

/// Planned swing of the plate in a pulse.
#[derive(Clone, Debug)]
pub struct PlateSwing {
    /// Its velocity at full height, times from the start of the pulse.
    pub wave: TwistWave,
    /// The motion that fades out meanwhile where the displacement follows the outline, without harmonics for one from
    /// rest; `None` where the velocity follows it.
    pub fades: Option<TwistWave>,
    /// Outline of the pulse.
    pub envelope: Envelope,
    /// Distance of the corners from the plate's axes, m.
    pub half_side_m: f64,
    /// Pixels per metre on the plate.
    pub px_per_m: f64,
}

impl DelayGuard {
    /// A guard for a camera of this frame rate, and the evidence, summed over pulses, at which pictures are late.
    pub fn new(frame_hz: f64, limit: f64) -> Self {
        Self { frame_s: frame_hz.recip(), limit, noise_px: NOISE_PX, ..Self::default() }
    }

    /// A pulse begins at `at_s` of plate time; the plate should swing as `swing`.
    pub fn begin(&mut self, at_s: f64, swing: PlateSwing) {
        self.pulses.truncate(1);
        self.pulses.push_front((at_s, swing));
    }

    /// Takes the limit of a run, and the noise with which its camera shows corners, px.
    pub fn for_run(&mut self, limit: f64, noise_px: Option<f64>) {
        (self.limit, self.noise_px) = (limit, noise_px.unwrap_or(NOISE_PX));
    }

    /// A frame exposed at `at_s` of plate time that shows the plate's corners up to `corner_px` from their places;
    /// `None` where that is not visible.
    pub fn frame(&mut self, at_s: f64, corner_px: Option<f64>) {
        let number = (at_s / self.frame_s).round() as u64;
        let missed = number.saturating_sub(self.newest + 1).min(KEPT as u64);
        for before in (0..=missed).rev() {
            self.frames.truncate(KEPT - 1);
            let seen = corner_px.filter(|_| before == 0).map(|px| px.min(FARTHEST_PX));
            self.frames.push_front((seen, self.expected_px(at_s - before as f64 * self.frame_s)));
        }
        self.newest = number;
    }

    /// Discards the observed displacements because the corners' places were wrong until now.
    pub fn forget_seen(&mut self) {
        self.frames.iter_mut().for_each(|(seen, _)| *seen = None);
    }

    /// Expected displacement of the plate's corners at `at_s` of plate time, px.
    pub fn expected_px(&self, at_s: f64) -> f64 {
        let pulse = self.pulses.iter().find(|(begin_s, _)| *begin_s <= at_s);
        pulse.map_or(0.0, |(begin_s, swing)| swing.corner_px(at_s - begin_s))
    }

    /// True where all pulses together cast doubt on the pictures.
    pub fn is_doubted(&self) -> bool {
        self.late.iter().any(|evidence| *evidence > DOUBTFUL)
    }

    /// True while the frames of the newest pulse appear late: they may show a plate at rest as still swinging.
    pub fn looks_late(&self) -> bool {
        self.weighed().0[..NEVER].iter().any(|evidence| *evidence > DOUBTFUL)
    }

    /// How the plate swung in the frames since the newest pulse began; `None` where they do not tell.
    pub fn swing_seen(&self) -> Option<PulseOutcome> {
        let counted = || self.seen().filter(|(_, _, expected)| *expected < FARTHEST_PX);
        let expected: f64 = counted().map(|(_, _, expected)| expected * expected).sum();
        let left: f64 = counted().map(|(_, seen, expected)| (seen - expected).powi(2)).sum();
        let is_clear = self.shows_height(expected, counted().count() as f64);
        match left / expected {
            share if is_clear && share < SLIGHT * SLIGHT => Some(PulseOutcome::AsPlanned),
            share if is_clear && share > GROSS * GROSS => Some(PulseOutcome::Otherwise),
            _ => None,
        }
    }

    /// Ends a pulse. Returns the delay of the pictures, frames, once it is certain.
    pub fn end(&mut self) -> Option<usize> {
        let (evidence, unexplained) = self.weighed();
        self.late.iter_mut().zip(evidence).for_each(|(sum, evidence)| *sum = (*sum + evidence).max(0.0));
        if let Some(share) = unexplained {
            let (sum, count) = self.unexplained;
            let kept = (ALIKE - 1.0) / count.max(ALIKE - 1.0);
            self.unexplained = (kept * sum + share, kept * count + 1.0);
        }
        let most = self.late.iter().copied().fold(0.0, f64::max);
        self.most = self.most.max(most);
        // equal pulses at equal intervals are explained by a delay and by that delay plus one interval
        let is_alike = |delay: usize| self.late.get(delay).is_some_and(|evidence| *evidence >= most - DOUBTFUL);
        let shortest = (LATE..=NEVER).find(|delay| is_alike(*delay)).filter(|_| most >= self.limit)?;
        // pictures of rest are explained by every delay from the pulse's length on
        Some(if is_alike(shortest + 1) { NEVER } else { shortest })
    }

    /// Frames of the newest pulse: age, displacement seen and expected, px.
    fn seen(&self) -> impl Iterator<Item = (usize, f64, f64)> {
        let begin_s = self.pulses.front().map_or(f64::INFINITY, |(begin_s, _)| *begin_s);
        let of_pulse = move |(age, (seen, expected)): (usize, &(Option<f64>, f64))| {
            ((self.newest as f64 - age as f64) * self.frame_s >= begin_s).then_some((age, (*seen)?, *expected))
        };
        self.frames.iter().enumerate().filter_map(of_pulse)
    }

    /// Evidence of the newest pulse for each delay: the log-likelihood ratio to pictures in time, of unknown variance.
    /// Beside it the share of the swing's squares that the best explanation leaves; `None` for a swing too small to
    /// tell.
    fn weighed(&self) -> ([f64; NEVER + 1], Option<f64>) {
        let frames: Vec<usize> = self.seen().map(|(age, ..)| age).collect();
        let seen = DVector::from_iterator(frames.len(), self.seen().map(|(_, seen, _)| seen));
        let shown = |delay: isize| {
            let expected = |age: usize| self.frames.get(age.checked_add_signed(delay)?).map(|(_, expected)| *expected);
            DVector::from_iterator(frames.len(), frames.iter().map(|age| expected(*age).unwrap_or(0.0)))
        };
        let left_px2 = |shown: &DVector<f64>| {
            // a weak coil changes the swing's height, not its time
            let gain = seen.dot(shown) / shown.norm_squared().max(f64::MIN_POSITIVE);
            (&seen - shown * gain.clamp(*BEARABLE_GAINS.start(), *BEARABLE_GAINS.end())).norm_squared()
        };
        // up to a frame early, as a model that lags behind the plate lets them look, or late
        let in_time_px2 = (-1..LATE as isize).map(|delay| left_px2(&shown(delay))).fold(f64::INFINITY, f64::min);
        let late: [_; NEVER + 1] =
            std::array::from_fn(|delay| if delay < NEVER { shown(delay as isize) } else { shown(0) * 0.0 });
        // where both are as far as the sides are followed, a frame shows neither height of the swing nor error of the
        // model
        let open = || late[0].iter().zip(seen.iter()).filter(|(shown, seen)| shown.min(**seen) < FARTHEST_PX);
        let (count, swing_px2) = (open().count() as f64, open().map(|(shown, _)| shown * shown).sum::<f64>());
        // errors of the model are alike in all frames of a pulse, and as large as earlier pulses showed them
        let share = (MODEL_ERROR * MODEL_ERROR + self.unexplained.0) / (1.0 + self.unexplained.1);
        let usual_px2 = count * self.noise_px * self.noise_px + share * swing_px2;
        let left: [f64; NEVER + 1] = late.each_ref().map(left_px2);
        let evidence = std::array::from_fn(|delay| {
            let [in_time_px2, late_px2] = [in_time_px2, left[delay]].map(|px2| px2 + usual_px2);
            // predictions less apart than the pictures are from both cannot be told apart: errors of the model are the
            // same in every pulse of one shape
            let is_told = delay >= LATE && (&late[delay] - &late[0]).norm_squared() > in_time_px2.min(late_px2);
            if is_told { 0.5 * count * libm::log(in_time_px2 / late_px2) } else { 0.0 }
        });
        let best_px2 = left[LATE..NEVER].iter().copied().fold(in_time_px2, f64::min);
        // of many delays one fits better by chance: up to the usual error of models the pictures are in time
        let left_px2 = in_time_px2.min(best_px2.max(MODEL_ERROR * MODEL_ERROR * swing_px2));
        (evidence, self.shows_height(swing_px2, count).then(|| (left_px2 / swing_px2).min(1.0)))
    }

    /// True for a swing whose height this number of frames shows: noise alone leaves less of its squares than a swing
    /// as planned may.
    fn shows_height(&self, swing_px2: f64, frames: f64) -> bool {
        frames * self.noise_px * self.noise_px < SLIGHT * SLIGHT * swing_px2
    }
}

impl PlateSwing {
    /// Largest displacement of the corners from their places at `t_s` after the start, px. The plate's velocity is the
    /// wave times the envelope's height, whose integral by parts has the envelope's slope and curvature, too: on the
    /// flanks they are as large as its height.
    fn corner_px(&self, t_s: f64) -> f64 {
        let (height, slope) = (self.envelope.at(t_s), self.envelope.slope(t_s));
        let curvature = self.envelope.curvature(t_s);
        let place = match &self.fades {
            None => place(&self.wave, t_s, |rate| Complex::new(slope / rate, curvature / (rate * rate) - height)),
            Some(last) => {
                let faded = if t_s < self.envelope.attack_s { 1.0 - height } else { 0.0 };
                place(&self.wave, t_s, |_| Complex::new(0.0, -height)) + place(last, t_s, |_| Complex::new(0.0, -faded))
            }
        };
        let (x_m, y_m, turn_m) = (place.x.abs(), place.y.abs(), place.z.abs() * self.half_side_m);
        // of the corner that the turn carries the way of the shift
        (self.px_per_m * libm::hypot(x_m + turn_m, y_m + turn_m)).min(FARTHEST_PX)
    }
}

/// The plate's place and turn: the sum over harmonics of velocity times `integral` of the rate, over the rate.
fn place(wave: &TwistWave, t_s: f64, integral: impl Fn(f64) -> Complex<f64>) -> Vector3<f64> {
    let displaced = (1..).zip(&wave.harmonics).map(|(k, harmonic)| {
        let rate = f64::from(k) * wave.base_radps;
        let factor = integral(rate) / rate * polar(1.0, rate * t_s);
        harmonic.phasor().map(|velocity| (velocity * factor).re)
    });
    displaced.sum()
}

#[cfg(test)]
mod tests;
