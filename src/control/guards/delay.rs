use std::collections::VecDeque;

use nalgebra::{Complex, Matrix3xX, Vector3};

use super::{GROSS, PulseOutcome, SLIGHT};
use upm_core::geometry::{Vec2, perp};
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
/// Distance up to which the sides are found where they are looked for, px.
const REACH_PX: f64 = 6.0;
/// Frames that show the plate nowhere near its places before it counts as moved: a tear or a flash spoils one or two.
const ASTRAY: usize = 3;
/// Least and most frames from which the plate's mean place is taken: two periods of a motion without pauses, since in
/// one the next motion may take over otherwise than planned, and so many that errors of the model, which last, stay
/// below chance.
const MEAN_OF: [usize; 2] = [8, 20];
/// Standard deviation of a corner's displacement by the picture's noise where calibration has not measured it, px.
pub(super) const NOISE_PX: f64 = 0.05;
/// Standard deviation of the swing that calibration predicts, as a share of its root mean square, until a run shows it.
const MODEL_ERROR: f64 = 0.1;
/// Pulses over which errors of the model are averaged: a motion and its error last as long, two seconds of segments.
const ALIKE: f64 = 30.0;
/// Evidence of a pulse that does not count: equal pulses have equal errors of the model, each of which would add to the
/// sum (the reference value of a CUSUM). Late pictures give more than the limit in three pulses.
const ALLOWANCE: f64 = 1.0;
/// Log-likelihood ratio of one pulse that casts doubt: one in a hundred.
const DOUBTFUL: f64 = 4.6;

