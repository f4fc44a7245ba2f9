//! Parts on a plate with prescribed motion along one line, as assumed by the closed forms.

use std::f64::consts::TAU;

use super::coulomb_pump;
use super::numerics::bisect;
use upm_core::geometry::{Pose, Twist, Vec2};
use upm_core::signal::{TwistHarmonic, TwistWave};
use upm_core::units::GRAVITY_MPS2;
use upm_sim::{ContactParams, PartParams, Parts, PlateMotion};

/// Side of the plate, m: large enough for any displacement.
const SIDE_M: f64 = 10.0;
/// Slip below which a part counts as stuck, m/s.
const STUCK_MPS: f64 = 1e-9;

/// Second harmonic of the pump over its first: cosine and sine.
pub(super) const PUMP: [f64; 2] = [-0.5, 0.0];

/// Friction so small that a part's speed stays constant for a cycle: the limit of fast vibration.
pub(super) const FAINT: f64 = 1e-5;

/// A plate of velocity `A (cos wt + c cos 2wt + s sin 2wt)` along x, and the time step of its simulation.
#[derive(Clone, Copy, Debug)]
pub(super) struct PumpedLine {
    /// A, m/s.
    pub amplitude_mps: f64,
    /// w, rad/s.
    pub base_radps: f64,
    /// c and s.
    pub second: [f64; 2],
    /// Steps of a cycle.
    pub steps: u32,
}

impl PumpedLine {
    pub fn cycle_s(&self) -> f64 {
        TAU / self.base_radps
    }

    /// `part` on the plate, at `speed_mps`, and the plate's motion in the middle of every step of a cycle.
    fn part(&self, part: PartParams, speed_mps: f64) -> (Parts, Vec<PlateMotion>) {
        let along = |share: f64| Twist::new(share * self.amplitude_mps, 0.0, 0.0);
        let harmonic = |[cos, sin]: [f64; 2]| TwistHarmonic { cos: along(cos), sin: along(sin) };
        let harmonics = vec![harmonic([1.0, 0.0]), harmonic(self.second)];
        let wave = TwistWave { base_radps: self.base_radps, harmonics };
        let (contact, step_s) =
            (ContactParams { restitution: 0.0, rim_friction: 0.0 }, self.cycle_s() / f64::from(self.steps));
        let motion = |step: u32| PlateMotion { twist: wave.at((f64::from(step) + 0.5) * step_s), ..Default::default() };
        let mut parts = Parts::new(&[(part, Pose::IDENTITY)], &contact, SIDE_M, step_s);
        parts.push(0, Vec2::new(speed_mps, 0.0), 0.0);
        (parts, (0..self.steps).map(motion).collect())
    }

    /// Place, m, and speed, m/s, of `part` after each of `cycles` cycles; its start, at 0 with `from_mps`, comes first.
    pub fn states(&self, part: PartParams, from_mps: f64, cycles: u32) -> Vec<[f64; 2]> {
        let (mut parts, cycle) = self.part(part, from_mps);
        let after_a_cycle = |_| {
            for motion in &cycle {
                parts.step(motion);
            }
            let part = parts.motions().next();
            part.map_or([f64::NAN; 2], |part| [part.part_in_table.position_m.x, part.velocity_mps.x])
        };
        std::iter::once([0.0, from_mps]).chain((0..cycles).map(after_a_cycle)).collect()
    }

    /// Mean force over one cycle, in units of μ m g, on a part that moves at `speed_mps`.
    pub fn mean_force(&self, part: PartParams, speed_mps: f64) -> f64 {
        let gained_mps = self.states(part, speed_mps, 1)[1][1] - speed_mps;
        gained_mps / (part.friction * GRAVITY_MPS2 * self.cycle_s())
    }

    /// Mean speed of `part` from rest over `cycles` cycles after `settling` others, m/s.
    pub fn carried_mps(&self, part: PartParams, settling: u32, cycles: u32) -> f64 {
        let states = self.states(part, 0.0, settling + cycles);
        let [settled_m, later_m] = [settling, settling + cycles].map(|cycle| states[cycle as usize][0]);
        (later_m - settled_m) / (f64::from(cycles) * self.cycle_s())
    }

    /// Distance between the ends of a plate that moves as the pump: `2.2018 A/w`, twice the maximum of
    /// `sin a - ¼ sin 2a`, m.
    pub fn stroke_m(&self) -> f64 {
        let cos = 0.5 * (1.0 - 3f64.sqrt());
        let sin = (1.0 - cos * cos).sqrt();
        2.0 * sin * (1.0 - 0.5 * cos) * self.amplitude_mps / self.base_radps
    }

    /// True when `part`, initially at rest on the plate, slips within two cycles.
    fn slides(&self, part: PartParams) -> bool {
        let plate_mps = |motion: &PlateMotion| motion.twist.velocity_mps.x;
        let start_mps = self.part(part, 0.0).1.first().map_or(0.0, plate_mps);
        let (mut parts, cycle) = self.part(part, start_mps);
        cycle.iter().chain(&cycle).any(|motion| {
            parts.step(motion);
            parts.motions().any(|part| (part.velocity_mps.x - plate_mps(motion)).abs() > STUCK_MPS)
        })
    }
}

/// The amplitude of the plate's acceleration `A w`, in units of μ g, from which `part` slides, by bisection.
pub(super) fn sliding_threshold(part: PartParams, base_radps: f64, step_s: f64) -> f64 {
    const HALVINGS: usize = 40;
    let steps = (TAU / base_radps / step_s).round().max(1.0) as u32;
    let slides = |share: f64| {
        let amplitude_mps = share * part.friction * GRAVITY_MPS2 / base_radps;
        PumpedLine { amplitude_mps, base_radps, second: PUMP, steps }.slides(part)
    };
    bisect([0.0, 2.0 / coulomb_pump::peak_acceleration()], HALVINGS, slides)[1]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::lab_rig;

    /// Speed of a part after many cycles, over A, on a plate whose A w is `share` of μ g.
    fn carried(share: f64) -> f64 {
        let (base_radps, part) = (TAU * 60.0, PartParams { radius_m: 0.0, ..lab_rig("upm-1").penny });
        let amplitude_mps = share * part.friction * GRAVITY_MPS2 / base_radps;
        let line = PumpedLine { amplitude_mps, base_radps, second: PUMP, steps: 2000 };
        line.carried_mps(part, 20, 20) / amplitude_mps
    }

    #[test]
    fn stroke_is_that_of_the_wave() {
        let line = PumpedLine { amplitude_mps: 1.0, base_radps: 1.0, second: PUMP, steps: 1 };
        let places = (0..100_000).map(|i| 1e-5 * TAU * f64::from(i)).map(|a| a.sin() - 0.25 * (2.0 * a).sin());
        assert!((2.0 * places.fold(0.0, f64::max) - line.stroke_m()).abs() < 1e-8);
    }

    #[test]
    fn parts_stick_then_creep_backwards_then_are_carried() {
        assert!(carried(0.5).abs() < 1e-4);
        assert!(carried(1.0) < -5e-3);
        let from = coulomb_pump::CARRIED_FROM;
        assert!(carried(from - 0.05) < 0.0 && carried(from + 0.05) > 0.0);
        assert!(carried(3.0) > 0.2);
    }
}
