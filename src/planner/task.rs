use super::limits::{Clearances, HalfSpace, half_spaces};
use super::sequence::Sequence;
use super::{Limit, PartState, PlannerParams};
use upm_core::geometry::Vec2;

/// Part of the largest step that the linear separations keep on top, for what they leave out.
const TIGHTER: f64 = 0.05;

/// What is wanted and within which limits.
pub(super) struct Task<'a> {
    /// The parts.
    pub parts: &'a [PartState],
    /// Where they are, m.
    pub positions_m: Vec<Vec2>,
    /// Wanted steps x, y of each part, m.
    pub wanted_m: Vec<f64>,
    /// Linear limits on the steps.
    pub half_spaces: Vec<HalfSpace>,
    /// Limits that hold all the way.
    pub clearances: Clearances,
    /// Largest wanted step, m.
    pub largest_m: f64,
}

impl<'a> Task<'a> {
    /// `None` when a number is not finite.
    pub fn of(parts: &'a [PartState], params: &PlannerParams) -> Option<Self> {
        let positions_m: Vec<Vec2> = parts.iter().map(|part| part.position_m).collect();
        let wanted_m: Vec<f64> = parts.iter().flat_map(|part| [part.step_m.x, part.step_m.y]).collect();
        let finite = |p: &PartState| {
            [p.position_m.x, p.position_m.y, p.step_m.x, p.step_m.y, p.radius_m, p.gain].iter().all(|v| v.is_finite())
        };
        let largest_m = parts.iter().map(|part| part.step_m.norm()).fold(0.0, f64::max);
        let half_spaces = half_spaces(parts, params, largest_m + params.separation_m, TIGHTER * largest_m);
        let clearances = Clearances::of(parts, params);
        parts.iter().all(finite).then_some(Self { parts, positions_m, wanted_m, half_spaces, clearances, largest_m })
    }

    /// The same task with all steps shortened by one factor until none is longer than `longest_m`.
    pub fn within(self, longest_m: f64, params: &PlannerParams) -> Self {
        if self.largest_m <= longest_m {
            return self;
        }
        let part = longest_m / self.largest_m;
        let half_spaces = half_spaces(self.parts, params, longest_m + params.separation_m, TIGHTER * longest_m);
        let wanted_m = self.wanted_m.iter().map(|wanted_m| part * wanted_m).collect();
        Self { wanted_m, half_spaces, largest_m: longest_m, ..self }
    }

    /// The same parts, told to go away from `limit` by `room_m` and otherwise to stay.
    pub fn making_room(&self, limit: Limit, room_m: f64) -> Self {
        let mut wanted_m = vec![0.0; self.wanted_m.len()];
        let mut go = |part: usize, direction: Vec2| {
            let step = direction.try_normalize(0.0).unwrap_or_else(Vec2::zeros) * room_m;
            wanted_m[2 * part] = step.x;
            wanted_m[2 * part + 1] = step.y;
        };
        match limit {
            Limit::Edge { part } => {
                let p = self.positions_m[part];
                go(part, if p.x.abs() > p.y.abs() { Vec2::new(-p.x, 0.0) } else { Vec2::new(0.0, -p.y) });
            }
            Limit::Separation { parts: [a, b] } => {
                let apart = self.positions_m[b] - self.positions_m[a];
                go(a, -apart);
                go(b, apart);
            }
            Limit::Unreachable => {}
        }
        Self {
            wanted_m,
            largest_m: room_m,
            positions_m: self.positions_m.clone(),
            half_spaces: self.half_spaces.clone(),
            clearances: self.clearances.clone(),
            parts: self.parts,
        }
    }

    /// The part of the wanted steps that is left undone after `sequence`.
    pub fn left_by(&self, sequence: &Sequence) -> f64 {
        self.error_m(&self.wanted_m, sequence.predicted_m.last()) / self.error_m(&self.wanted_m, None)
    }

    /// Root of the sum of squared differences between `wanted` steps and those to `positions_m` (none: no step), m.
    pub fn error_m(&self, wanted: &[f64], positions_m: Option<&Vec<Vec2>>) -> f64 {
        let steps = self.steps_to(positions_m.unwrap_or(&self.positions_m));
        wanted.iter().zip(steps).map(|(w, s)| (w - s) * (w - s)).sum::<f64>().sqrt()
    }

    /// Steps x, y of each part from where it is to `positions_m`.
    pub fn steps_to(&self, positions_m: &[Vec2]) -> Vec<f64> {
        self.positions_m.iter().zip(positions_m).flat_map(|(a, b)| [b.x - a.x, b.y - a.y]).collect()
    }
}
