//! Library of start motions: a few hundred random ones, each with a table of its mean friction over the plate.
//!
//! Rotating the plate by quarter turns and mirroring it give further motions with the same tables, and a motion run
//! backwards pushes in the opposite direction. The search starts from the best of these thousands for the present
//! parts.

use std::cmp::Ordering;

use rand::RngExt;

use upm_core::geometry::Vec2;
use upm_core::random::Streams;

use super::harmonic_basis::{HarmonicBasis, PlateInstant, SimdF64};

/// Motions that have a table, eight at a time.
const MOTIONS: usize = 8 * EIGHTS;
const EIGHTS: usize = 24;
/// Nodes of a table along a side of the plate.
const NODES: usize = 17;
/// Phases of a period over which a mean is taken, eight at a time.
const PHASES: usize = 96;
/// Squared speed below which friction fades, relative to the motion's mean square: mean fields are evaluated for parts
/// at rest.
const SPEED_SOFTENING: f64 = 1e-4;
/// Price of a displacement across the wanted step, relative to one along it.
const CROSS_STEP_PRICE: f64 = 0.3;

/// One of the eight symmetries of a square, by number: quarter turns, from 4 on after a mirroring.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Symmetry(usize);

impl Symmetry {
    const COUNT: usize = 8;

    fn mirrors(self) -> bool {
        self.0 >= 4
    }

    /// Image of `v`: mirrored first (x changes sign), then turned.
    fn onto(self, v: Vec2) -> Vec2 {
        let v = if self.mirrors() { Vec2::new(-v.x, v.y) } else { v };
        (0..self.0 % 4).fold(v, |v, _| Vec2::new(-v.y, v.x))
    }

    fn back(self, v: Vec2) -> Vec2 {
        let v = (0..self.0 % 4).fold(v, |v, _| Vec2::new(v.y, -v.x));
        if self.mirrors() { Vec2::new(-v.x, v.y) } else { v }
    }
}

/// Random motions and their mean push on parts at rest.
#[derive(Clone, Debug)]
pub(super) struct SeedLibrary {
    half_side_m: f64,
    motions: Vec<Vec<f64>>,
    /// `mean_forces[row * NODES + column]`: mean direction of the slip, x and y, for eight motions at a time.
    mean_forces: Vec<[[SimdF64; 2]; EIGHTS]>,
}

/// A motion of the seed library under one symmetry and direction, with its expected score.
struct SeedScore {
    score: f64,
    motion: usize,
    symmetry: Symmetry,
    reverse: bool,
}

impl SeedScore {
    fn order(&self, other: &Self) -> Ordering {
        other.score.total_cmp(&self.score).then(self.motion.cmp(&other.motion))
    }
}

impl SeedLibrary {
    /// The seed library for these harmonics; deterministic, equal for equal harmonics.
    pub fn new(basis: &HarmonicBasis, half_side_m: f64) -> Self {
        let mut rng = Streams::new(0).stream("field bank");
        let random = || (0..basis.len()).map(|j| rng.random_range(-1.0..1.0) / basis.harmonic_of(j) as f64).collect();
        Self::of(random, basis, half_side_m)
    }

    /// Motions for parts that move: spectra from flat ones to those of [`Self::new`], and more spin. Smooth fields,
    /// those of few low harmonics, cannot carry many parts each its own way.
    pub fn rich(basis: &HarmonicBasis, half_side_m: f64) -> Self {
        const FALLS: [f64; 4] = [0.0, 0.25, 0.5, 1.0];
        const SPINS: [f64; 3] = [1.0, 2.0, 3.0];
        let mut rng = Streams::new(0).stream("moving field bank");
        let random = || {
            let (fall, spin) = (FALLS[rng.random_range(0..FALLS.len())], SPINS[rng.random_range(0..SPINS.len())]);
            let scaled = |j: usize, drawn: f64| {
                let share = drawn * libm::pow(basis.harmonic_of(j) as f64, -fall);
                if j < 2 * basis.per_axis() { share } else { spin * share }
            };
            (0..basis.len()).map(|j| scaled(j, rng.random_range(-1.0..1.0))).collect()
        };
        Self::of(random, basis, half_side_m)
    }

