use std::collections::VecDeque;

use nalgebra::Complex;

use upm_core::geometry::{Twist, Vec2, perp};
use upm_core::phasor::polar;
use upm_core::signal::{Envelope, TwistWave};
use upm_perception::estimation::BEARABLE_GAINS;

/// Longest delay considered, frames, and the one that stands for pictures that never show the drive.
const LONGEST: usize = 30;
const NEVER: usize = LONGEST + 1;
/// Delay from which on pictures are late, frames: exposure and transfer take up to one.
pub(super) const LATE: usize = 2;
/// Frames that are kept: the longest pulse has fewer than 64.
const KEPT: usize = 64 + LONGEST;
/// Larger displacements are clamped to this, px: the sides are followed no farther.
const FARTHEST_PX: f64 = 6.0;
/// Standard deviation of a corner's displacement by the picture's noise, px.
const NOISE_PX: f64 = 0.05;
/// Standard deviation of the swing that calibration predicts, as a share of its root mean square, until a run shows it.
const MODEL_ERROR: f64 = 0.1;
/// Log-likelihood ratio of one pulse that casts doubt: one in a hundred.
const DOUBTFUL: f64 = 4.6;
/// Largest residual, as a share of the squares, of frames that show the planned swing: a swing larger by a fifth leaves
/// this much.
const AS_DRIVEN: f64 = 0.04;
/// Residual from which on they show another swing: one larger or smaller by half leaves this much.
const OTHERWISE: f64 = 0.25;

/// Measures the delay of the pictures from the displacement of the plate's corners in each frame: a sequential test of
/// the planned swing, shown in time, against the same swing shown later or not at all.
#[derive(Clone, Debug, Default)]
pub struct DelayGuard {
    frame_s: f64,
    limit: f64,
    /// Most evidence so far for any delay, or for another motion than the drive's.
    pub most: f64,
    /// Displacement of the corners seen and expected in the last frames, px, oldest first; frames that never arrived
    /// keep their place.
    frames: VecDeque<(Option<f64>, f64)>,
    /// Number of the newest frame.
    newest: u64,
    /// The last two pulses with the time of their beginning, s of plate time.
    pulses: VecDeque<(f64, PlateSwing)>,
    /// For each delay the evidence for it, a log-likelihood ratio that does not fall below zero (CUSUM; Page,
    /// Biometrika 41, 1954). The first two entries, pictures in time, stay zero.
    late: [f64; NEVER + 1],
    /// Sum over pulses of the share of the swing's squares that the best explanation left, and their number.
    unexplained: (f64, f64),
}

/// Lag of the pictures behind the drive.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PictureLag {
    /// By this number of frames.
    By(usize),
    /// The pictures contradict the drive, and no delay explains them.
    Unseen,
}

/// The planned swing of a pulse as its frames show it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SwingVerdict {
    /// The frames show that swing.
    AsDriven,
    /// The frames show another swing.
    Otherwise,
    /// Too small to judge.
    Unclear,
}

/// Planned swing of the plate in a pulse.
#[derive(Clone, Debug)]
pub struct PlateSwing {
    /// Its velocity at full height, times from the start of the pulse.
    pub wave: TwistWave,
    /// Outline of the pulse, which the displacement follows.
    pub envelope: Envelope,
    /// Distance of the corners from the plate's axes, m.
    pub half_side_m: f64,
    /// Pixels per metre on the plate.
    pub px_per_m: f64,
}

impl DelayGuard {
    /// A guard for a camera of this frame rate, and the evidence, summed over pulses, at which pictures are late.
    pub fn new(frame_hz: f64, limit: f64) -> Self {
        Self { frame_s: frame_hz.recip(), limit, ..Self::default() }
    }

    /// A pulse begins at `at_s` of plate time; the plate should swing as `swing`.
    pub fn begin(&mut self, at_s: f64, swing: PlateSwing) {
        if self.pulses.len() == 2 {
            self.pulses.pop_front();
        }
        self.pulses.push_back((at_s, swing));
    }

