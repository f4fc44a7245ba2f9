//! Motion of the feeder's plate (Impulse paper, section III-A, Fig. 13).

/// One cycle of the plate: its acceleration is `a`, 0, `-a` and `a` in turn, so that its velocity is a trapezoid
/// forwards and a triangle backwards.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PlateCycle {
    /// Acceleration a, m/s².
    pub accel_mps2: f64,
    /// Length of a cycle T, s.
    pub period_s: f64,
    /// Duty d, the share of the cycle in which the plate moves forwards, 0.5 to 1.
    pub duty: f64,
}

impl PlateCycle {
    /// Length of the trapezoid's top: `P = T sqrt(2 d - 1)` (Eq. 1), s, for which the mean displacement is zero.
    pub fn top_s(&self) -> f64 {
        self.period_s * (2.0 * self.duty - 1.0).max(0.0).sqrt()
    }

    /// Length of each flank of the trapezoid, s.
    fn flank_s(&self) -> f64 {
        0.5 * (self.duty * self.period_s - self.top_s())
    }

    /// Length of the backward triangle `B = (1 - d) T`, s.
    fn back_s(&self) -> f64 {
        (1.0 - self.duty) * self.period_s
    }

    /// Largest speed forwards: `(a T/2)(d - sqrt(2 d - 1))`, m/s.
    pub fn peak_mps(&self) -> f64 {
        self.accel_mps2 * self.flank_s()
    }

    /// Distance between the plate's ends, m: the area of the triangle.
    pub fn stroke_m(&self) -> f64 {
        0.25 * self.accel_mps2 * self.back_s().powi(2)
    }

    /// Accelerations, m/s², and lengths, s, of the stretches of the cycle, from rest, rising.
    pub fn stretches(&self) -> [[f64; 2]; 4] {
        let (a, flank_s, half_back_s) = (self.accel_mps2, self.flank_s(), 0.5 * self.back_s());
        [[a, flank_s], [0.0, self.top_s()], [-a, flank_s + half_back_s], [a, half_back_s]]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn cycle_ends_at_rest_where_it_began(accel in 1.0..1e3f64, period_s in 1e-3..0.1f64, duty in 0.5..1.0f64) {
            let plate = PlateCycle { accel_mps2: accel, period_s, duty };
            let (mut t_s, mut speed_mps, mut place_m, mut highest_mps) = (0.0, 0.0, 0.0, 0.0f64);
            for [accel_mps2, length_s] in plate.stretches() {
                place_m += (speed_mps + 0.5 * accel_mps2 * length_s) * length_s;
                speed_mps += accel_mps2 * length_s;
                t_s += length_s;
                highest_mps = highest_mps.max(speed_mps);
            }
            let scale = accel * period_s;
            prop_assert!((t_s - period_s).abs() < 1e-12 && speed_mps.abs() < 1e-12 * scale);
            prop_assert!(place_m.abs() < 1e-12 * scale * period_s, "{place_m}");
            prop_assert!((highest_mps - plate.peak_mps()).abs() < 1e-12 * scale);
        }
    }
}
