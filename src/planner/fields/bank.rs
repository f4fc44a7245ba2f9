//! Motions to start from: a few hundred random ones, each with its mean friction over the plate as a table.
//!
//! A plate that is turned by a quarter or seen in a mirror gives as many more motions with the same tables, and each
//! motion run the other way pushes the other way. Among these thousands the best for the present parts is looked up.

use crate::geometry::Vec2;
use crate::random::Streams;

use super::waves::Waves;

/// Motions with a table of their own.
const MOTIONS: usize = 192;
/// Nodes of a table along a side of the plate.
const NODES: usize = 17;
/// Phases of a period that a mean is taken over.
const PHASES: usize = 96;
/// Speed under which friction is not at its full, as a part of the motion's, squared: mean fields are asked of parts at rest.
const SOFT: f64 = 1e-4;
/// Price of what goes astray against what goes right.
const ASTRAY: f64 = 0.3;

/// One of the eight ways to lay a square on itself.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Symmetry {
    quarters: usize,
    mirrored: bool,
}

impl Symmetry {
    const COUNT: usize = 8;

    fn number(i: usize) -> Self {
        Self { quarters: i % 4, mirrored: i >= 4 }
    }

    /// Mirrored (x changes its sign), then turned.
    fn onto(self, v: Vec2) -> Vec2 {
        let v = if self.mirrored { Vec2::new(-v.x, v.y) } else { v };
        (0..self.quarters).fold(v, |v, _| Vec2::new(-v.y, v.x))
    }

    fn back(self, v: Vec2) -> Vec2 {
        let v = (0..self.quarters).fold(v, |v, _| Vec2::new(v.y, -v.x));
        if self.mirrored { Vec2::new(-v.x, v.y) } else { v }
    }
}

/// Random motions and what they do to parts at rest.
#[derive(Clone, Debug)]
pub(super) struct Bank {
    half_side_m: f64,
    motions: Vec<Vec<f64>>,
    /// `fields[motion][row * NODES + column]`: mean of the slip's direction.
    fields: Vec<Vec<Vec2>>,
}

impl Bank {
    /// The same motions for the same harmonics, always.
    pub fn new(waves: &Waves, half_side_m: f64) -> Self {
        let mut rng = Streams::new(0).stream("field bank");
        let mut draw = || {
            use rand::RngExt as _;
            rng.random_range(-1.0..1.0)
        };
        let mut random = || (0..waves.len()).map(|j| draw() / waves.harmonic_of(j) as f64).collect::<Vec<f64>>();
        let motions: Vec<Vec<f64>> = (0..MOTIONS).map(|_| random()).collect();
        let fields = motions.iter().map(|motion| table(waves, motion, half_side_m)).collect();
        Self { half_side_m, motions, fields }
    }

    /// The `count` motions that promise most of `steps_m` of parts at `positions_m`, best first.
    pub fn best(&self, waves: &Waves, positions_m: &[Vec2], steps_m: &[Vec2], count: usize) -> Vec<Vec<f64>> {
        let length = steps_m.iter().map(|s| s.norm_squared()).sum::<f64>().sqrt();
        let mut scores = Vec::with_capacity(MOTIONS * Symmetry::COUNT);
        for symmetry in (0..Symmetry::COUNT).map(Symmetry::number) {
            let turned: Vec<(usize, Vec2, Vec2)> = positions_m
                .iter()
                .zip(steps_m)
                .map(|(&p, &s)| {
                    let (node, place) = self.node(symmetry.back(p));
                    (node, place, symmetry.back(s) / length)
                })
                .collect();
            for (motion, field) in self.fields.iter().enumerate() {
                let (mut along, mut square) = (0.0, 0.0);
                for &(node, place, step) in &turned {
                    let push = bilinear(field, node, place);
                    along += push.dot(&step);
                    square += push.norm_squared();
                }
                let astray = (square - along * along).max(0.0).sqrt();
                scores.push((along.abs() - ASTRAY * astray, motion, symmetry, along < 0.0));
            }
        }
        let count = count.min(scores.len());
        if count == 0 {
            return Vec::new();
        }
        scores.select_nth_unstable_by(count - 1, |a, b| b.0.total_cmp(&a.0).then(a.1.cmp(&b.1)));
        scores.truncate(count);
        scores.sort_by(|a, b| b.0.total_cmp(&a.0).then(a.1.cmp(&b.1)));
        scores.into_iter().map(|(_, motion, symmetry, reverse)| self.laid(waves, motion, symmetry, reverse)).collect()
    }

    /// Motion number `motion` on the plate laid by `symmetry`.
    fn laid(&self, waves: &Waves, motion: usize, symmetry: Symmetry, reverse: bool) -> Vec<f64> {
        let n = waves.per_axis();
        let mut laid = self.motions[motion].clone();
        let sign = if reverse { -1.0 } else { 1.0 };
        for j in 0..n {
            let along = symmetry.onto(Vec2::new(laid[j], laid[n + j])) * sign;
            (laid[j], laid[n + j]) = (along.x, along.y);
            laid[2 * n + j] *= if symmetry.mirrored { -sign } else { sign };
        }
        laid
    }

    /// The table's cell at `p_m`: its first node and the place in it, 0 to 1 each way.
    fn node(&self, p_m: Vec2) -> (usize, Vec2) {
        let cells = (NODES - 1) as f64;
        let along = (p_m / (2.0 * self.half_side_m)).map(|v| (v + 0.5).clamp(0.0, 1.0) * cells);
        let cell = along.map(|v| v.floor().min(cells - 1.0));
        (cell.y as usize * NODES + cell.x as usize, along - cell)
    }
}

fn bilinear(field: &[Vec2], node: usize, place: Vec2) -> Vec2 {
    let row = |node: usize| field[node] * (1.0 - place.x) + field[node + 1] * place.x;
    row(node) * (1.0 - place.y) + row(node + NODES) * place.y
}

fn table(waves: &Waves, motion: &[f64], half_side_m: f64) -> Vec<Vec2> {
    let samples = waves.motion(motion);
    let every: Vec<[f64; 3]> = (0..PHASES).map(|i| samples[i * samples.len() / PHASES]).collect();
    let square = every.iter().map(|[x, y, _]| x * x + y * y).sum::<f64>() / PHASES as f64;
    let at = |i: usize| half_side_m * (2.0 * i as f64 / (NODES - 1) as f64 - 1.0);
    let mean = |p: Vec2| {
        let push = |[x, y, spin]: &[f64; 3]| {
            let slip = Vec2::new(x - spin * p.y, y + spin * p.x);
            slip / (slip.norm_squared() + SOFT * square).sqrt()
        };
        every.iter().map(push).sum::<Vec2>() / PHASES as f64
    };
    (0..NODES * NODES).map(|i| mean(Vec2::new(at(i % NODES), at(i / NODES)))).collect()
}
