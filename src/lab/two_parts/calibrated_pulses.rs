//! Rotations by a given distance on a simulated plate. The displacement by a pulse is measured beforehand with one coin
//! in the middle of the workspace, for each centre and each sense; long distances are split into several pulses, since
//! a long pulse saturates.

use std::f64::consts::TAU;

use super::super::pulses::{FINER, SERIES_HZ, calm_envelope, check_carries, place, play, saturation, turn};
use super::super::{LabFault, LabRig};
use super::plan::{CENTERS, PartPositions};
use upm_core::geometry::Vec2;
use upm_core::job::PlateMode;
use upm_sim::{OpenLoopTrajectories, OpenPulse};

/// Sustains measured, from the shortest to the longest one used.
const SUSTAINS: usize = 17;
/// The shortest sustain used, in periods; a pulse without any is all flank, in which a plate drifts on its rods.
const SHORTEST_PERIODS: f64 = 1.0;
/// Difference of the longest and the shortest sustain, in attacks: the longest carries parts at least twice as far.
const LONGER_BY_ATTACKS: f64 = 2.0;

/// Spin of a plate with strong motors, rad/s: parts then stay slow compared with the belt, all over the workspace.
pub const STRONG_SPIN_RADPS: f64 = 8.0;

/// A plate and the measured effect of its pulses.
pub struct CalibratedPulses<'a> {
    rig: &'a LabRig,
    mode: PlateMode,
    centers_m: [Vec2; CENTERS],
    pub spin_radps: [f64; CENTERS],
    curves: [[Curve; 2]; CENTERS],
}

/// Distance against sustain, for one centre and one sense.
#[derive(Clone, Default)]
struct Curve {
    sustain_s: Vec<f64>,
    distance_m: Vec<f64>,
}

impl Curve {
    fn shortest_m(&self) -> f64 {
        self.distance_m.first().copied().unwrap_or(f64::NAN)
    }

    fn longest_m(&self) -> f64 {
        self.distance_m.last().copied().unwrap_or(f64::NAN)
    }

    /// Sustains of the pulses that together carry a part by `distance_m` ≥ 0, all equal. Empty when that is less than
    /// half of the shortest pulse.
    fn pulses(&self, distance_m: f64) -> Vec<f64> {
        if distance_m < 0.5 * self.shortest_m() {
            return Vec::new();
        }
        let count = (distance_m / self.longest_m()).ceil().max(1.0);
        vec![self.sustain_for(distance_m / count); count as usize]
    }

    /// Linear interpolation between the measured points; the shortest and the longest pulse beyond them.
    fn sustain_for(&self, distance_m: f64) -> f64 {
        let points = self.sustain_s.windows(2).zip(self.distance_m.windows(2));
        for (sustain, distance) in points {
            if distance_m < distance[0] {
                return sustain[0];
            }
            if distance_m <= distance[1] {
                let along = (distance_m - distance[0]) / (distance[1] - distance[0]);
                return sustain[0] + along * (sustain[1] - sustain[0]);
            }
        }
        self.sustain_s.last().copied().unwrap_or(0.0)
    }
}

impl<'a> CalibratedPulses<'a> {
    /// Measures the effect of pulses about the four centres on a part in the middle.
    pub fn calibrated(
        rig: &'a LabRig,
        mode: PlateMode,
        centers_m: [Vec2; CENTERS],
        spin_radps: [f64; CENTERS],
    ) -> Result<Self, LabFault> {
        let mut model = Self { rig, mode, centers_m, spin_radps, curves: Default::default() };
        for j in 0..CENTERS {
            check_carries(rig, spin_radps[j], centers_m[j].norm())?;
            model.curves[j] = [model.curve(j, 1.0)?, model.curve(j, -1.0)?];
        }
        Ok(model)
    }

    /// The largest over all centres and senses of the shortest distance of one pulse, m.
    pub fn shortest_m(&self) -> f64 {
        self.curves.iter().flatten().map(Curve::shortest_m).fold(0.0, f64::max)
    }

    /// Largest saturation of a part in the middle by the shortest pulses.
    pub fn saturation(&self) -> f64 {
        let outline = calm_envelope(self.rig, self.mode, self.shortest_s());
        let pairs = self.spin_radps.iter().zip(&self.centers_m);
        pairs.map(|(&spin, center)| saturation(self.rig, spin, center.norm(), &outline)).fold(0.0, f64::max)
    }

