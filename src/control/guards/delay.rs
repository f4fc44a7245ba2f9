use std::collections::VecDeque;

use upm_core::geometry::{Twist, Vec2, perp};
use upm_core::signal::{Envelope, TwistWave};
use upm_perception::estimation::BEARABLE_GAINS;

/// Longest delay considered, frames.
const LONGEST: usize = 30;
/// Delay from which on pictures are late, frames: exposure and transfer take up to one.
pub(super) const LATE: usize = 2;
/// Largest number of frames judged in a pulse: the longest pulse has fewer.
const WINDOW: usize = 64;
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
    /// The last frames, oldest first; frames that never arrived keep their place.
    frames: VecDeque<CornerDisplacement>,
    /// Number of the newest frame.
    newest: u64,
    /// The last two pulses with the time of their beginning, s of plate time.
    pulses: VecDeque<(f64, PlateSwing)>,
    /// For each delay the evidence for it, a log-likelihood ratio that does not fall below zero (CUSUM; Page,
    /// Biometrika 41, 1954). The first two entries, pictures in time, stay zero.
    late: [f64; LONGEST + 1],
    /// The same for pictures that show another motion than the drive's.
    unseen: f64,
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

/// Displacement of the corners in one frame, px.
#[derive(Clone, Copy, Debug)]
struct CornerDisplacement {
    seen: Option<f64>,
    expected: f64,
}

/// Difference between frames and an explanation of them.
#[derive(Clone, Copy, Debug)]
struct Residual {
    /// Number of frames.
    count: f64,
    /// Sum of squares, px².
    px2: f64,
}

impl Residual {
    /// Log-likelihood ratio of an explanation that leaves `other` to the one that leaves this, of unknown variance;
    /// noise and model leave `usual_px2` on average. Two predictions that are less `apart_px2` than the pictures are
    /// from both cannot be told apart: errors of the model are the same in every pulse of one shape.
    fn evidence_for(self, other: Self, usual_px2: f64, apart_px2: f64) -> f64 {
        let [this_px2, other_px2] = [self.px2, other.px2].map(|px2| px2 + usual_px2);
        let is_told = apart_px2 > this_px2.min(other_px2);
        if is_told { 0.5 * self.count * libm::log(this_px2 / other_px2) } else { 0.0 }
    }
}

/// Planned swing of the plate in a pulse.
#[derive(Clone, Debug)]
pub struct PlateSwing {
    /// The quantity that follows the outline, and the motion before it.
    pub fade: SwingFade,
    /// Its velocity at full height, times from the start of the pulse.
    pub wave: TwistWave,
    /// Outline of the pulse, which the displacement follows.
    pub envelope: Envelope,
    /// Distance of the corners from the plate's axes, m.
    pub half_side_m: f64,
    /// Pixels per metre on the plate.
    pub px_per_m: f64,
}