    /// A frame exposed at `at_s` of plate time that shows the plate's corners up to `corner_px` from their places;
    /// `None` where that is not visible.
    pub fn frame(&mut self, at_s: f64, corner_px: Option<f64>) {
        let number = (at_s / self.frame_s).round() as u64;
        let missed = number.saturating_sub(self.newest + 1).min(KEPT as u64);
        for before in (0..=missed).rev() {
            if self.frames.len() == KEPT {
                self.frames.pop_front();
            }
            let seen = corner_px.filter(|_| before == 0).map(|px| px.min(FARTHEST_PX));
            self.frames.push_back((seen, self.expected_px(at_s - before as f64 * self.frame_s)));
        }
        self.newest = number;
    }

    /// Discards the observed displacements because the corners' places were wrong until now.
    pub fn forget_seen(&mut self) {
        self.frames.iter_mut().for_each(|(seen, _)| *seen = None);
    }

    /// Expected displacement of the plate's corners at `at_s` of plate time, px.
    pub fn expected_px(&self, at_s: f64) -> f64 {
        let pulse = self.pulses.iter().rev().find(|(begin_s, _)| *begin_s <= at_s);
        pulse.map_or(0.0, |(begin_s, swing)| swing.corner_px(at_s - begin_s))
    }

    /// True while the frames of the newest pulse appear late: they may show a plate at rest as still swinging.
    pub fn looks_late(&self) -> bool {
        self.evidence()[..NEVER].iter().any(|evidence| *evidence > DOUBTFUL)
    }

    /// Verdict on the planned swing in the frames since the newest pulse began.
    pub fn swing_seen(&self) -> SwingVerdict {
        let counted = || self.seen().filter(|(_, _, expected)| *expected < FARTHEST_PX);
        let expected: f64 = counted().map(|(_, _, expected)| expected * expected).sum();
        let left: f64 = counted().map(|(_, seen, expected)| (seen - expected).powi(2)).sum();
        match left / expected {
            _ if !shows_height(expected, counted().count()) => SwingVerdict::Unclear,
            share if share < AS_DRIVEN => SwingVerdict::AsDriven,
            share if share > OTHERWISE => SwingVerdict::Otherwise,
            _ => SwingVerdict::Unclear,
        }
    }

    /// Ends a pulse. Returns the delay of the frames once it is certain.
    pub fn end(&mut self) -> Option<PictureLag> {
        let evidence = self.evidence();
        self.late.iter_mut().zip(evidence).for_each(|(sum, evidence)| *sum = (*sum + evidence).max(0.0));
        let swing_px2 = self.apart_px2(NEVER);
        if shows_height(swing_px2, self.seen().count()) {
            let best_px2 = (LATE..NEVER).map(|delay| self.left_px2(delay)).fold(self.in_time_px2(), f64::min);
            self.unexplained.0 += (best_px2 / swing_px2).min(1.0);
            self.unexplained.1 += 1.0;
        }
        let most = self.late.iter().copied().fold(0.0, f64::max);
        self.most = self.most.max(most);
        // equal pulses at equal intervals are explained by a delay and by that delay plus one interval
        let is_alike = |delay: usize| self.late.get(delay).is_some_and(|evidence| *evidence >= most - DOUBTFUL);
        let shortest = (LATE..=NEVER).find(|delay| is_alike(*delay)).filter(|_| most >= self.limit)?;
        // pictures of rest are explained by every delay from the pulse's length on
        Some(if shortest == NEVER || is_alike(shortest + 1) { PictureLag::Unseen } else { PictureLag::By(shortest) })
    }

    /// Frames of the newest pulse: index, displacement seen and expected, px.
    fn seen(&self) -> impl Iterator<Item = (usize, f64, f64)> {
        let begin_s = self.pulses.back().map_or(f64::INFINITY, |(begin_s, _)| *begin_s);
        let of_pulse = move |(i, (seen, expected)): (usize, &(Option<f64>, f64))| {
            let age = (self.frames.len() - 1 - i) as f64;
            ((self.newest as f64 - age) * self.frame_s >= begin_s).then_some((i, (*seen)?, *expected))
        };
        self.frames.iter().enumerate().filter_map(of_pulse)
    }

