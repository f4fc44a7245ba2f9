use crate::cor_library::{Entry, Library, flow_eigenvalues};
use upm_core::geometry::Vec2;

/// Reach of a library at one position.
#[derive(Clone, Debug, PartialEq)]
pub struct Reach {
    /// Singular values of the flows of all entries there, larger first; an entry counts 1 where its belt is as good as
    /// the best measured, 0 where it moves nothing.
    pub singular_values: [f64; 2],
    /// Direction in which the best single entry does least, a unit vector.
    pub weakest_direction: Vec2,
    /// Displacement along it by the best single entry, relative to the best belt, 0 to 1; 0: that direction cannot be
    /// reached.
    pub weakest_projection: f64,
    /// Displacement along it by the longest pulse of that entry, m.
    pub longest_step_m: f64,
    /// Standard deviation of such a step, m.
    pub longest_sd_m: f64,
    /// Smallest displacement along it by the shortest pulse at full amplitude of a suitable entry, m: one that flows
    /// within 30 degrees of it and makes at least a twentieth of the longest step there. `None` when there is no such
    /// entry.
    pub shortest_step_m: Option<f64>,
    /// Indices of the entries that do most along some direction, rising.
    pub strongest: Vec<usize>,
}

/// Directions sampled over half a turn.
const DIRECTIONS: usize = 180;

/// Cosine of the largest angle between a direction and the flow of an entry that serves it.
const ALONG: f64 = 0.866;

/// Least fraction of the longest step for an entry that serves short steps; one below it turns a part or leaves it at
/// rest.
const GENTLE: f64 = 0.05;

impl Reach {
    /// Reach of `library` at `position_m` in every direction, with its longest pulse.
    pub fn of(library: &Library, position_m: Vec2) -> Self {
        let Library { displacement: model, entries, .. } = library;
        let best_m = model.farthest();
        let part = if best_m > 0.0 { 1.0 / best_m } else { 0.0 };
        let flow = |entry: &Entry| {
            entry.pump.direction_at(position_m) * (model.max_distance(entry.speed_at(position_m)) * part)
        };
        let flows: Vec<Vec2> = entries.iter().map(flow).collect();
        let mut strongest = Vec::new();
        let (mut weakest_projection, mut weakest_direction, mut weakest_entry) = (f64::INFINITY, Vec2::x(), None);
        for k in 0..DIRECTIONS {
            let (sin, cos) = libm::sincos(std::f64::consts::PI * k as f64 / DIRECTIONS as f64);
            let direction = Vec2::new(cos, sin);
            let (projection, entry) = strongest_along(&flows, direction);
            strongest.extend(entry);
            if projection < weakest_projection {
                (weakest_projection, weakest_direction, weakest_entry) = (projection, direction, entry);
            }
        }
        strongest.sort_unstable();
        strongest.dedup();
        let longest_step_m = weakest_projection * best_m;
        let longest_sd_m = weakest_entry.map_or(0.0, |entry| {
            let (speed, longest_s) = (entries[entry].speed_at(position_m), model.sustain_s.last().copied());
            let along = entries[entry].pump.direction_at(position_m).dot(&weakest_direction).abs();
            model.sd(speed, longest_s.unwrap_or(0.0)) * along
        });
        Self {
            singular_values: flow_eigenvalues(flows.iter().copied()).map(|value| value.max(0.0).sqrt()),
            weakest_direction,
            weakest_projection,
            longest_step_m,
            longest_sd_m,
            shortest_step_m: shortest_step(library, position_m, weakest_direction, GENTLE * longest_step_m),
            strongest,
        }
    }
}

/// The largest displacement along `direction` by one of `flows`, and its index; `None` when all are zero.
fn strongest_along(flows: &[Vec2], direction: Vec2) -> (f64, Option<usize>) {
    flows.iter().map(|flow| flow.dot(&direction).abs()).enumerate().fold((0.0, None), |best, (entry, projection)| {
        if projection > best.0 { (projection, Some(entry)) } else { best }
    })
}

/// The smallest displacement along `direction` by an entry that serves it, of those whose longest is positive and at
/// least `least_m`, m.
fn shortest_step(library: &Library, position_m: Vec2, direction: Vec2, least_m: f64) -> Option<f64> {
    let model = &library.displacement;
    let shortest = |entry: &Entry| {
        let along = entry.pump.direction_at(position_m).dot(&direction).abs();
        let speed_mps = entry.speed_at(position_m);
        let longest_m = along * model.max_distance(speed_mps);
        let suits = along >= ALONG && longest_m > 0.0 && longest_m >= least_m;
        suits.then(|| along * model.min_distance(speed_mps))
    };
    library.entries.iter().filter_map(shortest).reduce(f64::min)
}
