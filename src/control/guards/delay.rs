use upm_core::geometry::{Twist, Vec2, perp};
use upm_core::signal::{Envelope, TwistWave};

/// Longest delay that is looked for, frames.
const LONGEST: usize = 16;
/// From this delay on pictures are late, frames.
const LATE: usize = 2;
/// Pulses in a row that must be late.
const IN_A_ROW: u32 = 2;
/// The plate must swing so far in the frames of a pulse, root of the sum of squares, px.
const LEAST_SWING_PX: f64 = 1.5;
/// A delay must explain the frames so much better than none: part of the squares that it leaves.
const BETTER: f64 = 0.35;

/// Measures how late pictures come: how far the plate's corners swing in each frame of a pulse, held against how far they
/// did by the accelerometers.
#[derive(Clone, Debug, Default)]
pub struct DelayGuard {
    /// Time since the start of the pulse, s, and the largest displacement of a corner, px; frame by frame.
    frames: Vec<(f64, f64)>,
    late: u32,
}

impl DelayGuard {
    /// A pulse begins.
    pub fn begin(&mut self) {
        self.frames.clear();
    }

    /// A frame of the pulse, exposed `since_s` after its start, with the plate's corners up to `corner_px` from their
    /// places; `None` where that is not seen.
    pub fn frame(&mut self, since_s: f64, corner_px: Option<f64>) {
        self.frames.extend(corner_px.filter(|px| px.is_finite()).map(|px| (since_s, px)));
    }

    /// The pulse is over; by the accelerometers the plate, with corners `half_side_m` from its axes, moved as `wave` under
    /// `envelope`. The delay in frames of `frame_s` once pictures were late too often.
    pub fn end(
        &mut self,
        wave: &TwistWave,
        envelope: &Envelope,
        half_side_m: f64,
        px_per_m: f64,
        frame_s: f64,
    ) -> Option<usize> {
        let swing_px = |t_s: f64| px_per_m * envelope.at(t_s) * corner_m(wave, half_side_m, t_s);
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
        let is_late = delay >= LATE && least < BETTER * each[0];
        self.late = if is_late { self.late + 1 } else { 0 };
        (self.late >= IN_A_ROW).then_some(delay)
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
            cos: Twist::new(speed_mps, 0.0, 0.5) * share,
            sin: Twist::new(0.0, speed_mps, 0.0) * share,
        };
        TwistWave { base_radps: std::f64::consts::TAU * 30.0, harmonics: vec![harmonic(1.0), harmonic(0.6)] }
    }

    /// A pulse seen `late` frames late.
    fn pulse(guard: &mut DelayGuard, late: f64, speed_mps: f64) -> Option<usize> {
        let wave = wave(speed_mps);
        guard.begin();
        for i in 1..18 {
            let t_s = f64::from(i) * FRAME_S - 0.001;
            let seen_s = t_s - late * FRAME_S;
            guard.frame(t_s, Some(PX_PER_M * ENVELOPE.at(seen_s) * corner_m(&wave, HALF_M, seen_s) + 0.02));
        }
        guard.end(&wave, &ENVELOPE, HALF_M, PX_PER_M, FRAME_S)
    }

    #[test]
    fn delay_is_measured_to_the_frame_in_the_second_pulse() {
        for late in [2, 3, 6, 12] {
            let mut guard = DelayGuard::default();
            let found = [(); 2].map(|()| pulse(&mut guard, f64::from(late), 0.3));
            assert_eq!(found, [None, Some(late as usize)]);
        }
    }

    #[test]
    fn pictures_in_time_and_weak_pulses_tell_nothing() {
        let mut guard = DelayGuard::default();
        assert!((0..5).all(|_| pulse(&mut guard, 0.0, 0.3).is_none()));
        assert!((0..5).all(|_| pulse(&mut guard, 6.0, 0.001).is_none()));
        guard.begin();
        assert_eq!(guard.end(&wave(0.3), &ENVELOPE, HALF_M, PX_PER_M, FRAME_S), None, "no frames");
    }
}
