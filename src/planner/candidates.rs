//! Which few of the library's hundreds of motions are worth putting into the program.

use super::PartState;
use super::field::{Belt, Columns, dot, push_column, reference_speed};
use upm_core::geometry::Vec2;
use upm_library::{Entry, Library};

/// A centre of rotation this near a part, in radii, spins it more than it moves it: nothing to plan with.
const NEAR_RADII: f64 = 0.8;

/// A typical pulse of a sequence, as a part of the largest step.
const TYPICAL: f64 = 0.7;

/// An entry that takes this many times longer than the quickest for a typical pulse is left out.
const SLOW: f64 = 2.0;

/// Belts of at least this speed are fast, m/s.
const FAST_MPS: f64 = 0.15;

/// Which entries a survey is about.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Belts {
    /// Those that move the plate fast under some part. What a slow belt does hangs on each part's own friction, for some
    /// are carried on it and some stick; a short step is two longer pulses instead.
    Fast,
    /// Those whose strength suits the steps.
    InGear,
}

/// Cosine from which on two columns are one choice, not two.
const ALIKE: f64 = 0.99;

/// Below this part of its length a column adds no new direction.
const DEPENDENT: f64 = 0.05;

/// Columns of every entry at `sustain_s`; zeros for those that cannot be used with parts where these are, or that
/// are the wrong gear for steps of up to `largest_m`: too strong for so short a step, or much slower than others.
pub(super) fn survey(
    columns: &mut Columns,
    library: &Library,
    parts: &[PartState],
    sustain_s: f64,
    largest_m: f64,
    belts: Belts,
) {
    let belt = Belt::at(&library.displacement, sustain_s);
    let positions = parts.iter().map(|part| part.position_m);
    let in_gear = match belts {
        Belts::Fast => fast(library, positions.clone()),
        Belts::InGear => gears(library, positions.clone(), largest_m),
    };
    columns.clear(2 * parts.len());
    for (entry, in_gear) in library.entries.iter().zip(in_gear) {
        if !in_gear || parts.iter().any(|part| turns_on_the_spot(entry, part)) {
            columns.push(std::iter::repeat_n(0.0, 2 * parts.len()));
        } else {
            push_column(columns, entry, parts, positions.clone(), |speed| belt.distance(speed));
        }
    }
}

/// For each entry whether it is fast; all are where none is.
fn fast(library: &Library, positions_m: impl Iterator<Item = Vec2> + Clone) -> Vec<bool> {
    let speeds = library.entries.iter().map(|entry| reference_speed(entry, positions_m.clone()));
    let fast: Vec<bool> = speeds.map(|speed_mps| speed_mps >= FAST_MPS).collect();
    if fast.contains(&true) { fast } else { vec![true; fast.len()] }
}

/// For each entry whether its strength suits steps of up to `largest_m`. Where nothing is gentle enough, all do.
fn gears(library: &Library, positions_m: impl Iterator<Item = Vec2> + Clone, largest_m: f64) -> Vec<bool> {
    let model = &library.displacement;
    let longest_s = model.sustain_s.last().copied().unwrap_or(0.0);
    let duration = |entry: &Entry| {
        let speed = reference_speed(entry, positions_m.clone());
        let shortest_m = model.min_distance(speed);
        if shortest_m > largest_m {
            return None;
        }
        let sustain_s = model.sustain_for(speed, shortest_m.max(TYPICAL * largest_m)).unwrap_or(longest_s);
        Some(sustain_s + 2.0 * library.attack_s + library.rest_after(sustain_s))
    };
    let durations: Vec<Option<f64>> = library.entries.iter().map(duration).collect();
    let quickest = durations.iter().flatten().copied().fold(f64::INFINITY, f64::min);
    if quickest.is_infinite() {
        return vec![true; durations.len()];
    }
    durations.iter().map(|duration| duration.is_some_and(|duration| duration <= SLOW * quickest)).collect()
}

fn turns_on_the_spot(entry: &Entry, part: &PartState) -> bool {
    let across_rim = entry.pump.spin_radps * NEAR_RADII * part.radius_m;
    entry.pump.velocity_at(part.position_m).norm_squared() < across_rim * across_rim
}

/// About `count` columns to start with: first a set that spans every direction the parts can be moved in, the
/// most useful for `wanted` first, then those that are most useful alone.
///
/// The first set is orthogonal matching pursuit: the column with the largest projection on what is still missing, then
/// everything made orthogonal to it. Once nothing is missing the longest remainder goes next, which is QR with column
/// pivoting.
pub(super) fn starting_set(columns: &Columns, wanted: &[f64], count: usize) -> Vec<usize> {
    let mut chosen = spanning_set(columns, wanted);
    add_best(columns, &mut chosen, wanted, 0.0, count);
    chosen
}

/// Adds columns to `chosen` until there are `count`: those whose projection on `prices` exceeds `cost`, best first, and
/// no two that point nearly the same way, as the neighbours of a good centre do.
pub(super) fn add_best(columns: &Columns, chosen: &mut Vec<usize>, prices: &[f64], cost: f64, count: usize) {
    let mut worth: Vec<(f64, usize)> =
        (0..columns.len()).map(|j| (columns.dot(j, prices).abs(), j)).filter(|&(worth, _)| worth > cost).collect();
    worth.sort_by(|a, b| b.0.total_cmp(&a.0).then(a.1.cmp(&b.1)));
    let first_new = chosen.len();
    for (_, j) in worth {
        if chosen.len() >= count {
            break;
        }
        if !chosen.contains(&j) && !chosen[first_new..].iter().any(|&k| alike(columns, j, k)) {
            chosen.push(j);
        }
    }
}

