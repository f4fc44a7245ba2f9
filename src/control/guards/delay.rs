use std::collections::VecDeque;

use upm_core::geometry::{Twist, Vec2, perp};
use upm_core::signal::{Envelope, TwistWave};

/// Longest delay that is looked for, frames.
const LONGEST: usize = 30;
/// From this delay on pictures are late, frames.
const LATE: usize = 2;
/// Pulses in a row that must be late.
const IN_A_ROW: u32 = 2;
/// Frames that are looked at together at most, besides those that may be late.
const WINDOW: usize = 48;
/// The plate must swing so far in them, root of the sum of squares, px; frames before a weak pulse are looked at, too.
const LEAST_SWING_PX: f64 = 0.6;
/// Frames of which less than this share is left over without a delay are in time.
const IN_TIME: f64 = 0.06;
/// A delay must explain the frames so much better than none: part of the squares that it leaves.
const BETTER: f64 = 0.35;
/// And leave no more than this part of what was seen.
const LEFT: f64 = 0.15;
/// Share of the squares by which a delay may be worse than the best and still explain the frames; the shortest is taken.
const ALIKE: f64 = 0.02;
/// The same where two pulses are held against each other: a delay that explains both is that of the camera.
const AGREES: f64 = 0.06;
/// Share of the squares that frames in time may leave over without a delay; with more they say neither.
const UNCLEAR: f64 = 0.2;
/// One pulse suffices where the delay leaves less than the second share of the squares and none leaves more than the first.
const SURE_UNDELAYED: f64 = 0.5;
const SURE_LEFT: f64 = 0.05;
/// A plate seen to swing less than this share of the planned squares stands still in the frames.
const STILL: f64 = 0.03;
/// Share of the squares that no delay explains from which on frames contradict the drive, and the least swing for that, px.
/// Quick pulses that beat with the suspension leave up to 0.45.
const UNLIKE: f64 = 0.47;
const UNLIKE_SWING_PX: f64 = 1.0;
/// Largest share of the squares left over by frames that show the planned swing: a swing a fifth larger leaves this much.
const AS_DRIVEN: f64 = 0.04;
/// Share from which on they show another one: a swing by half larger or smaller leaves this much.
const OTHERWISE: f64 = 0.25;
/// A plate seen to swing farther than it was driven to by this factor and so many pixels was pushed by something else.
const PUSHED: f64 = 1.3;
const PUSHED_PX: f64 = 0.3;
/// Share of the squares up to which frames show the expected swing in all but its height, and the share that they leave
/// without a delay.
const ALIKE_IN_SHAPE: Shape = Shape { left: 0.1, undelayed: 0.4 };
/// The same for a swing of another shape, of a coil that stutters: one whose pictures are in time leaves up to 0.35.
const ROUGHLY_ALIKE: Shape = Shape { left: 0.3, undelayed: 0.6 };
/// Displacements above this are not told apart, px.
const FARTHEST_PX: f64 = 6.0;

/// How alike swings must be in shape to be told late: the most that a delay may leave, the least that none leaves.
#[derive(Clone, Copy, Debug)]
struct Shape {
    left: f64,
    undelayed: f64,
}

/// Measures how late pictures come: how far the plate's corners swing in each frame, held against how far they should.
#[derive(Clone, Debug)]
pub struct DelayGuard {
    frame_s: f64,
    /// The last frames, oldest first; frames that never came have their place.
    frames: VecDeque<Swung>,
    /// Number of the newest frame.
    newest: u64,
    /// The last two pulses, by when they began, s of plate time.
    pulses: VecDeque<(f64, Swing)>,
    /// Delays that explain the last pulse that was late, and pulses in a row that were.
    last: Delays,
    late: u32,
}

/// How pictures lag behind the drive.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Late {
    /// By so many frames.
    By(usize),
    /// They contradict the drive, and no delay explains them.
    Unseen,
}

/// Planned swing of a pulse as its frames show it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SwingSeen {
    /// That swing.
    AsDriven,
    /// Another one.
    Otherwise,
    /// Too little to tell.
    Unclear,
}

/// How far the corners were from their places in one frame, px.
#[derive(Clone, Copy, Debug)]
struct Swung {
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
    Late {
        late: Late,
        /// All delays that explain the frames about as well.
        delays: Delays,
        is_sure: bool,
    },
}

impl Timing {
    /// Frames that no delay explains.
    fn contradiction() -> Self {
        Self::Late { late: Late::Unseen, delays: Delays::default(), is_sure: false }
    }

    /// Frames that one delay explains, not beyond doubt.
    fn late_by(frames: usize) -> Self {
        Self::Late { late: Late::By(frames), delays: Delays::of([frames].into_iter()), is_sure: false }
    }
}

/// Set of delays, a bit for each number of frames up to [`LONGEST`].
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
struct Delays(u32);

impl Delays {
    fn of(delays: impl Iterator<Item = usize>) -> Self {
        Self(delays.fold(0, |set, delay| set | 1 << delay))
    }

    /// True when one delay, give or take a frame, belongs to both, or one of them is empty: pictures that no delay explains.
    fn agrees_with(self, other: Self) -> bool {
        self.0 == 0 || other.0 == 0 || (self.0 | self.0 << 1 | self.0 >> 1) & other.0 != 0
    }
}

/// How the plate swings in a pulse.
#[derive(Clone, Debug)]
pub struct Swing {
    /// Its velocity at full height, times from the start of the pulse.
    pub wave: TwistWave,
    /// Outline of the pulse, which the displacement follows.
    pub envelope: Envelope,
    /// Distance of the corners from the plate's axes, m.
    pub half_side_m: f64,
    /// Pixels of a metre on the plate.
    pub px_per_m: f64,
}

