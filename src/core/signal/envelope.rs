use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// The outline of a shaped pulse: attack, sustain, decay as long as the attack, then rest until parts are at rest (UPM
/// paper, section 3.3 and Fig. 9).
///
/// The flanks are two parabolas, their slope a triangle: the moving average, over half the flank, of a straight flank
/// half as long. When half the flank is a whole period of the drive, both averages cancel every harmonic. A flank of
/// two periods therefore brings the plate to full height, and back to rest, without setting it swinging on its rods;
/// the residual falls with the square of resonance over drive frequency.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Envelope {
    /// Length of the attack and of the decay, s.
    #[schemars(range(min = 0.0, max = 10.0))]
    pub attack_s: f64,
    /// Length at full height, s.
    #[schemars(range(min = 0.0, max = 60.0))]
    pub sustain_s: f64,
    /// Time without drive after the decay, s; not in the file of a trace.
    #[serde(skip)]
    pub rest_s: f64,
}

impl Envelope {
    /// Height in 0..=1 at `t_s` after the start.
    pub fn at(&self, t_s: f64) -> f64 {
        let from_edge = t_s.min(self.driven_s() - t_s);
        if from_edge <= 0.0 {
            return 0.0;
        }
        if from_edge >= self.attack_s {
            return 1.0;
        }
        let to_full = 1.0 - from_edge / self.attack_s;
        if to_full > 0.5 { 2.0 * (1.0 - to_full) * (1.0 - to_full) } else { 1.0 - 2.0 * to_full * to_full }
    }

    /// First derivative of the height at `t_s` after the start, 1/s.
    #[inline]
    pub fn slope(&self, t_s: f64) -> f64 {
        let to_end_s = self.driven_s() - t_s;
        let from_edge = t_s.min(to_end_s);
        if from_edge <= 0.0 || from_edge >= self.attack_s {
            return 0.0;
        }
        let steepness = 4.0 * from_edge.min(self.attack_s - from_edge) / (self.attack_s * self.attack_s);
        if t_s < to_end_s { steepness } else { -steepness }
    }

    /// Second derivative of the height at `t_s` after the start, 1/s²; constant on each half of a flank.
    #[inline]
    pub fn curvature(&self, t_s: f64) -> f64 {
        let from_edge = t_s.min(self.driven_s() - t_s);
        if from_edge < 0.0 || from_edge >= self.attack_s {
            return 0.0;
        }
        let steepness = 4.0 / (self.attack_s * self.attack_s);
        if from_edge < 0.5 * self.attack_s { steepness } else { -steepness }
    }

    /// Maximum of `|h f + h' g + h'' c|` over all heights h of the flanks and the sustain, with their first and second
    /// derivatives; independent of the sustain's length.
    pub fn largest(&self, f: f64, g: f64, c: f64) -> f64 {
        if self.attack_s == 0.0 {
            return f.abs();
        }
        let (g, c) = (4.0 * g / self.attack_s, 4.0 * c / (self.attack_s * self.attack_s));
        // z, 0 to ½, is the fraction of a flank from its foot or from its top: h = 2z² or 1 - 2z², |h'| = 4z/attack
        let most = |square: f64, linear: f64, constant: f64| {
            let at = |z: f64| ((square * z + linear) * z + constant).abs();
            let vertex = -0.5 * linear / square;
            let inside = if vertex > 0.0 && vertex < 0.5 { at(vertex) } else { 0.0 };
            at(0.0).max(at(0.5)).max(inside)
        };
        let halves = |g: f64| most(2.0 * f, g, c).max(most(-2.0 * f, g, f - c));
        halves(g).max(halves(-g)).max(f.abs())
    }