/// The beginning of a planned swing.
#[derive(Clone, Debug)]
pub enum SwingFade {
    /// From rest; the velocity follows the outline.
    Velocity,
    /// From rest; the displacement follows the outline.
    Rest,
    /// The displacement does, and another motion, of this velocity, fades out meanwhile.
    From(TwistWave),
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
        let missed = number.saturating_sub(self.newest).saturating_sub(1).min((WINDOW + LONGEST) as u64);
        for number in number - missed.min(number)..number {
            self.push(number as f64 * self.frame_s, None);
        }
        self.push(at_s, corner_px.map(|px| px.min(FARTHEST_PX)));
        self.newest = number;
    }

    fn push(&mut self, at_s: f64, seen: Option<f64>) {
        let expected = self.expected_px(at_s);
        if self.frames.len() == WINDOW + LONGEST {
            self.frames.pop_front();
        }
        self.frames.push_back(CornerDisplacement { seen, expected });
    }

    /// Discards the observed displacements because the corners' places were wrong until now.
    pub fn forget_seen(&mut self) {
        self.frames.iter_mut().for_each(|frame| frame.seen = None);
    }

    /// Expected displacement of the plate's corners at `at_s` of plate time, px.
    pub fn expected_px(&self, at_s: f64) -> f64 {
        let pulse = self.pulses.iter().rev().find(|(begin_s, _)| *begin_s <= at_s);
        pulse.map_or(0.0, |(begin_s, swing)| swing.corner_px(at_s - begin_s))
    }

    /// True while the frames of the newest pulse appear late: they may show a plate at rest as still swinging.
    pub fn looks_late(&self) -> bool {
        let in_time = self.in_time();
        (LATE..=LONGEST).any(|delay| self.evidence(in_time, delay) > DOUBTFUL)
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
        let in_time = self.in_time();
        for delay in LATE..=LONGEST {
            self.late[delay] = (self.late[delay] + self.evidence(in_time, delay)).max(0.0);
        }
        let swing_px2 = self.seen().map(|(i, ..)| self.expected(i, 0).powi(2)).sum();
        let of_rest = in_time.evidence_for(self.residual(|_| 0.0), self.usual_px2(), swing_px2);
        self.unseen = (self.unseen + of_rest).max(0.0);
        if shows_height(swing_px2, self.seen().count()) {
            let late = (LATE..=LONGEST).map(|delay| self.left(delay as isize).px2);
            let best_px2 = late.fold(in_time.px2, f64::min);
            let (sum, pulses) = self.unexplained;
            self.unexplained = (sum + (best_px2 / swing_px2).min(1.0), pulses + 1.0);
        }
        let most = self.late.iter().copied().fold(0.0, f64::max);
        self.most = self.most.max(most).max(self.unseen);
        if most < self.limit {
            return (self.unseen >= self.limit).then_some(PictureLag::Unseen);
        }
        // equal pulses at equal intervals are explained by a delay and by that delay plus one interval
        let alike = |delay: usize| self.late.get(delay).is_some_and(|evidence| *evidence >= most - DOUBTFUL);
        let shortest = (LATE..=LONGEST).find(|delay| alike(*delay)).unwrap_or(LONGEST);
        // pictures of rest are explained by every delay from the pulse's length on
        Some(if alike(shortest + 1) { PictureLag::Unseen } else { PictureLag::By(shortest) })
    }

    /// Frames of the newest pulse: index, displacement seen and expected, px.
    fn seen(&self) -> impl Iterator<Item = (usize, f64, f64)> {
        let begin_s = self.pulses.back().map_or(f64::INFINITY, |(begin_s, _)| *begin_s);
        let of_pulse = move |(i, frame): (usize, &CornerDisplacement)| {
            let age = (self.frames.len() - 1 - i) as f64;
            ((self.newest as f64 - age) * self.frame_s >= begin_s).then_some((i, frame.seen?, frame.expected))
        };
        self.frames.iter().enumerate().filter_map(of_pulse)
    }

    /// Residual of pictures in time: up to a frame early, as a model that lags behind the plate lets them look, or
    /// late.
    fn in_time(&self) -> Residual {
        let [early, exact, next] = [-1, 0, 1].map(|delay| self.left(delay));
        [early, next].into_iter().fold(exact, |best, other| if other.px2 < best.px2 { other } else { best })
    }

    /// Evidence of the newest pulse for pictures that are `delay` frames late, against pictures in time.
    fn evidence(&self, in_time: Residual, delay: usize) -> f64 {
        let delay = delay as isize;
        let apart_px2 = self.seen().map(|(i, ..)| (self.expected(i, delay) - self.expected(i, 0)).powi(2)).sum();
        in_time.evidence_for(self.left(delay), self.usual_px2(), apart_px2)
    }

    /// Sum of squares that noise and errors of the model usually leave of the newest pulse, px². Those errors are alike
    /// in all its frames, and as large as earlier pulses showed them.
    fn usual_px2(&self) -> f64 {
        let (unexplained, pulses) = self.unexplained;
        let share = (MODEL_ERROR * MODEL_ERROR + unexplained) / (1.0 + pulses);
        self.seen().map(|(i, ..)| NOISE_PX * NOISE_PX + share * self.expected(i, 0).powi(2)).sum()
    }

    /// Residual of pictures that show the plan `delay` frames later.
    fn left(&self, delay: isize) -> Residual {
        self.residual(|i| self.expected(i, delay))
    }

    /// Displacement that frame `i` should show if pictures are `delay` frames late, px.
    fn expected(&self, i: usize, delay: isize) -> f64 {
        i.checked_add_signed(-delay).and_then(|i| self.frames.get(i)).map_or(0.0, |frame| frame.expected)
    }

    /// Residual of the newest pulse's frames against the displacements `expected_px`, at the gain that fits best.
    fn residual(&self, expected_px: impl Fn(usize) -> f64) -> Residual {
        let (mut count, mut seen_sq, mut product, mut expected_sq) = (0.0, 0.0, 0.0, 0.0);
        for (i, seen, _) in self.seen() {
            let expected = expected_px(i);
            count += 1.0;
            seen_sq += seen * seen;
            product += seen * expected;
            expected_sq += expected * expected;
        }
        // a weak coil changes the swing's height, not its time
        let (least, most) = (*BEARABLE_GAINS.start(), *BEARABLE_GAINS.end());
        let gain = (product / f64::max(expected_sq, f64::MIN_POSITIVE)).clamp(least, most);
        let left = (seen_sq - 2.0 * gain * product + gain * gain * expected_sq).max(0.0);
        Residual { count, px2: left }
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
        let place = match &self.fade {
            SwingFade::Velocity => self.place_by_velocity(t_s, height),
            SwingFade::Rest => displacement(&self.wave, t_s) * height,
            SwingFade::From(last) if t_s < self.envelope.attack_s => {
                displacement(&self.wave, t_s) * height + displacement(last, t_s) * (1.0 - height)
            }
            SwingFade::From(_) => displacement(&self.wave, t_s) * height,
        };
        let corners =
            [(1.0, 1.0), (1.0, -1.0), (-1.0, 1.0), (-1.0, -1.0)].map(|(x, y)| Vec2::new(x, y) * self.half_side_m);
        let displaced = corners.map(|corner| (place.velocity_mps + perp(corner) * place.spin_radps).norm());
        (self.px_per_m * displaced.into_iter().fold(0.0, f64::max)).min(FARTHEST_PX)
    }

    /// The plate's place while its velocity is the wave times the outline's height.
    fn place_by_velocity(&self, t_s: f64, height: f64) -> Twist {
        let (slope, curvature) = (self.envelope.slope(t_s), self.envelope.curvature(t_s));
        (1..).zip(&self.wave.harmonics).fold(Twist::ZERO, |place, (k, harmonic)| {
            let rate = f64::from(k) * self.wave.base_radps;
            let (sin, cos) = libm::sincos(rate * t_s);
            let (velocity, integral) =
                (harmonic.cos * cos + harmonic.sin * sin, harmonic.cos * sin + harmonic.sin * -cos);
            place + integral * ((height - curvature / (rate * rate)) / rate) + velocity * (slope / (rate * rate))
        })
    }
}

/// Time integral of a periodic velocity, without a mean.
fn displacement(wave: &TwistWave, t_s: f64) -> Twist {
    (1..).zip(&wave.harmonics).fold(Twist::ZERO, |place, (k, harmonic)| {
        let rate = f64::from(k) * wave.base_radps;
        let (sin, cos) = libm::sincos(rate * t_s);
        place + (harmonic.cos * sin - harmonic.sin * cos) * rate.recip()
    })
}

#[cfg(test)]
mod tests;
