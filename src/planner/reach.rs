use super::Planner;
use crate::geometry::Vec2;

/// How well a library moves a part at one place.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Reach {
    /// Singular values of the flows of all entries there, larger first; an entry counts 1 where its belt
    /// is as good as the best measured, 0 where it moves nothing.
    pub singular_values: [f64; 2],
    /// Unit vector in which the best single entry does least.
    pub weakest_direction: Vec2,
    /// What the best single entry does along it, 0 to 1; 0: that direction cannot be reached.
    pub weakest_projection: f64,
}

/// Directions looked at over half a turn.
const DIRECTIONS: usize = 180;

impl Planner {
    /// How well the library moves a part at `position_m` in every direction, with its longest pulse.
    pub fn reach(&self, position_m: Vec2) -> Reach {
        let model = &self.library().displacement;
        let best_m = model.speed_mps.last().map_or(0.0, |&fastest| model.max_distance(fastest));
        let part = if best_m > 0.0 { 1.0 / best_m } else { 0.0 };
        let flow = |entry: &crate::library::Entry| {
            entry.pump.direction_at(position_m) * (model.max_distance(entry.speed_at(position_m)) * part)
        };
        let flows: Vec<Vec2> = self.library().entries.iter().map(flow).collect();
        let projection = |direction: Vec2| flows.iter().map(|f| f.dot(&direction).abs()).fold(0.0, f64::max);
        let directions = (0..DIRECTIONS).map(|k| {
            let (sin, cos) = (std::f64::consts::PI * k as f64 / DIRECTIONS as f64).sin_cos();
            Vec2::new(cos, sin)
        });
        let (weakest_projection, weakest_direction) = directions
            .map(|direction| (projection(direction), direction))
            .fold((f64::INFINITY, Vec2::x()), |weakest, next| if next.0 < weakest.0 { next } else { weakest });
        Reach { singular_values: singular_values(&flows), weakest_direction, weakest_projection }
    }
}

/// Of the 2 × M matrix of `flows`, from the eigenvalues of its 2 × 2 product with itself.
fn singular_values(flows: &[Vec2]) -> [f64; 2] {
    let (xx, xy, yy) =
        flows.iter().fold((0.0, 0.0, 0.0), |(xx, xy, yy), f| (xx + f.x * f.x, xy + f.x * f.y, yy + f.y * f.y));
    let (middle, spread) = (0.5 * (xx + yy), (0.5 * (xx - yy)).hypot(xy));
    [(middle + spread).sqrt(), (middle - spread).max(0.0).sqrt()]
}