    /// A bound of [`Self::largest`] that is quick to find.
    #[inline]
    pub fn bound(&self, f: f64, g: f64, c: f64) -> f64 {
        if self.attack_s == 0.0 {
            return f.abs();
        }
        // the largest slope is 2/attack; what rounding adds is far below a billionth
        let (g, c) = (2.0 * g / self.attack_s, 4.0 * c / (self.attack_s * self.attack_s));
        (f.abs() + g.abs() + c.abs()) * (1.0 + 1e-9)
    }

    /// Time during which the motors move, s.
    #[inline]
    pub fn driven_s(&self) -> f64 {
        2.0 * self.attack_s + self.sustain_s
    }

    /// Time until the next pulse may start, s.
    #[inline]
    pub fn total_s(&self) -> f64 {
        self.driven_s() + self.rest_s
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use std::f64::consts::TAU;

    proptest! {
        #[test]
        fn slope_is_that_of_the_height(attack_s in 0.0..0.02f64, sustain_s in 0.0..0.02f64, t_s in -0.01..0.07f64) {
            let envelope = Envelope { attack_s, sustain_s, rest_s: 0.0 };
            let h = 1e-9;
            let corners = [0.0, attack_s, attack_s + sustain_s, envelope.driven_s()];
            prop_assume!(corners.iter().all(|corner| (t_s - corner).abs() > 2.0 * h));
            let difference = (envelope.at(t_s + h) - envelope.at(t_s - h)) / (2.0 * h);
            prop_assert!((envelope.slope(t_s) - difference).abs() < 1e-4 * (1.0 + difference.abs()));
            let middles = [0.5 * attack_s, 1.5 * attack_s + sustain_s];
            prop_assume!(middles.iter().all(|middle| (t_s - middle).abs() > 2.0 * h));
            let bend = (envelope.slope(t_s + h) - envelope.slope(t_s - h)) / (2.0 * h);
            prop_assert!((envelope.curvature(t_s) - bend).abs() < 1e-3 * (1.0 + bend.abs()));
        }

        #[test]
        fn largest_is_reached_and_never_passed(
            attack_s in 0.005..0.03f64, f in -2.0..2.0f64, g in -0.05..0.05f64, c in -5e-4..5e-4f64,
        ) {
            let envelope = Envelope { attack_s, sustain_s: 0.01, rest_s: 0.0 };
            let at = |i: i32| 5e-6 * f64::from(i);
            let played = |t| envelope.at(t) * f + envelope.slope(t) * g + envelope.curvature(t) * c;
            let found = (0..14_000).map(at).map(|t| played(t).abs()).fold(0.0, f64::max);
            let bound = envelope.largest(f, g, c);
            prop_assert!(found <= bound + 1e-12 && found > 0.998 * bound - 1e-9, "{found} {bound}");
            prop_assert!(bound <= envelope.bound(f, g, c));
        }

        /// A wave of whole periods in half the flank leaves neither momentum nor displacement behind: relative to the
        /// steady wave's, both integrals of `d/dt (env p)` vanish at full height, summed in small steps.
        #[test]
        fn a_flank_of_two_periods_averages_every_harmonic_away(k in 1..6i32, phase_rad in 0.0..TAU) {
            const STEPS: i32 = 4000;
            let envelope = Envelope { attack_s: 2.0, sustain_s: 1.0, rest_s: 0.0 };
            let h = 2.0 / f64::from(STEPS);
            let rate = TAU * f64::from(k);
            let t = |i: i32| h * (f64::from(i) + 0.5);
            let place: f64 = (0..STEPS).map(|i| h * envelope.at(t(i)) * (rate * t(i) + phase_rad).cos()).sum();
            let steady = (rate * 2.0 + phase_rad).sin() / rate;
            prop_assert!((place - steady).abs() < 1e-4);
            let sum: f64 = (0..STEPS).map(|i| h * t(i) * envelope.slope(t(i)) * (rate * t(i) + phase_rad).cos()).sum();
            prop_assert!(sum.abs() < 1e-4, "not even with the time as a weight: {sum}");
        }
    }
}
