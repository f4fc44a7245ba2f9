//! Candidate pulses: what each does to every part, and what time it takes.

use super::belts::{Belts, Pulse};
use crate::PartState;
use upm_core::geometry::Vec2;

/// Ways of candidate pulses on their typical belts, m.
const LEVELS_M: [f64; 10] = [25e-3, 16e-3, 10e-3, 7e-3, 5e-3, 3.5e-3, 2.5e-3, 1.7e-3, 1.2e-3, 0.8e-3];
/// A candidate is at most this many times as long as the root mean square of the steps: long pulses span little more than
/// rigid motions, and what cancels of them costs more than it moves.
const LONGEST: f64 = 1.4;
/// The shortest candidates are offered whatever the steps, m.
const ALWAYS_M: f64 = 1.3e-3;

/// Exact displacements of pulses on all parts, in mm, with their times.
#[derive(Clone, Debug, Default)]
pub(super) struct Columns {
    rows: usize,
    /// Column by column: x, y of each part, mm.
    values_mm: Vec<f64>,
    pub price_s: Vec<f64>,
    pub pulses: Vec<Pulse>,
}

impl Columns {
    /// Every usable belt both ways at every length that suits steps of `rms_m`.
    pub fn all(belts: &Belts, parts: &[PartState], rms_m: f64) -> Self {
        let usable = belts.usable(parts.iter().map(|part| (part.position_m, part.radius_m)));
        let mut columns = Self { rows: 2 * parts.len(), ..Self::default() };
        for level_m in LEVELS_M.into_iter().filter(|&level_m| level_m <= (LONGEST * rms_m).max(ALWAYS_M)) {
            for &belt in &usable {
                let (low_m, high_m) = belts.range_m(belt);
                let way_m = level_m.clamp(low_m, high_m);
                for way_m in [way_m, -way_m] {
                    columns.push(belts, parts, Pulse { belt, way_m });
                }
            }
        }
        columns
    }

    /// These pulses.
    pub fn of(belts: &Belts, parts: &[PartState], pulses: impl Iterator<Item = Pulse>) -> Self {
        let mut columns = Self { rows: 2 * parts.len(), ..Self::default() };
        pulses.for_each(|pulse| columns.push(belts, parts, pulse));
        columns
    }

    fn push(&mut self, belts: &Belts, parts: &[PartState], pulse: Pulse) {
        let motion = belts.motion(pulse);
        let mut coasts_s = 0.0f64;
        for part in parts {
            let (end, coasts): (Vec2, f64) = motion.carry(part.position_m, part.gain);
            let step_mm = (end - part.position_m) * 1e3;
            self.values_mm.extend([step_mm.x, step_mm.y]);
            coasts_s = coasts_s.max(coasts);
        }
        self.price_s.push(belts.price_s(motion.setting, coasts_s));
        self.pulses.push(pulse);
    }

    pub fn len(&self) -> usize {
        self.pulses.len()
    }

    /// Column `j`, mm.
    pub fn column(&self, j: usize) -> &[f64] {
        &self.values_mm[j * self.rows..][..self.rows]
    }

    /// Worth of column `j` at `prices` (s/mm) for each second that it takes.
    pub fn pay(&self, j: usize, prices: &[f64]) -> f64 {
        self.column(j).iter().zip(prices).map(|(d, y)| d * y).sum::<f64>() / self.price_s[j]
    }
}