/// Measures the delay of the pictures from the swing of the plate in each frame: a sequential test of the planned
/// swing, shown in time, against the same swing shown later or not at all, each about any place. About another place
/// than the table's the swing shows that the camera or the plate was knocked.
#[derive(Clone, Debug, Default)]
pub struct DelayGuard {
    frame_s: f64,
    limit: f64,
    /// Standard deviation of a corner's displacement by the picture's noise, px.
    noise_px: f64,
    /// Most evidence so far for any delay, or for another motion than the drive's.
    pub most: f64,
    /// Swing seen and expected in the last frames, px, newest first; frames that never arrived keep their place.
    frames: VecDeque<(Option<Vector3<f64>>, Vector3<f64>)>,
    /// Number of the last frames in which the plate is at no place where it could be.
    astray: usize,
    /// True while the plate swings out of a pulse that was cut short.
    is_cut: bool,
    /// Number of the newest frame.
    newest: u64,
    /// The last two pulses with the time of their beginning, s of plate time, newest first.
    pulses: VecDeque<(f64, PlateSwing)>,
    /// The one that takes over from them, as soon as it is known.
    next: Option<(f64, PlateSwing)>,
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
        (self.is_cut, self.next) = (false, None);
    }

    /// A pulse will take over at `at_s` of plate time: frames from then on show its swing, even before it counts as the
    /// newest one.
    pub fn expect_next(&mut self, at_s: f64, swing: PlateSwing) {
        self.next = Some((at_s, swing));
    }

    /// The expected pulse is the newest one from now on.
    pub fn begin_next(&mut self) {
        if let Some((at_s, swing)) = self.next.take() {
            self.begin(at_s, swing);
        }
    }

    /// The present pulse was cut short: the plate swings out as no plan has it.
    pub fn cut(&mut self) {
        (self.is_cut, self.next) = (true, None);
    }

    /// Takes the limit of a run, and the noise with which its camera shows corners, px.
    pub fn for_run(&mut self, limit: f64, noise_px: Option<f64>) {
        (self.limit, self.noise_px) = (limit, noise_px.unwrap_or(NOISE_PX));
    }

    /// Swings, px, that a frame exposed at `at_s` of plate time may show, in time or late: each farther from those
    /// before it than the sides are found.
    pub fn possible_px(&self, at_s: f64) -> Vec<Vector3<f64>> {
        let earlier = self.frames.iter().take(LONGEST).map(|(_, expected_px)| *expected_px);
        std::iter::once(self.expected_px(at_s)).chain(earlier).fold(Vec::new(), |mut places, place_px| {
            if places.iter().all(|other: &Vector3<f64>| (place_px - other).norm() > REACH_PX / 2.0) {
                places.push(place_px);
            }
            places
        })
    }

    /// A frame exposed at `at_s` of plate time that shows the plate swung by `swing_px`; `None` where that is not
    /// visible. `is_astray`: it shows plate and ground, and no swing that could be.
    pub fn frame(&mut self, at_s: f64, swing_px: Option<Vector3<f64>>, is_astray: bool) {
        let number = (at_s / self.frame_s).round() as u64;
        let missed = number.saturating_sub(self.newest + 1).min(KEPT as u64);
        let swing_px = swing_px.filter(|_| !self.is_cut);
        self.astray = if is_astray && !self.is_cut { self.astray + 1 } else { 0 };
        for before in (0..=missed).rev() {
            self.frames.truncate(KEPT - 1);
            let expected_px = self.expected_px(at_s - before as f64 * self.frame_s);
            self.frames.push_front((swing_px.filter(|_| before == 0), expected_px));
        }
        self.newest = number;
    }

    /// Discards the observed swings because the corners' places were wrong until now.
    pub fn forget_seen(&mut self) {
        self.frames.iter_mut().for_each(|(seen, _)| *seen = None);
        self.astray = 0;
    }

    /// Expected swing of the plate at `at_s` of plate time, px.
    pub fn expected_px(&self, at_s: f64) -> Vector3<f64> {
        self.swing_at(at_s).map_or(Vector3::zeros(), |(since_s, swing)| swing.at_px(since_s))
    }

    /// The swing of the pulse that plays at `at_s`, and the time since its beginning, s.
    fn swing_at(&self, at_s: f64) -> Option<(f64, &PlateSwing)> {
        let pulse = self.next.iter().chain(&self.pulses).find(|(begin_s, _)| *begin_s <= at_s);
        pulse.map(|(begin_s, swing)| (at_s - begin_s, swing))
    }

    /// Expected displacement, m, of the plate under `place_m` at `at_s` of plate time.
    pub fn sway_m(&self, at_s: f64, place_m: Vec2) -> Vec2 {
        let sway = self.swing_at(at_s).map_or(Vector3::zeros(), |(since_s, swing)| swing.at(since_s));
        sway.xy() + perp(place_m) * sway.z
    }

    /// Distance of the corners, px, from the places about which the plate should swing, where the last frames are
    /// certain of it, infinite for a plate that is nowhere near them: a likelihood ratio of their mean.
    pub fn knocked_px(&self) -> Option<f64> {
        if self.astray >= ASTRAY {
            return Some(f64::INFINITY);
        }
        let mut frames = Swings::default();
        for (seen, expected) in self.frames.iter().take(MEAN_OF[1]) {
            let Some(seen) = seen else { continue };
            frames.add(*seen, *expected);
            let (off_px, left_px2) = frames.offset();
            let usual_px2 = self.usual_px2(frames.count, frames.expected_px2);
            let evidence = 0.5 * frames.count * frames.count * off_px.norm_squared() / (left_px2 + usual_px2);
            if frames.count >= MEAN_OF[0] as f64 && evidence > self.limit {
                return Some(corner_px(off_px));
            }
        }
        None
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
        let (seen, expected): (Vec<_>, Vec<_>) = self.seen().map(|(_, seen, expected)| (seen, expected)).unzip();
        let (count, seen, expected) = (seen.len() as f64, centred(&seen), centred(&expected));
        let swing_px2 = expected.norm_squared();
        let is_clear = self.shows_height(swing_px2, count);
        match (seen - expected).norm_squared() / swing_px2 {
            share if is_clear && share < SLIGHT * SLIGHT => Some(PulseOutcome::AsPlanned),
            share if is_clear && share > GROSS * GROSS => Some(PulseOutcome::Otherwise),
            _ => None,
        }
    }

    /// Ends a pulse. Returns the delay of the pictures, frames, once it is certain.
    pub fn end(&mut self) -> Option<usize> {
        let (evidence, unexplained) = self.weighed();
        self.late.iter_mut().zip(evidence).for_each(|(sum, evidence)| *sum = (*sum + evidence - ALLOWANCE).max(0.0));
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

    /// Frames of the newest pulse: age, swing seen and expected, px.
    fn seen(&self) -> impl Iterator<Item = (usize, Vector3<f64>, Vector3<f64>)> {
        let begin_s = self.pulses.front().map_or(f64::INFINITY, |(begin_s, _)| *begin_s);
        let of_pulse = move |(age, (seen, expected)): (usize, &(Option<Vector3<f64>>, Vector3<f64>))| {
            ((self.newest as f64 - age as f64) * self.frame_s >= begin_s).then_some((age, (*seen)?, *expected))
        };
        self.frames.iter().enumerate().filter_map(of_pulse)
    }

    /// Evidence of the newest pulse for each delay: the log-likelihood ratio to pictures in time, of unknown variance.
    /// Beside it the share of the swing's squares that the best explanation leaves; `None` for a swing too small to
    /// tell.
    fn weighed(&self) -> ([f64; NEVER + 1], Option<f64>) {
        let ages: Vec<usize> = self.seen().map(|(age, ..)| age).collect();
        let seen = centred(&self.seen().map(|(_, seen, _)| seen).collect::<Vec<_>>());
        let shown = |delay: isize| {
            let expected = |age: usize| self.frames.get(age.checked_add_signed(delay)?).map(|(_, expected)| *expected);
            centred(&ages.iter().map(|age| expected(*age).unwrap_or_default()).collect::<Vec<_>>())
        };
        let left_px2 = |shown: &Matrix3xX<f64>| {
            let gain = seen.dot(shown) / shown.norm_squared().max(f64::MIN_POSITIVE);
            (&seen - shown * bearable(gain)).norm_squared()
        };
        // up to a frame early, as a model that lags behind the plate lets them look, or late
        let in_time_px2 = (-1..LATE as isize).map(|delay| left_px2(&shown(delay))).fold(f64::INFINITY, f64::min);
        let late: [_; NEVER + 1] =
            std::array::from_fn(|delay| if delay < NEVER { shown(delay as isize) } else { shown(0) * 0.0 });
        let (count, swing_px2) = (ages.len() as f64, late[0].norm_squared());
        let usual_px2 = self.usual_px2(count, swing_px2);
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

    /// Squares, px², that noise and errors of the model leave in this number of frames: these are alike in all frames
    /// of a pulse, and as large as earlier pulses showed them.
    fn usual_px2(&self, frames: f64, swing_px2: f64) -> f64 {
        let share = (MODEL_ERROR * MODEL_ERROR + self.unexplained.0) / (1.0 + self.unexplained.1);
        frames * self.noise_px * self.noise_px + share * swing_px2
    }

    /// True for a swing whose height this number of frames shows: noise alone leaves less of its squares than a swing
    /// as planned may.
    fn shows_height(&self, swing_px2: f64, frames: f64) -> bool {
        frames * self.noise_px * self.noise_px < SLIGHT * SLIGHT * swing_px2
    }
}

impl PlateSwing {
    /// Shift of the plate and turn at its corners `t_s` after the start, px.
    fn at_px(&self, t_s: f64) -> Vector3<f64> {
        let place = self.at(t_s);
        let arm_m = std::f64::consts::SQRT_2 * self.half_side_m;
        self.px_per_m * Vector3::new(place.x, place.y, place.z * arm_m)
    }

    /// Shift of the plate, m, and its turn. The plate's velocity is the wave times the envelope's height, whose
    /// integral by parts has the envelope's slope and curvature, too: on the flanks they are as large as its height.
    fn at(&self, t_s: f64) -> Vector3<f64> {
        let (height, slope) = (self.envelope.at(t_s), self.envelope.slope(t_s));
        let curvature = self.envelope.curvature(t_s);
        match &self.fades {
            None => place(&self.wave, t_s, |rate| Complex::new(slope / rate, curvature / (rate * rate) - height)),
            Some(last) => {
                let faded = if t_s < self.envelope.attack_s { 1.0 - height } else { 0.0 };
                place(&self.wave, t_s, |_| Complex::new(0.0, -height)) + place(last, t_s, |_| Complex::new(0.0, -faded))
            }
        }
    }
}

/// Sums over frames of the swing seen and expected, px.
#[derive(Default)]
struct Swings {
    count: f64,
    seen: Vector3<f64>,
    expected: Vector3<f64>,
    seen_px2: f64,
    expected_px2: f64,
    product_px2: f64,
}

impl Swings {
    fn add(&mut self, seen: Vector3<f64>, expected: Vector3<f64>) {
        self.count += 1.0;
        (self.seen, self.expected) = (self.seen + seen, self.expected + expected);
        self.seen_px2 += seen.norm_squared();
        self.expected_px2 += expected.norm_squared();
        self.product_px2 += seen.dot(&expected);
    }

    /// Place about which the plate swings as expected, at whatever height, and the squares that are left.
    fn offset(&self) -> (Vector3<f64>, f64) {
        let centred = |sum_px2: f64, a: &Vector3<f64>, b: &Vector3<f64>| sum_px2 - a.dot(b) / self.count;
        let expected_px2 = centred(self.expected_px2, &self.expected, &self.expected);
        let product_px2 = centred(self.product_px2, &self.seen, &self.expected);
        let gain = bearable(product_px2 / expected_px2.max(f64::MIN_POSITIVE));
        let left_px2 =
            centred(self.seen_px2, &self.seen, &self.seen) - gain * (2.0 * product_px2 - gain * expected_px2);
        ((self.seen - self.expected * gain) / self.count, left_px2)
    }
}

/// A weak coil changes the swing's height, not its time.
fn bearable(gain: f64) -> f64 {
    gain.clamp(*BEARABLE_GAINS.start(), *BEARABLE_GAINS.end())
}

/// Displacement of the corner that the turn carries the way of the shift, px.
pub fn corner_px(swing_px: Vector3<f64>) -> f64 {
    let turn_px = std::f64::consts::FRAC_1_SQRT_2 * swing_px.z.abs();
    libm::hypot(swing_px.x.abs() + turn_px, swing_px.y.abs() + turn_px)
}

/// Swings about their mean, a column each.
fn centred(swings_px: &[Vector3<f64>]) -> Matrix3xX<f64> {
    let mean_px = swings_px.iter().sum::<Vector3<f64>>() / swings_px.len().max(1) as f64;
    Matrix3xX::from_fn(swings_px.len(), |axis, frame| swings_px[frame][axis] - mean_px[axis])
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