    fn shortest_s(&self) -> f64 {
        SHORTEST_PERIODS * TAU / self.rig.model.base_radps
    }

    fn curve(&self, center: usize, sense: f64) -> Result<Curve, LabFault> {
        let (mut curve, middle_m) = (Curve::default(), Vec2::zeros());
        for i in 0..SUSTAINS {
            let longer_s = LONGER_BY_ATTACKS * self.rig.model.attack_s * i as f64 / (SUSTAINS - 1) as f64;
            let sustain_s = self.shortest_s() + longer_s;
            let played = self.play(&[middle_m], &[self.pulse(center, sense, sustain_s)])?;
            let end = played.parts.first().and_then(|part| place(part, part.x_m.len() - 1)).unwrap_or(middle_m);
            curve.sustain_s.push(sustain_s);
            curve.distance_m.push(sense * turn(self.centers_m[center], middle_m, end).1);
        }
        if curve.shortest_m() > 0.0 && curve.longest_m() > curve.shortest_m() {
            return Ok(curve);
        }
        Err(LabFault::Rig(format!(
            "longer pulses do not carry a part further: found {:.3} mm with the shortest and {:.3} mm with the longest",
            1e3 * curve.shortest_m(),
            1e3 * curve.longest_m()
        )))
    }

    fn pulse(&self, center: usize, sense: f64, sustain_s: f64) -> OpenPulse {
        let outline = calm_envelope(self.rig, self.mode, sustain_s);
        OpenPulse::about(self.centers_m[center], sense * self.spin_radps[center], outline)
    }

    fn play(&self, parts_m: &[Vec2], pulses: &[OpenPulse]) -> Result<OpenLoopTrajectories, LabFault> {
        play(self.rig, self.mode, parts_m, pulses, SERIES_HZ * FINER as f64)
    }

    /// Rotates the parts by `distance_m` about centre number `center`, counter-clockwise when positive; returns where
    /// they come to rest.
    pub fn rotate(&self, parts_m: &PartPositions, center: usize, distance_m: f64) -> Result<PartPositions, LabFault> {
        let (sense, curve) = if distance_m < 0.0 { (-1.0, 1) } else { (1.0, 0) };
        let pulses: Vec<OpenPulse> = self.curves[center][curve]
            .pulses(distance_m.abs())
            .into_iter()
            .map(|sustain_s| self.pulse(center, sense, sustain_s))
            .collect();
        if pulses.is_empty() {
            return Ok(*parts_m);
        }
        let played = self.play(parts_m, &pulses)?;
        let [first, second] = played.parts.as_slice() else { return Ok(*parts_m) };
        let both = (0..played.t_s.len()).filter_map(|i| Some([place(first, i)?, place(second, i)?]));
        let way: Vec<PartPositions> = both.collect();
        self.check_on_plate(&way)?;
        Ok(way.last().copied().unwrap_or(*parts_m))
    }

    fn check_on_plate(&self, way: &[PartPositions]) -> Result<(), LabFault> {
        let half_side_m = 0.5 * self.rig.sim.plate.side_m;
        match way.iter().flatten().find(|place| place.amax() >= half_side_m) {
            None => Ok(()),
            Some(place) => Err(LabFault::Rig(format!(
                "a part fell off the plate about ({:.1}, {:.1}) mm",
                1e3 * place.x,
                1e3 * place.y
            ))),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ways_are_split_into_equal_pulses_within_the_curve() {
        let curve = Curve { sustain_s: vec![0.0, 0.05, 0.1], distance_m: vec![1e-3, 2e-3, 4e-3] };
        assert_eq!(curve.pulses(0.4e-3), [0.0; 0]);
        assert_eq!(curve.pulses(0.6e-3), [0.0]);
        assert_eq!(curve.pulses(2e-3), [0.05]);
        assert_eq!(curve.pulses(4e-3), [0.1]);
        let several = curve.pulses(9e-3);
        assert_eq!(several.len(), 3);
        assert!(several.iter().all(|s| (s - 0.075).abs() < 1e-12), "{several:?}");
    }
}