    /// Evidence of the newest pulse for each delay: the log-likelihood ratio to pictures in time, of unknown variance.
    /// Two predictions that are less apart than the pictures are from both cannot be told apart: errors of the model
    /// are the same in every pulse of one shape.
    fn evidence(&self) -> [f64; NEVER + 1] {
        // errors of the model are alike in all frames of a pulse, and as large as earlier pulses showed them
        let (unexplained, pulses) = self.unexplained;
        let share = (MODEL_ERROR * MODEL_ERROR + unexplained) / (1.0 + pulses);
        let count = self.seen().count() as f64;
        let usual_px2 = count * NOISE_PX * NOISE_PX + share * self.apart_px2(NEVER);
        let in_time_px2 = self.in_time_px2() + usual_px2;
        std::array::from_fn(|delay| {
            let late_px2 = self.left_px2(delay) + usual_px2;
            let is_told = delay >= LATE && self.apart_px2(delay) > in_time_px2.min(late_px2);
            if is_told { 0.5 * count * libm::log(in_time_px2 / late_px2) } else { 0.0 }
        })
    }

    /// What pictures in time leave: up to a frame early, as a model that lags behind the plate lets them look, or late.
    fn in_time_px2(&self) -> f64 {
        let early_px2 = self.residual_px2(|i| self.frames.get(i + 1).map_or(0.0, |(_, expected)| *expected));
        (0..LATE).map(|delay| self.left_px2(delay)).fold(early_px2, f64::min)
    }

    /// What pictures that show the plan `delay` frames later leave.
    fn left_px2(&self, delay: usize) -> f64 {
        self.residual_px2(|i| self.expected(i, delay))
    }

    /// Sum of squares between pictures in time and those that show the plan `delay` frames later, px².
    fn apart_px2(&self, delay: usize) -> f64 {
        self.seen().map(|(i, _, expected)| (self.expected(i, delay) - expected).powi(2)).sum()
    }

    /// Displacement that frame `i` should show if pictures are `delay` frames late, px.
    fn expected(&self, i: usize, delay: usize) -> f64 {
        let shown = i.checked_sub(delay).filter(|_| delay < NEVER).and_then(|i| self.frames.get(i));
        shown.map_or(0.0, |(_, expected)| *expected)
    }

    /// Sum of squares that the displacements `expected_px` leave of the newest pulse's frames, at the gain that fits
    /// best, px².
    fn residual_px2(&self, expected_px: impl Fn(usize) -> f64) -> f64 {
        let [seen_sq, product, expected_sq] = self.seen().fold([0.0; 3], |[seen_sq, product, expected_sq], frame| {
            let (seen, expected) = (frame.1, expected_px(frame.0));
            [seen_sq + seen * seen, product + seen * expected, expected_sq + expected * expected]
        });
        // a weak coil changes the swing's height, not its time
        let (least, most) = (*BEARABLE_GAINS.start(), *BEARABLE_GAINS.end());
        let gain = (product / f64::max(expected_sq, f64::MIN_POSITIVE)).clamp(least, most);
        (seen_sq - 2.0 * gain * product + gain * gain * expected_sq).max(0.0)
    }
}

/// True for a swing whose height this number of frames shows: noise alone leaves less of its squares than a swing as
/// planned may.
fn shows_height(swing_px2: f64, frames: usize) -> bool {
    frames as f64 * NOISE_PX * NOISE_PX < AS_DRIVEN * swing_px2
}

impl PlateSwing {
    /// Largest displacement of the corners from their places at `t_s` after the start, px. The plate's velocity is the
    /// wave times the envelope's height, whose integral by parts has the envelope's slope and curvature, too: on the
    /// flanks they are as large as its height.
    fn corner_px(&self, t_s: f64) -> f64 {
        let height = self.envelope.at(t_s);
        if height == 0.0 {
            return 0.0;
        }
        let (slope, curvature) = (self.envelope.slope(t_s), self.envelope.curvature(t_s));
        let displaced = (1..).zip(&self.wave.harmonics).map(|(k, harmonic)| {
            let rate = f64::from(k) * self.wave.base_radps;
            let integral = Complex::new(slope / rate, curvature / (rate * rate) - height) / rate;
            harmonic.phasor().map(|velocity| (velocity * integral * polar(1.0, rate * t_s)).re)
        });
        let place = Twist::from_vector(displaced.sum());
        let corners =
            [(1.0, 1.0), (1.0, -1.0), (-1.0, 1.0), (-1.0, -1.0)].map(|(x, y)| Vec2::new(x, y) * self.half_side_m);
        let displaced_m = corners.map(|corner| (place.velocity_mps + perp(corner) * place.spin_radps).norm());
        (self.px_per_m * displaced_m.into_iter().fold(0.0, f64::max)).min(FARTHEST_PX)
    }
}

#[cfg(test)]
mod tests;
