use std::collections::VecDeque;

use upm_core::geometry::{Twist, Vec2, perp};
use upm_core::signal::{Envelope, TwistWave};

/// Longest delay considered, frames.
const LONGEST: usize = 30;
/// Delay from which on pictures are late, frames.
const LATE: usize = 2;
/// Number of consecutive pulses that must be late.
const IN_A_ROW: u32 = 2;
/// Largest number of frames judged together, besides those that may be late.
const WINDOW: usize = 48;
/// Least planned swing of the plate in these frames, root of the sum of squares, px; for a weak pulse the window
/// includes frames before it.
const LEAST_SWING_PX: f64 = 0.6;
/// Residual without a delay, as a share of the squares, below which frames are in time.
const IN_TIME: f64 = 0.1;
/// The same after fitting the swing at its best height: a plate that swings less or more than planned, in time.
const IN_TIME_AT_ANY_HEIGHT: f64 = 0.02;
/// Largest residual with a delay, relative to the residual without one, for the delay to count.
const BETTER: f64 = 0.35;
/// Largest residual with a delay, as a share of the observed squares.
const LEFT: f64 = 0.15;
/// Share of the squares by which a delay may be worse than the best one and still explain the frames; the shortest is
/// taken.
const ALIKE: f64 = 0.02;
/// The same for comparing two pulses: a delay that explains both is that of the camera.
const AGREES: f64 = 0.06;
/// Residual without a delay, as a share of the squares, above which frames neither confirm nor refute that they are in
/// time.
const UNCLEAR: f64 = 0.2;
/// One pulse suffices where the residual with the delay is below the second share of the squares and the one without is
/// above the first.
const SURE_UNDELAYED: f64 = 0.5;
const SURE_LEFT: f64 = 0.05;
/// A plate that shows less than this share of the planned squares is still in the frames.
const STILL: f64 = 0.03;
/// Residual, as a share of the squares, from which on frames contradict the drive when no delay explains them, and the
/// least swing for that, px. Quick pulses that beat with the suspension leave up to 0.45.
const UNLIKE: f64 = 0.47;
const UNLIKE_SWING_PX: f64 = 1.0;
/// Largest residual, as a share of the squares, of frames that show the planned swing: a swing larger by a fifth leaves
/// this much.
const AS_DRIVEN: f64 = 0.04;
/// Residual from which on they show another swing: one larger or smaller by half leaves this much.
const OTHERWISE: f64 = 0.25;
/// A plate displaced by more than this factor times the drive's displacement plus so many pixels was pushed by
/// something else.
const PUSHED: f64 = 1.3;
const PUSHED_PX: f64 = 0.3;
/// Largest residual, as a share of the squares, of frames that show the expected swing up to its height, and the
/// residual without a delay.
const ALIKE_IN_SHAPE: MotionShape = MotionShape { left: 0.1, undelayed: 0.4 };
/// The same for a swing of another shape, as of a stuttering coil: one whose pictures are in time leaves up to 0.35.
const ROUGHLY_ALIKE: MotionShape = MotionShape { left: 0.3, undelayed: 0.6 };
/// Larger displacements are clamped to this, px.
const FARTHEST_PX: f64 = 6.0;

/// Limits for the comparison of swings in shape alone: the largest residual with a delay and the least without one.
#[derive(Clone, Copy, Debug)]
struct MotionShape {
    left: f64,
    undelayed: f64,
}

/// Measures the delay of the pictures from the displacement of the plate's corners in each frame, compared with the
/// planned one.
#[derive(Clone, Debug)]
pub struct DelayGuard {
    frame_s: f64,
    /// The last frames, oldest first; frames that never arrived keep their place.
    frames: VecDeque<CornerDisplacement>,
    /// Number of the newest frame.
    newest: u64,
    /// The last two pulses with the time of their beginning, s of plate time.
    pulses: VecDeque<(f64, PlateSwing)>,
    /// Delays that explain the last late pulse, and the number of consecutive late pulses.
    last: Delays,
    late: u32,
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

/// Verdict on the timing of some frames.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Timing {
    /// The plate swings too little to be judged.
    Weak,
    InTime,
    /// It swings neither as planned nor as planned with a delay.
    Unclear,
    PictureLag {
        late: PictureLag,
        /// All delays that explain the frames about equally well.
        delays: Delays,
        is_sure: bool,
    },
}

impl Timing {
    /// Verdict on frames that no delay explains.
    fn contradiction() -> Self {
        Self::PictureLag { late: PictureLag::Unseen, delays: Delays::default(), is_sure: false }
    }

    /// Verdict on frames that one delay explains, though not with certainty.
    fn late_by(frames: usize) -> Self {
        Self::PictureLag { late: PictureLag::By(frames), delays: Delays::of([frames].into_iter()), is_sure: false }
    }
}

/// Set of delays, a bit for each number of frames up to [`LONGEST`].
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
struct Delays(u32);

