//! Rotations by a given distance on a simulated plate. The displacement by a pulse is measured beforehand with one coin
//! in the middle of the workspace, for each centre and each sense; long distances are split into several pulses, since
//! a long pulse saturates.

use std::f64::consts::TAU;

use super::super::pulses::{FINER, Played, SERIES_HZ, calm_envelope, check_carries, mm, play, saturation, turn};
use super::super::{LabError, LabRig};
use super::plan::{CENTERS, PartPositions};
use upm_core::geometry::Vec2;
use upm_core::job::PlateMode;
use upm_sim::OpenPulse;

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

/// Sustains and the distances by them, s and m, for one centre and one sense.
#[derive(Clone, Default)]
struct Curve(Vec<[f64; 2]>);

impl Curve {
    fn shortest_m(&self) -> f64 {
        self.0.first().map_or(f64::NAN, |point| point[1])
    }

    fn longest_m(&self) -> f64 {
        self.0.last().map_or(f64::NAN, |point| point[1])
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
        let wanted_m = distance_m.clamp(self.shortest_m(), self.longest_m());
        let between = self.0.windows(2).find(|pair| wanted_m <= pair[1][1]);
        between.map_or(f64::NAN, |pair| {
            let [[from_s, from_m], [to_s, to_m]] = [pair[0], pair[1]];
            from_s + (wanted_m - from_m) / (to_m - from_m) * (to_s - from_s)
        })
    }
}

impl<'a> CalibratedPulses<'a> {
    /// Measures the effect of pulses about the four centres on a part in the middle.
    pub fn calibrated(
        rig: &'a LabRig,
        mode: PlateMode,
        centers_m: [Vec2; CENTERS],
        spin_radps: [f64; CENTERS],
    ) -> Result<Self, LabError> {
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

    fn curve(&self, center: usize, sense: f64) -> Result<Curve, LabError> {
        let (mut curve, middle_m) = (Curve::default(), Vec2::zeros());
        for i in 0..SUSTAINS {
            let longer_s = LONGER_BY_ATTACKS * self.rig.model.attack_s * i as f64 / (SUSTAINS - 1) as f64;
            let sustain_s = self.shortest_s() + longer_s;
            let end_m = self.play(&[middle_m], &[self.pulse(center, sense, sustain_s)])?.end_m(0);
            curve.0.push([sustain_s, sense * turn(self.centers_m[center], middle_m, end_m).1]);
        }
        if curve.shortest_m() > 0.0 && curve.longest_m() > curve.shortest_m() {
            return Ok(curve);
        }
        Err(LabError::Rig(format!(
            "longer pulses do not carry a part further: found {:.3} mm with the shortest and {:.3} mm with the longest",
            1e3 * curve.shortest_m(),
            1e3 * curve.longest_m()
        )))
    }

    fn pulse(&self, center: usize, sense: f64, sustain_s: f64) -> OpenPulse {
        let outline = calm_envelope(self.rig, self.mode, sustain_s);
        OpenPulse::about(self.centers_m[center], sense * self.spin_radps[center], outline)
    }

    fn play(&self, parts_m: &[Vec2], pulses: &[OpenPulse]) -> Result<Played, LabError> {
        play(self.rig, self.mode, parts_m, pulses, SERIES_HZ * FINER as f64)
    }

    /// Rotates the parts by `distance_m` about centre number `center`, counter-clockwise when positive; returns where
    /// they come to rest.
    pub fn rotate(&self, parts_m: &PartPositions, center: usize, distance_m: f64) -> Result<PartPositions, LabError> {
        let (sense, curve) = if distance_m < 0.0 { (-1.0, 1) } else { (1.0, 0) };
        let sustains_s = self.curves[center][curve].pulses(distance_m.abs());
        if sustains_s.is_empty() {
            return Ok(*parts_m);
        }
        let pulses: Vec<OpenPulse> = sustains_s.iter().map(|&s| self.pulse(center, sense, s)).collect();
        let played = self.play(parts_m, &pulses)?;
        let is_off = |place: &&Vec2| place.amax() >= 0.5 * self.rig.sim.plate.side_m;
        match played.ways_m.iter().flatten().find(is_off) {
            None => Ok([played.end_m(0), played.end_m(1)]),
            Some(place) => {
                let [x, y] = mm(*place);
                Err(LabError::Rig(format!("a part fell off the plate about ({x:.1}, {y:.1}) mm")))
            }
        }
    }
}