impl DelayGuard {
    /// For a camera of this rate.
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

    /// A pulse begins at `at_s` of plate time, in which the plate should swing as `swing`.
    pub fn begin(&mut self, at_s: f64, swing: Swing) {
        if self.pulses.len() == 2 {
            self.pulses.pop_front();
        }
        self.pulses.push_back((at_s, swing));
    }

    /// A frame exposed at `at_s` of plate time, with the plate's corners up to `corner_px` from their places; `None` where
    /// that is not seen.
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
        self.frames.push_back(Swung { seen, expected });
    }

    /// The corners' places were wrong until now: nothing is known of how far they were from them.
    pub fn forget_seen(&mut self) {
        self.frames.iter_mut().for_each(|frame| frame.seen = None);
    }

    /// How far the plate's corners should be from their places at `at_s` of plate time, px.
    pub fn expected_px(&self, at_s: f64) -> f64 {
        let pulse = self.pulses.iter().rev().find(|(begin_s, _)| *begin_s <= at_s);
        pulse.map_or(0.0, |(begin_s, swing)| swing.corner_px(at_s - begin_s))
    }

    /// True while the frames of the newest pulse look late: they may show a plate at rest still swinging.
    pub fn looks_late(&self) -> bool {
        matches!(self.newest_pulse(), Timing::Late { late: Late::By(_), .. })
    }

    /// How the frames since the newest pulse began show its planned swing.
    pub fn swing_seen(&self) -> SwingSeen {
        let Some((begin_s, _)) = self.pulses.back() else { return SwingSeen::Unclear };
        let (first, _) = self.window(*begin_s);
        let told = || self.frames.iter().skip(first).filter(|frame| frame.expected < FARTHEST_PX);
        let expected: f64 = told().filter(|frame| frame.seen.is_some()).map(|frame| frame.expected.powi(2)).sum();
        let left: f64 = told().filter_map(|frame| Some((frame.seen? - frame.expected).powi(2))).sum();
        match left / expected {
            _ if expected <= LEAST_SWING_PX * LEAST_SWING_PX => SwingSeen::Unclear,
            share if share < AS_DRIVEN => SwingSeen::AsDriven,
            share if share > OTHERWISE => SwingSeen::Otherwise,
            _ => SwingSeen::Unclear,
        }
    }

    /// Ends a pulse. Returns the delay of the frames once it is certain.
    pub fn end(&mut self) -> Option<Late> {
        // equal pulses at equal distances hide a delay of one period: two of them are judged together
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
            Timing::Late { late, delays, is_sure } => {
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

    /// The delay that explains the frames since a pulse began best, where one does clearly better than none.
    fn timing_since(&self, pulse: Option<&(f64, Swing)>) -> Timing {
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
        // equal pulses at equal distances are explained by a delay and by that plus one period
        let delay = (0..=LONGEST).find(|&delay| left(delay) <= least + ALIKE * all).unwrap_or(0);
        let is_explained = least < BETTER * undelayed && least < LEFT * all;
        let tells = expected > UNLIKE_SWING_PX * UNLIKE_SWING_PX;
        if !is_explained && tells && undelayed > UNLIKE * expected.max(all) {
            // pictures show more of a swing than the drive made where something pushed the plate, or where their stamps are
            // off by a part of a frame, which shows another phase of it
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
        // equal pulses at equal distances are explained by a delay of all but a frame of that, too, where the plate swings a
        // little before its plan; no picture comes early
        let next = |i: usize| self.frames.get(i + 1).map_or(0.0, |frame| frame.expected);
        let early: f64 = seen().map(|(i, px)| (px - next(i)).powi(2)).sum();
        if early <= least + ALIKE * all {
            return Timing::InTime;
        }
        let is_sure = undelayed > SURE_UNDELAYED * all && least < SURE_LEFT * all;
        let delays = Delays::of((LATE..=LONGEST).filter(|&delay| left(delay) <= least + AGREES * all));
        Timing::Late { late: Late::By(delay), delays, is_sure }
    }

    /// True when frames from `first` on show the plate farther from its place than the drive has taken it in all frames
    /// that are remembered.
    fn shows_push(&self, first: usize) -> bool {
        let seen = self.frames.iter().skip(first).filter_map(|frame| frame.seen).fold(0.0, f64::max);
        let driven = self.frames.iter().map(|frame| frame.expected).fold(0.0, f64::max);
        seen > PUSHED * driven + PUSHED_PX
    }

    /// The delay by which the frames from `first` on show the expected swing, larger or smaller by one factor; `None` where
    /// they are not so much `alike`, or show it in time.
    fn delay_at_any_scale(&self, first: usize, alike: Shape) -> Option<usize> {
        let left = |delay| self.left_at_any_scale(first, delay);
        let best = (LATE..=LONGEST).min_by(|&a, &b| left(a).total_cmp(&left(b)))?;
        (left(best) < alike.left && left(0) > alike.undelayed).then_some(best)
    }

    /// Share of the squares that the expected swing, `delay` frames later and at its best height, leaves over in the frames
    /// from `first` on: one minus the squared correlation.
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

impl Swing {
    /// How far the corners are from their places, px, at most.
    fn corner_px(&self, t_s: f64) -> f64 {
        let height = self.envelope.at(t_s);
        if height == 0.0 {
            return 0.0;
        }
        (self.px_per_m * height * corner_m(&self.wave, self.half_side_m, t_s)).min(FARTHEST_PX)
    }
}

/// How far the corners of a plate that moves as `wave` are from their places at `t_s`, at most, m.
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