impl Delays {
    fn of(delays: impl Iterator<Item = usize>) -> Self {
        Self(delays.fold(0, |set, delay| set | 1 << delay))
    }

    /// True when one delay, give or take a frame, is in both sets, or one set is empty: pictures that no delay
    /// explains.
    fn agrees_with(self, other: Self) -> bool {
        self.0 == 0 || other.0 == 0 || (self.0 | self.0 << 1 | self.0 >> 1) & other.0 != 0
    }
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
    /// A guard for a camera of this frame rate.
    pub fn new(frame_hz: f64) -> Self {
        Self {
            frame_s: frame_hz.recip(),
            frames: VecDeque::with_capacity(WINDOW + LONGEST),
            newest: 0,
            pulses: VecDeque::with_capacity(2),
            last: Delays::default(),
            late: 0,
        }
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
        matches!(self.newest_pulse(), Timing::PictureLag { late: PictureLag::By(_), .. })
    }

    /// Verdict on the planned swing in the frames since the newest pulse began.
    pub fn swing_seen(&self) -> SwingVerdict {
        let Some((begin_s, _)) = self.pulses.back() else { return SwingVerdict::Unclear };
        let (first, _) = self.window(*begin_s);
        let counted = || self.frames.iter().skip(first).filter(|frame| frame.expected < FARTHEST_PX);
        let expected: f64 = counted().filter(|frame| frame.seen.is_some()).map(|frame| frame.expected.powi(2)).sum();
        let left: f64 = counted().filter_map(|frame| Some((frame.seen? - frame.expected).powi(2))).sum();
        match left / expected {
            _ if expected <= LEAST_SWING_PX * LEAST_SWING_PX => SwingVerdict::Unclear,
            share if share < AS_DRIVEN => SwingVerdict::AsDriven,
            share if share > OTHERWISE => SwingVerdict::Otherwise,
            _ => SwingVerdict::Unclear,
        }
    }

    /// Ends a pulse. Returns the delay of the frames once it is certain.
    pub fn end(&mut self) -> Option<PictureLag> {
        // equal pulses at equal intervals hide a delay of one period: two of them are judged together
        let timing = match self.newest_pulse() {
            Timing::InTime | Timing::Unclear => self.both_pulses(),
            timing => timing,
        };
        match timing {
            Timing::Weak | Timing::Unclear => None,
            Timing::InTime => {
                self.late = 0;
                None
            }
            Timing::PictureLag { late, delays, is_sure } => {
                // a delay of the camera is the same in every pulse
                let last = std::mem::replace(&mut self.last, delays);
                self.late = if delays.agrees_with(last) { self.late + 1 } else { 1 };
                (is_sure || self.late >= IN_A_ROW).then_some(late)
            }
        }
    }

    fn newest_pulse(&self) -> Timing {
        self.timing_since(self.pulses.back())
    }

    fn both_pulses(&self) -> Timing {
        self.timing_since(self.pulses.front())
    }

    /// The delay that best explains the frames since a pulse began, where one is clearly better than none.
    fn timing_since(&self, pulse: Option<&(f64, PlateSwing)>) -> Timing {
        let Some((begin_s, _)) = pulse else { return Timing::Weak };
        let (first, expected) = self.window(*begin_s);
        if expected < LEAST_SWING_PX * LEAST_SWING_PX {
            return Timing::Weak;
        }
        let seen = || self.frames.iter().enumerate().skip(first).filter_map(|(i, frame)| Some((i, frame.seen?)));
        let all: f64 = seen().map(|(_, px)| px * px).sum();
        if all < STILL * expected {
            return Timing::contradiction();
        }
        let left = |delay: usize| -> f64 {
            let expected = |i: usize| i.checked_sub(delay).and_then(|i| self.frames.get(i)).map_or(0.0, |f| f.expected);
            seen().map(|(i, px)| (px - expected(i)).powi(2)).sum()
        };
        let undelayed = left(0);
        let least = (1..=LONGEST).map(left).fold(undelayed, f64::min);
        // equal pulses at equal intervals are explained by a delay and by that delay plus one period
        let delay = (0..=LONGEST).find(|&delay| left(delay) <= least + ALIKE * all).unwrap_or(0);
        let is_explained = least < BETTER * undelayed && least < LEFT * all;
        let tells = expected > UNLIKE_SWING_PX * UNLIKE_SWING_PX;
        if !is_explained && tells && undelayed > UNLIKE * expected.max(all) {
            // pictures show a larger swing than the drive's where something pushed the plate, or where their stamps are
            // off by a fraction of a frame and thus show another phase
            if self.shows_push(first) {
                return self.delay_at_any_scale(first, ALIKE_IN_SHAPE).map_or(Timing::Weak, Timing::late_by);
            }
            return Timing::contradiction();
        }
        if !is_explained && !self.shows_push(first) {
            let in_time = if undelayed > UNCLEAR * all { Timing::Unclear } else { Timing::InTime };
            return self.delay_at_any_scale(first, ROUGHLY_ALIKE).map_or(in_time, Timing::late_by);
        }
        if undelayed < IN_TIME * all || delay < LATE || !is_explained {
            return Timing::InTime;
        }
        // earlier pulses of other heights may fit the height of this one by chance
        if self.left_at_any_scale(first, 0) < IN_TIME_AT_ANY_HEIGHT {
            return Timing::InTime;
        }
        // equal pulses at equal intervals are also explained by a delay of all but one frame of the interval, where the
        // plate swings slightly before its plan; no picture comes early
        let next = |i: usize| self.frames.get(i + 1).map_or(0.0, |frame| frame.expected);
        let early: f64 = seen().map(|(i, px)| (px - next(i)).powi(2)).sum();
        if early <= least + ALIKE * all {
            return Timing::InTime;
        }
        let is_sure = undelayed > SURE_UNDELAYED * all && least < SURE_LEFT * all;
        let delays = Delays::of((LATE..=LONGEST).filter(|&delay| left(delay) <= least + AGREES * all));
        Timing::PictureLag { late: PictureLag::By(delay), delays, is_sure }
    }

