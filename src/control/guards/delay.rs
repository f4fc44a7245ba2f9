use upm_core::geometry::Vec2;

/// Parts must have gone this far, root mean square, for their way to tell a time, m.
const SHORTEST_M: f64 = 2e-3;
/// A delay of more frames than this is late. Parts go on a while after the middle of a pulse, since friction brings them to
/// speed and to rest: up to 4.7 frames in synthesised fields, 2.9 in rotations (rig upm-2).
const MOST_FRAMES: f64 = 6.5;
/// Pulses in a row that must be late.
const IN_A_ROW: u32 = 2;

/// Measures how late pictures come: a pulse's outline is the same forwards and backwards, so parts have half their way
/// behind them soon after half of the pulse is over.
#[derive(Clone, Debug, Default)]
pub struct DelayGuard {
    /// Time since the start of the pulse, s, and where the parts were seen then, m; frame by frame.
    frames: Vec<(f64, Vec<Vec2>)>,
    late: u32,
}

impl DelayGuard {
    /// A pulse begins, parts at `places_m`.
    pub fn begin(&mut self, places_m: &[Vec2]) {
        self.frames.clear();
        self.frames.push((0.0, places_m.to_vec()));
    }

    /// A frame of the pulse, exposed `since_s` after its start.
    pub fn frame(&mut self, since_s: f64, places_m: Vec<Vec2>) {
        self.frames.push((since_s, places_m));
    }

    /// The pulse, which sounded for `sounding_s`, is over: the delay in frames of `frame_s` once it is too long too often.
    pub fn end(&mut self, sounding_s: f64, frame_s: f64) -> Option<f64> {
        let delay = (self.half_way_s()? - 0.5 * sounding_s) / frame_s;
        self.late = if delay > MOST_FRAMES { self.late + 1 } else { 0 };
        (self.late >= IN_A_ROW).then_some(delay)
    }

    /// When the parts had half their way behind them, s; `None` where they did not go far.
    fn half_way_s(&self) -> Option<f64> {
        let ((_, start), (_, end)) = (self.frames.first()?, self.frames.last()?);
        let total: f64 = start.iter().zip(end).map(|(a, b)| (b - a).norm_squared()).sum();
        if total < SHORTEST_M * SHORTEST_M * start.len() as f64 || start.is_empty() {
            return None;
        }
        let done = |places: &[Vec2]| -> f64 {
            let each = start.iter().zip(end).zip(places).map(|((a, b), p)| (p - a).dot(&(b - a)));
            each.sum::<f64>() / total
        };
        let progress: Vec<(f64, f64)> = self.frames.iter().map(|(t_s, places)| (*t_s, done(places))).collect();
        progress.windows(2).find_map(|pair| match pair {
            [(from_s, from), (to_s, to)] if *from < 0.5 && *to >= 0.5 => {
                Some(from_s + (0.5 - from) / (to - from) * (to_s - from_s))
            }
            _ => None,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const FRAME_S: f64 = 1.0 / 60.0;
    const SOUNDING_S: f64 = 0.4;

    /// A pulse seen `late` frames late, after which parts are `way_m` away.
    fn pulse(guard: &mut DelayGuard, late: f64, way_m: f64) -> Option<f64> {
        let at = |t_s: f64| {
            let done = ((t_s - late * FRAME_S) / SOUNDING_S).clamp(0.0, 1.0);
            vec![Vec2::new(way_m * done * done * (3.0 - 2.0 * done), 0.0), Vec2::zeros()]
        };
        guard.begin(&at(0.0));
        (1..28).map(|i| f64::from(i) * FRAME_S).for_each(|t_s| guard.frame(t_s, at(t_s)));
        guard.end(SOUNDING_S, FRAME_S)
    }

    #[test]
    fn delay_of_eight_frames_is_noticed_in_the_second_pulse() {
        let mut guard = DelayGuard::default();
        assert_eq!([0.0, 3.0, 5.0, 8.0].map(|late| pulse(&mut guard, late, 0.01)), [None; 4]);
        let delay = pulse(&mut guard, 8.0, 0.01).unwrap();
        assert!((5.0..8.5).contains(&delay), "{delay}");
    }

    #[test]
    fn short_ways_tell_no_time() {
        let mut guard = DelayGuard::default();
        assert!((0..5).all(|_| pulse(&mut guard, 9.0, 0.001).is_none()));
        guard.begin(&[]);
        assert_eq!(guard.end(SOUNDING_S, FRAME_S), None);
    }
}
