use upm_core::geometry::{Twist, Vec2, perp};
use upm_core::signal::{Envelope, TwistWave};

/// Longest delay that is looked for, frames.
const LONGEST: usize = 13;
/// From this delay on pictures are late, frames.
const LATE: usize = 2;
/// Pulses in a row that must be late.
const IN_A_ROW: u32 = 2;
/// The plate must swing so far in the frames of a pulse, root of the sum of squares, px.
const LEAST_SWING_PX: f64 = 1.5;
/// A delay must explain the frames so much better than none: part of the squares that it leaves.
const BETTER: f64 = 0.35;
/// And leave no more than this part of what was seen.
const LEFT: f64 = 0.15;
/// Displacements above this are not told apart, px.
const FARTHEST_PX: f64 = 6.0;

/// Measures how late pictures come: how far the plate's corners swing in each frame of a pulse, held against how far they
/// should. Late pictures of a pulse begin with the end of the one before.
#[derive(Clone, Debug, Default)]
pub struct DelayGuard {
    /// Time since the start of the pulse, s, and the largest displacement of a corner, px; frame by frame.
    frames: Vec<(f64, f64)>,
    /// The pulse before, s after whose start this one began.
    before: Option<(Swing, f64)>,
    started_s: f64,
    /// Delay of the last pulse that told one, and pulses in a row that were late.
    last: usize,
    late: u32,
}

impl DelayGuard {
    /// A pulse begins, at `at_s` of plate time.
    pub fn begin(&mut self, at_s: f64) {
        self.frames.clear();
        if let Some((_, ago_s)) = &mut self.before {
            *ago_s = at_s - self.started_s;
        }
        self.started_s = at_s;
    }

    /// A frame of the pulse, exposed `since_s` after its start, with the plate's corners up to `corner_px` from their
    /// places; `None` where that is not seen.
    pub fn frame(&mut self, since_s: f64, corner_px: Option<f64>) {
        self.frames.extend(corner_px.map(|px| (since_s, px.min(FARTHEST_PX))));
    }

    /// The pulse is over, in which the plate should have swung as `swing`. The delay in frames of `frame_s` once pictures
    /// were late too often.
    pub fn end(&mut self, swing: Swing, frame_s: f64) -> Option<usize> {
        let before = self.before.take();
        let delay = self.delay(&swing, before.as_ref(), frame_s);
        self.before = Some((swing, 0.0));
        // a delay of the camera is the same in every pulse
        let last = std::mem::replace(&mut self.last, delay?);
        self.late = match delay? {
            delay if delay < LATE => 0,
            delay if self.late > 0 && delay.abs_diff(last) > 1 => 1,
            _ => self.late + 1,
        };
        delay.filter(|_| self.late >= IN_A_ROW)
    }

    /// The delay that explains the frames best, 0 where none does clearly better; `None` where the plate hardly swings.
    fn delay(&self, swing: &Swing, before: Option<&(Swing, f64)>, frame_s: f64) -> Option<usize> {
        let swing_px = |t_s: f64| match before {
            Some((before, ago_s)) if t_s < 0.0 => before.corner_px(t_s + ago_s),
            _ => swing.corner_px(t_s),
        };
        let total: f64 = self.frames.iter().map(|(t_s, _)| swing_px(*t_s).powi(2)).sum();
        if total < LEAST_SWING_PX * LEAST_SWING_PX {
            return None;
        }
        let left = |delay: usize| -> f64 {
            let each = self.frames.iter().map(|(t_s, px)| px - swing_px(t_s - delay as f64 * frame_s));
            each.map(|off_px| off_px * off_px).sum()
        };
        let each: Vec<f64> = (0..=LONGEST).map(left).collect();
        let (delay, least) =
            each.iter().copied().enumerate().min_by(|(_, a), (_, b)| a.total_cmp(b)).unwrap_or_default();
        let seen: f64 = self.frames.iter().map(|(_, px)| px * px).sum();
        Some(if least < BETTER * each[0] && least < LEFT * seen { delay } else { 0 })
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
mod tests {
    use super::*;
    use upm_core::signal::TwistHarmonic;

    const FRAME_S: f64 = 1.0 / 60.0;
    const PX_PER_M: f64 = 2900.0;
    const HALF_M: f64 = 0.15;
    const ENVELOPE: Envelope = Envelope { attack_s: 1.0 / 15.0, sustain_s: 0.1, rest_s: 0.04 };

    fn wave(speed_mps: f64) -> TwistWave {
        let harmonic = |share: f64| TwistHarmonic {
            cos: Twist::new(speed_mps, 0.0, speed_mps) * share,
            sin: Twist::new(0.0, speed_mps, 0.0) * share,
        };
        TwistWave { base_radps: std::f64::consts::TAU * 30.0, harmonics: vec![harmonic(1.0), harmonic(0.6)] }
    }

    fn swing(speed_mps: f64) -> Swing {
        Swing { wave: wave(speed_mps), envelope: ENVELOPE, half_side_m: HALF_M, px_per_m: PX_PER_M }
    }

    /// What is found in each of three pulses, one straight after the other, seen `late` frames late.
    fn found(late: f64, speed_mps: f64) -> [Option<usize>; 3] {
        const FRAMES: i32 = 17;
        let (mut guard, length_s, swing) = (DelayGuard::default(), f64::from(FRAMES) * FRAME_S, swing(speed_mps));
        let corner_px = |t_s: f64| if t_s < 0.0 { 0.0 } else { swing.corner_px(t_s % length_s) + 0.02 };
        [0.0, 1.0, 2.0].map(|number| {
            let begin_s = number * length_s;
            guard.begin(begin_s);
            for i in 1..=FRAMES {
                let since_s = f64::from(i) * FRAME_S - 0.001;
                guard.frame(since_s, Some(corner_px(begin_s + since_s - late * FRAME_S)));
            }
            guard.end(swing.clone(), FRAME_S)
        })
    }

    #[test]
    fn delay_is_measured_to_the_frame_in_the_second_pulse() {
        for late in [2, 3, 6, 12] {
            assert_eq!(found(f64::from(late), 0.3), [None, Some(late as usize), Some(late as usize)], "{late}");
        }
    }

    #[test]
    fn pictures_in_time_and_weak_pulses_tell_nothing() {
        assert_eq!(found(0.0, 0.3), [None; 3]);
        assert_eq!(found(6.0, 0.001), [None; 3]);
        let mut guard = DelayGuard::default();
        guard.begin(0.0);
        assert_eq!(guard.end(swing(0.3), FRAME_S), None, "no frames");
    }
}