    /// True when frames from `first` on show the plate farther from its place than the drive has moved it in any
    /// remembered frame.
    fn shows_push(&self, first: usize) -> bool {
        let seen = self.frames.iter().skip(first).filter_map(|frame| frame.seen).fold(0.0, f64::max);
        let driven = self.frames.iter().map(|frame| frame.expected).fold(0.0, f64::max);
        seen > PUSHED * driven + PUSHED_PX
    }

    /// The delay with which the frames from `first` on show the expected swing, scaled by one factor; `None` where they
    /// are not `alike` enough, or in time.
    fn delay_at_any_scale(&self, first: usize, alike: MotionShape) -> Option<usize> {
        let left = |delay| self.left_at_any_scale(first, delay);
        let best = (LATE..=LONGEST).min_by(|&a, &b| left(a).total_cmp(&left(b)))?;
        (left(best) < alike.left && left(0) > alike.undelayed).then_some(best)
    }

    /// Residual of the frames from `first` on, as a share of the squares, after fitting the expected swing `delay`
    /// frames later at its best height: one minus the squared correlation.
    fn left_at_any_scale(&self, first: usize, delay: usize) -> f64 {
        let shifted = self.frames.iter().skip(first.saturating_sub(delay)).map(|frame| frame.expected);
        let seen = self.frames.iter().skip(first.max(delay)).map(|frame| frame.seen);
        let (mut seen_sq, mut product, mut expected_sq) = (0.0, 0.0, 0.0);
        for (seen, expected) in seen.zip(shifted).filter_map(|(seen, expected)| Some((seen?, expected))) {
            seen_sq += seen * seen;
            product += seen * expected;
            expected_sq += expected * expected;
        }
        1.0 - product * product / (seen_sq * expected_sq).max(f64::MIN_POSITIVE)
    }

    /// Index of the first frame to be judged, and the sum of squares of the expected displacements from there on, px².
    fn window(&self, begin_s: f64) -> (usize, f64) {
        let mut expected = 0.0;
        for (i, frame) in self.frames.iter().enumerate().rev() {
            let age = self.frames.len() - 1 - i;
            let at_s = (self.newest as f64 - age as f64) * self.frame_s;
            if age >= WINDOW || (at_s < begin_s && expected >= LEAST_SWING_PX * LEAST_SWING_PX) {
                return (i + 1, expected);
            }
            expected += frame.seen.map_or(0.0, |_| frame.expected * frame.expected);
        }
        (0, expected)
    }
}

impl PlateSwing {
    /// Largest displacement of the corners from their places, px.
    fn corner_px(&self, t_s: f64) -> f64 {
        let height = self.envelope.at(t_s);
        if height == 0.0 {
            return 0.0;
        }
        (self.px_per_m * height * corner_m(&self.wave, self.half_side_m, t_s)).min(FARTHEST_PX)
    }
}

/// Largest displacement at `t_s` of the corners of a plate that moves as `wave`, m.
fn corner_m(wave: &TwistWave, half_side_m: f64, t_s: f64) -> f64 {
    let place = (1..).zip(&wave.harmonics).fold(Twist::ZERO, |place, (k, harmonic)| {
        let rate = f64::from(k) * wave.base_radps;
        let (sin, cos) = (rate * t_s).sin_cos();
        place + (harmonic.cos * sin + harmonic.sin * -cos) * rate.recip()
    });
    let corners = [(1.0, 1.0), (1.0, -1.0), (-1.0, 1.0), (-1.0, -1.0)].map(|(x, y)| Vec2::new(x, y) * half_side_m);
    let displaced = corners.map(|corner| (place.velocity_mps + perp(corner) * place.spin_radps).norm());
    displaced.into_iter().fold(0.0, f64::max)
}

#[cfg(test)]
mod tests;