    fn of(random: impl FnMut() -> Vec<f64>, basis: &HarmonicBasis, half_side_m: f64) -> Self {
        let motions: Vec<Vec<f64>> = std::iter::repeat_with(random).take(MOTIONS).collect();
        let tables: Vec<Vec<Vec2>> = motions.iter().map(|motion| table(basis, motion, half_side_m)).collect();
        let mean_forces = |node: usize| {
            std::array::from_fn(|k| {
                let eight = |axis: usize| std::array::from_fn::<f64, 8, _>(|lane| tables[8 * k + lane][node][axis]);
                [0, 1].map(|axis| SimdF64::from(eight(axis)))
            })
        };
        Self { half_side_m, motions, mean_forces: (0..NODES * NODES).map(mean_forces).collect() }
    }

    /// The `count` motions with the highest score for `steps_m` of parts at `positions_m`, best first.
    pub fn best(&self, basis: &HarmonicBasis, positions_m: &[Vec2], steps_m: &[Vec2], count: usize) -> Vec<Vec<f64>> {
        let mut scores = Vec::with_capacity(MOTIONS * Symmetry::COUNT);
        for symmetry in (0..Symmetry::COUNT).map(Symmetry) {
            scores.extend(self.scores(symmetry, positions_m, steps_m));
        }
        let count = count.min(scores.len());
        if count == 0 {
            return Vec::new();
        }
        scores.select_nth_unstable_by(count - 1, SeedScore::order);
        scores.truncate(count);
        scores.sort_by(SeedScore::order);
        scores.iter().map(|score| self.transformed(basis, score)).collect()
    }

    /// Scores of all motions under `symmetry`.
    fn scores(&self, symmetry: Symmetry, positions_m: &[Vec2], steps_m: &[Vec2]) -> impl Iterator<Item = SeedScore> {
        let length_m = steps_m.iter().map(|s| s.norm_squared()).sum::<f64>().sqrt();
        let mut sums = [[SimdF64::ZERO; 2]; EIGHTS];
        for (&p, &s) in positions_m.iter().zip(steps_m) {
            let step = symmetry.back(s) / length_m;
            for ([along, square], [x, y]) in sums.iter_mut().zip(self.pushes_at(symmetry.back(p))) {
                *along += x * step.x + y * step.y;
                *square += x * x + y * y;
            }
        }
        let scored = move |(k, [along, square]): (usize, [SimdF64; 2])| {
            let astray = (square - along * along).max(SimdF64::ZERO).sqrt();
            let scores = (along.abs() - astray * CROSS_STEP_PRICE).to_array();
            let lanes = scores.into_iter().zip(along.to_array()).enumerate();
            lanes.map(move |(lane, (score, along))| SeedScore {
                score,
                motion: 8 * k + lane,
                symmetry,
                reverse: along < 0.0,
            })
        };
        sums.into_iter().enumerate().flat_map(scored)
    }

    /// Pushes of every motion under every symmetry on parts at rest at `positions_m`: mean directions of the slip.
    pub fn all_mean_forces(&self, positions_m: &[Vec2]) -> impl Iterator<Item = Vec<Vec2>> {
        (0..Symmetry::COUNT).map(Symmetry).flat_map(move |symmetry| {
            let at: Vec<Vec<[SimdF64; 2]>> =
                positions_m.iter().map(|&p| self.pushes_at(symmetry.back(p)).collect()).collect();
            (0..MOTIONS).map(move |motion| {
                let push = |eights: &Vec<[SimdF64; 2]>| {
                    let [x, y] = eights[motion / 8].map(|lanes| lanes.to_array()[motion % 8]);
                    symmetry.onto(Vec2::new(x, y))
                };
                at.iter().map(push).collect()
            })
        })
    }

