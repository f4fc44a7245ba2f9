//! Distance carried on a belt: computed from friction, corrected by the calibration's measurements.

use crate::cor_library::{Entry, Library, bracket};
use crate::planner::friction::friction_of;
use crate::planner::pump::{Discs, LANES, Pump, Travel};
use upm_core::units::GRAVITY_MPS2;

/// Nodes of belt speed, evenly spaced in its logarithm.
const SPEEDS: usize = 40;
/// Nodes of spin, relative to the largest in the library.
const SPINS: [f64; LANES] = [0.0, 0.06, 0.12, 0.25, 0.4, 0.6, 0.8, 1.0];
/// Radius of the disc that the table is computed for, m; it matters only on slow belts about near centres.
const RADIUS_M: f64 = 10e-3;
/// Slowest useful belt, relative to the speed at which the plate's acceleration equals that of friction; below about
/// this nothing is carried.
const SLOWEST: f64 = 0.55;
/// Coefficient of friction where the library yields none.
const USUAL_FRICTION: f64 = 0.3;
/// Distances below which measured and computed values are not compared, m, and bounds of their ratio.
const COMPARED_M: f64 = 0.3e-3;
const CORRECTION: (f64, f64) = (0.6, 1.6);

/// Displacements of a part from rest by the speed amplitude of its belt, the plate's spin and the sustain.
#[derive(Clone, Debug)]
pub(super) struct BeltTable {
    first_ln: f64,
    step_ln: f64,
    spin_radps: [f64; LANES],
    /// Time between two sustains, s, and their number, from 0.
    pub sustain_step_s: f64,
    pub sustains: usize,
    /// `[speed][sustain][spin]`.
    travels: Vec<[Travel; LANES]>,
}

/// The table at one spin and one sustain, by belt speed.
#[derive(Clone, Debug)]
pub(super) struct BeltSlice {
    first_ln: f64,
    per_ln: f64,
    travels: [Travel; SPEEDS],
}

impl BeltTable {
    /// Table for the motions of `library`, with sustains of up to `longest_s`.
    pub fn new(library: &Library, longest_s: f64) -> Self {
        let pump = Pump::of(library);
        let friction = friction_of(library).unwrap_or(USUAL_FRICTION);
        let half_side_m = 0.5 * library.plate_side_m;
        let fastest = |entry: &Entry| {
            entry.pump.velocity_mps.norm() + entry.pump.spin_radps.abs() * half_side_m * std::f64::consts::SQRT_2
        };
        let slowest_mps = SLOWEST * friction * GRAVITY_MPS2 / library.base_radps;
        let fastest_mps = library.entries.iter().map(fastest).fold(2.0 * slowest_mps, f64::max) * 1.2;
        let most_spin = library.entries.iter().map(|entry| entry.pump.spin_radps.abs()).fold(1e-6, f64::max);
        let (first_ln, step_ln) = (libm::log(slowest_mps), libm::log(fastest_mps / slowest_mps) / (SPEEDS - 1) as f64);
        let spin_radps = SPINS.map(|part| part * most_spin);
        let sustain_step_s = pump.sustain_step_s();
        let sustains = (longest_s / sustain_step_s).ceil() as usize + 1;
        let discs = |i: usize| {
            let speed_mps = [libm::exp(first_ln + step_ln * i as f64); LANES];
            Discs { speed_mps, spin_radps, friction: [friction; LANES], radius_m: RADIUS_M }
        };
        let sets: Vec<Discs> = (0..SPEEDS).map(discs).collect();
        let travels = pump.travels(&sets, sustains).concat();
        let mut table = Self { first_ln, step_ln, spin_radps, sustain_step_s, sustains, travels };
        table.correct(library);
        table
    }

    /// Scales the table to the measurements: one factor for each speed, over all sustains.
    fn correct(&mut self, library: &Library) {
        let model = &library.displacement;
        let factor = |&speed_mps: &f64| {
            let compared = model.sustain_s.iter().map(|&sustain_s| {
                (model.distance(speed_mps, sustain_s), self.slice(0.0, sustain_s).at(speed_mps).along_m)
            });
            let compared = compared.filter(|&(measured_m, computed_m)| measured_m.min(computed_m) > COMPARED_M);
            let (measured, computed) = compared.fold((0.0, 0.0), |(measured, computed), (measured_m, computed_m)| {
                (measured + measured_m, computed + computed_m)
            });
            (computed > 0.0).then(|| (libm::log(speed_mps), (measured / computed).clamp(CORRECTION.0, CORRECTION.1)))
        };
        let (speeds_ln, factors): (Vec<f64>, Vec<f64>) = model.speed_mps.iter().filter_map(factor).unzip();
        for i in 0..SPEEDS {
            let place = bracket(&speeds_ln, self.first_ln + self.step_ln * i as f64);
            let factor = place.map_or(1.0, |(below, part)| {
                factors[below] + part * (factors[(below + 1).min(factors.len() - 1)] - factors[below])
            });
            for travel in self.travels[i * self.sustains..][..self.sustains].iter_mut().flatten() {
                travel.along_m *= factor;
                travel.across_m *= factor;
            }
        }
    }

    /// The slowest belt in the table, m/s.
    pub fn slowest_mps(&self) -> f64 {
        libm::exp(self.first_ln)
    }

    /// The table at this spin (its sign has no effect) and this sustain.
    pub fn slice(&self, spin_radps: f64, sustain_s: f64) -> BeltSlice {
        let Self { first_ln, step_ln, spin_radps: nodes, sustain_step_s, sustains, .. } = *self;
        let spin = spin_radps.abs().min(nodes[LANES - 1]);
        let q = nodes[1..LANES - 1].partition_point(|&node| node <= spin);
        let along_spin = (spin - nodes[q]) / (nodes[q + 1] - nodes[q]);
        let steps = (sustain_s / sustain_step_s).clamp(0.0, (sustains - 1) as f64);
        let k = (steps as usize).min(sustains.saturating_sub(2));
        let later = (k + 1).min(sustains - 1);
        let along_sustain = steps - k as f64;
        let travel = |i: usize| {
            let row = |k: usize| {
                let spins = &self.travels[i * sustains + k];
                spins[q].towards(&spins[q + 1], along_spin)
            };
            row(k).towards(&row(later), along_sustain)
        };
        let travels = std::array::from_fn(travel);
        BeltSlice { first_ln, per_ln: 1.0 / step_ln, travels }
    }
}

impl BeltSlice {
    /// Displacement on a belt of this speed; below the table it falls linearly to zero.
    #[inline]
    pub fn at(&self, speed_mps: f64) -> Travel {
        let place = (libm::log(speed_mps.max(1e-9)) - self.first_ln) * self.per_ln;
        if place <= 0.0 {
            let share = libm::exp(place / self.per_ln);
            let first = self.travels[0];
            return Travel { along_m: share * first.along_m, across_m: share * first.across_m, ..first };
        }
        let i = (place as usize).min(SPEEDS - 2);
        let part = (place - i as f64).min(1.0);
        self.travels[i].towards(&self.travels[i + 1], part)
    }
}
