//! The table's acceleration: a periodic sequence of stretches in which it changes linearly (Singer and Seering, Figs. 4
//! and 7).

/// Points of the displacement in each stretch.
const POINTS: usize = 64;

/// A time interval in which the acceleration changes linearly from one value to another.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct WaveSegment {
    pub length_s: f64,
    /// Accelerations at its ends, upward, m/s².
    pub accel_mps2: [f64; 2],
}

/// Vertical acceleration of the table, by stretches.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Wave {
    /// Stretches of one period, or of a whole motion.
    pub stretches: Vec<WaveSegment>,
}

/// Rectangular wave of acceleration: upward in one interval of the period, downward in the rest (Fig. 4).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Square {
    /// Acceleration upward, `A_X1`, m/s².
    pub up_mps2: f64,
    /// Magnitude of the acceleration downward, `A_X2`, m/s².
    pub down_mps2: f64,
    /// Beginning of the upward acceleration, `T_1`, s.
    pub from_s: f64,
    /// End of the upward acceleration, `T_2`, s.
    pub to_s: f64,
    pub period_s: f64,
}

impl Square {
    /// The wave with vertical edges.
    pub fn wave(&self) -> Wave {
        self.ramped(0.0)
    }

    /// The same with edges that last `ramp` of the period, centred on the original ones (Fig. 7), or as long as there
    /// is room for.
    pub fn ramped(&self, ramp: f64) -> Wave {
        let &Self { up_mps2, down_mps2, from_s, to_s, period_s } = self;
        let (up_s, down_s) = (to_s - from_s, period_s - to_s + from_s);
        let edge_s = (ramp * period_s).min(up_s).min(down_s).max(0.0);
        let stretch = |length_s, accel_mps2| WaveSegment { length_s, accel_mps2 };
        let from_edge = [
            stretch(edge_s, [-down_mps2, up_mps2]),
            stretch(up_s - edge_s, [up_mps2; 2]),
            stretch(edge_s, [up_mps2, -down_mps2]),
            stretch(down_s - edge_s, [-down_mps2; 2]),
        ];
        // the period begins within an edge
        let begin_s = (0.5 * edge_s - from_s).rem_euclid(period_s);
        let mut t_s = 0.0;
        let (mut before, mut after) = (Vec::new(), Vec::new());
        for whole in from_edge {
            let [early, late] = whole.cut(begin_s - t_s);
            before.push(early);
            after.push(late);
            t_s += whole.length_s;
        }
        let stretches = after.into_iter().chain(before).filter(|stretch| stretch.length_s > 1e-12 * period_s);
        Wave { stretches: stretches.collect() }
    }
}

impl Wave {
    pub fn length_s(&self) -> f64 {
        self.stretches.iter().map(|stretch| stretch.length_s).sum()
    }

    /// Stroke of the table from its lowest to its highest position, m, and its largest speed, m/s, for a periodic
    /// motion or one that ends as it began: the mean velocity is subtracted, so that it returns.
    pub fn stroke_and_speed(&self) -> [f64; 2] {
        let motion = self.motion();
        let drift_mps = motion.last().map_or(0.0, |end| end[1]) / self.length_s();
        let (mut low_m, mut high_m, mut fastest_mps) = (0.0f64, 0.0f64, 0.0f64);
        for [t_s, way_m, speed_mps] in motion {
            let place_m = way_m - drift_mps * t_s;
            (low_m, high_m) = (low_m.min(place_m), high_m.max(place_m));
            fastest_mps = fastest_mps.max((speed_mps - drift_mps).abs());
        }
        [high_m - low_m, fastest_mps]
    }

    /// Time, position and speed of a table that starts at rest, s, m and m/s.
    fn motion(&self) -> Vec<[f64; 3]> {
        let (mut t_s, mut speed_mps, mut place_m) = (0.0, 0.0, 0.0);
        let mut found = vec![[0.0; 3]];
        for WaveSegment { length_s, accel_mps2: [first, last] } in &self.stretches {
            let slope = (last - first) / length_s;
            let place = |t: f64| place_m + t * (speed_mps + t * (first / 2.0 + slope * t / 6.0));
            let speed = |t: f64| speed_mps + t * (first + slope * t / 2.0);
            found.extend((1..=POINTS).map(|i| {
                let after_s = length_s * i as f64 / POINTS as f64;
                [t_s + after_s, place(after_s), speed(after_s)]
            }));
            (place_m, speed_mps) = (place(*length_s), speed(*length_s));
            t_s += length_s;
        }
        found
    }
}

impl WaveSegment {
    /// The parts before and after `at_s` from its beginning; one of them is empty where `at_s` is outside it.
    fn cut(&self, at_s: f64) -> [Self; 2] {
        let at_s = at_s.clamp(0.0, self.length_s);
        let [first, last] = self.accel_mps2;
        let middle = if self.length_s > 0.0 { self.accel_mps2(at_s) } else { first };
        [
            Self { length_s: at_s, accel_mps2: [first, middle] },
            Self { length_s: self.length_s - at_s, accel_mps2: [middle, last] },
        ]
    }

    /// Acceleration `t_s` after its beginning, m/s².
    pub fn accel_mps2(&self, t_s: f64) -> f64 {
        let [first, last] = self.accel_mps2;
        first + (last - first) * (t_s / self.length_s)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ramps_keep_areas_and_the_stroke_is_that_of_the_parabolas() {
        let square = Square { up_mps2: 10.0, down_mps2: 10.0, from_s: 0.025, to_s: 0.075, period_s: 0.1 };
        let area = |wave: &Wave| -> f64 {
            wave.stretches.iter().map(|at| 0.5 * (at.accel_mps2[0] + at.accel_mps2[1]) * at.length_s).sum()
        };
        let early = Square { from_s: 0.0, to_s: 0.05, ..square };
        for (square, ramp) in [(square, 0.0), (square, 0.1), (square, 0.9), (early, 0.0), (early, 0.2)] {
            let wave = square.ramped(ramp);
            assert!(area(&wave).abs() < 1e-15 && (wave.length_s() - 0.1).abs() < 1e-15, "{ramp}");
            let ends = [wave.stretches.first(), wave.stretches.last()].map(|end| end.unwrap().accel_mps2);
            assert!(ramp == 0.0 || (ends[0][0] - ends[1][1]).abs() < 1e-12, "{ends:?}");
        }
        // a T² / 16 between the ends of two parabolas, passed in between at a T / 4
        let [stroke_m, speed_mps] = square.wave().stroke_and_speed();
        assert!((stroke_m - 10.0 * 0.01 / 16.0).abs() < 1e-5 && (speed_mps - 0.25).abs() < 1e-12, "{stroke_m}");
        let [ramped_m, ramped_mps] = square.ramped(0.3).stroke_and_speed();
        assert!(ramped_m < stroke_m && ramped_mps < speed_mps);
    }
}