    /// Pushes of all motions at `p_m`, in the order of the tables.
    fn pushes_at(&self, p_m: Vec2) -> impl Iterator<Item = [SimdF64; 2]> {
        let (node, place) = self.node(p_m);
        let corners = [node, node + 1, node + NODES, node + NODES + 1].map(|node| &self.mean_forces[node]);
        let [left, low] = [1.0 - place.x, 1.0 - place.y];
        let weights = [left * low, place.x * low, left * place.y, place.x * place.y];
        (0..EIGHTS).map(move |k| {
            [0, 1].map(|axis| {
                let [a, b, c, d] = corners.map(|corner| corner[k][axis]);
                (a * weights[0] + b * weights[1]) + (c * weights[2] + d * weights[3])
            })
        })
    }

    /// Coefficients of the motion with its symmetry and direction applied.
    fn transformed(&self, basis: &HarmonicBasis, &SeedScore { motion, symmetry, reverse, .. }: &SeedScore) -> Vec<f64> {
        let n = basis.per_axis();
        let mut transformed = self.motions[motion].clone();
        let sign = if reverse { -1.0 } else { 1.0 };
        for j in 0..n {
            let along = symmetry.onto(Vec2::new(transformed[j], transformed[n + j])) * sign;
            (transformed[j], transformed[n + j]) = (along.x, along.y);
            transformed[2 * n + j] *= if symmetry.mirrors() { -sign } else { sign };
        }
        transformed
    }

    /// The table's cell at `p_m`: its first node and the position in it, 0 to 1 on each axis.
    fn node(&self, p_m: Vec2) -> (usize, Vec2) {
        let cells = (NODES - 1) as f64;
        let along = (p_m / (2.0 * self.half_side_m)).map(|v| (v + 0.5).clamp(0.0, 1.0) * cells);
        let cell = along.map(|v| v.floor().min(cells - 1.0));
        (cell.y as usize * NODES + cell.x as usize, along - cell)
    }
}

fn table(basis: &HarmonicBasis, motion: &[f64], half_side_m: f64) -> Vec<Vec2> {
    let phases = basis.motion(motion);
    let phase = |i: usize| phases[i * phases.len() / PHASES];
    let square = (0..PHASES).map(|i| phase(i).velocity_mps.norm_squared()).sum::<f64>() / PHASES as f64;
    let eight = |first: usize| {
        let each =
            |of: fn(&PlateInstant) -> f64| SimdF64::from(std::array::from_fn::<f64, 8, _>(|i| of(&phase(first + i))));
        [each(|plate| plate.velocity_mps.x), each(|plate| plate.velocity_mps.y), each(|plate| plate.spin_radps)]
    };
    let eights: Vec<[SimdF64; 3]> = (0..PHASES).step_by(8).map(eight).collect();
    let at = |i: usize| half_side_m * (2.0 * i as f64 / (NODES - 1) as f64 - 1.0);
    let mean = |p: Vec2| {
        let push = |[sum_x, sum_y]: [SimdF64; 2], [x, y, spin]: &[SimdF64; 3]| {
            let [slip_x, slip_y] = [*x - *spin * p.y, *y + *spin * p.x];
            let inverse = 1.0 / (slip_x * slip_x + slip_y * slip_y + SPEED_SOFTENING * square).sqrt();
            [sum_x + slip_x * inverse, sum_y + slip_y * inverse]
        };
        let [x, y] = eights.iter().fold([SimdF64::ZERO; 2], push).map(SimdF64::reduce_add);
        Vec2::new(x, y) / PHASES as f64
    };
    (0..NODES * NODES).map(|i| mean(Vec2::new(at(i % NODES), at(i / NODES)))).collect()
}