fn alike(columns: &Columns, j: usize, k: usize) -> bool {
    let square = |j: usize| columns.dot(j, columns.column(j));
    columns.dot(j, columns.column(k)).powi(2) > ALIKE * ALIKE * square(j) * square(k)
}

fn spanning_set(columns: &Columns, wanted: &[f64]) -> Vec<usize> {
    let mut missing = wanted.to_vec();
    let mut basis: Vec<Vec<f64>> = Vec::with_capacity(wanted.len());
    let mut remainder_sq: Vec<f64> = (0..columns.len()).map(|j| columns.dot(j, columns.column(j))).collect();
    let least: Vec<f64> = remainder_sq.iter().map(|length_sq| DEPENDENT * DEPENDENT * length_sq).collect();
    let mut chosen = Vec::with_capacity(wanted.len());
    let found = DEPENDENT * DEPENDENT * dot(wanted, wanted);
    while chosen.len() < wanted.len() {
        let pursuing = dot(&missing, &missing) > found;
        let worth = |j: usize| if pursuing { columns.dot(j, &missing).abs() } else { remainder_sq[j] };
        let best = (0..columns.len()).filter(|&j| remainder_sq[j] > least[j]).map(|j| (worth(j), j)).fold(
            None,
            |best: Option<(f64, usize)>, next| if best.is_some_and(|b| b.0 >= next.0) { best } else { Some(next) },
        );
        let Some((_, j)) = best else { break };
        let direction = orthogonal(columns.column(j), &basis);
        let along = dot(&direction, &missing);
        missing.iter_mut().zip(&direction).for_each(|(m, d)| *m -= along * d);
        for (k, remainder) in remainder_sq.iter_mut().enumerate() {
            *remainder -= columns.dot(k, &direction).powi(2);
        }
        remainder_sq[j] = 0.0;
        chosen.push(j);
        basis.push(direction);
    }
    chosen
}

/// The unit vector along what of `column` is orthogonal to `basis`.
fn orthogonal(column: &[f64], basis: &[Vec<f64>]) -> Vec<f64> {
    let mut rest = column.to_vec();
    for direction in basis {
        let along = dot(direction, &rest);
        rest.iter_mut().zip(direction).for_each(|(r, d)| *r -= along * d);
    }
    let length = dot(&rest, &rest).sqrt();
    if length > 0.0 {
        rest.iter_mut().for_each(|r| *r /= length);
    }
    rest
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fixture::{library, penny};
    use upm_core::geometry::Vec2;

    fn four() -> [PartState; 4] {
        let step = |x: f64, y: f64| Vec2::new(x, y) * 1e-3;
        [
            penny(Vec2::new(0.03, 0.04), step(4.0, 0.0)),
            penny(Vec2::new(-0.05, 0.01), step(0.0, -3.0)),
            penny(Vec2::new(0.02, -0.06), step(-2.0, 2.0)),
            penny(Vec2::new(-0.03, -0.02), step(1.0, 1.0)),
        ]
    }

    fn wanted(parts: &[PartState]) -> Vec<f64> {
        parts.iter().flat_map(|p| [p.step_m.x, p.step_m.y]).collect()
    }

    #[test]
    fn the_first_columns_span_every_direction() {
        let parts = four();
        let mut columns = Columns::default();
        survey(&mut columns, &library(), &parts, 0.08, 5e-3, Belts::InGear);
        let chosen = starting_set(&columns, &wanted(&parts), 16);
        assert_eq!(chosen.len(), 16);
        let matrix = nalgebra::DMatrix::from_fn(8, 8, |row, j| columns.column(chosen[j])[row]);
        let singular = matrix.singular_values();
        assert!(singular[7] > 0.1, "{singular}");
        let mut sorted = chosen.clone();
        sorted.sort_unstable();
        sorted.dedup();
        assert_eq!(sorted.len(), chosen.len(), "no column twice");
    }

    #[test]
    fn centers_under_a_part_are_left_out() {
        let parts = [penny(Vec2::new(0.0, 0.003), Vec2::new(1e-3, 0.0))];
        let mut columns = Columns::default();
        survey(&mut columns, &library(), &parts, 0.08, 5e-3, Belts::InGear);
        assert_eq!(columns.len(), library().entries.len());
        assert_eq!(columns.column(8 * 17 + 8), [0.0, 0.0], "the centre of the plate is 3 mm away");
        assert!(dot(columns.column(0), columns.column(0)) > 0.9);
    }

    #[test]
    fn a_column_is_what_was_measured() {
        let (parts, library, sustain_s) = (four(), library(), 0.08);
        let mut columns = Columns::default();
        survey(&mut columns, &library, &parts, sustain_s, 5e-3, Belts::InGear);
        for entry in [0, 100, 290] {
            let moved: Vec<Vec2> =
                parts.iter().map(|p| library.displacement_at(entry, p.position_m, sustain_s)).collect();
            let farthest = moved.iter().map(Vec2::norm).fold(0.0, f64::max);
            for (i, step) in moved.iter().enumerate() {
                let flow = Vec2::new(columns.column(entry)[2 * i], columns.column(entry)[2 * i + 1]);
                assert!((flow * farthest - step).norm() < 1e-9);
            }
        }
    }
}
