use super::path_follower::PlateScene;
use super::routes::PLANNED_GAP_M;
use upm_core::geometry::{Polyline, Vec2};

/// Step by which a free place is searched further away, m, and number of directions that are tried at each distance.
const STEP_M: f64 = 2e-3;
const DIRECTIONS: usize = 24;

/// First place of each part: where its line in `wanted` begins. A part without a line stays at its place in `seen_m`;
/// where that is in the way of parts that stray from their lines by up to `stray_m`, it takes the nearest place that is
/// not, if there is one.
pub(super) fn places_beside(
    scene: &PlateScene,
    wanted: &[Option<Polyline>],
    stray_m: f64,
    seen_m: &[Vec2],
) -> Vec<Vec2> {
    let radius_m = |part: usize| scene.discs.get(part).map_or(0.0, |disc| disc.radius_m);
    let line_of = |part: usize| wanted.get(part).and_then(Option::as_ref);
    let mut places_m: Vec<Option<Vec2>> = (0..seen_m.len()).map(|part| Some(line_of(part)?.at(0.0))).collect();
    // parts that are not in the way keep their places before others look for new ones
    for furthest in [0, (2.0 * scene.half_side_m / STEP_M) as usize] {
        for (part, &at_m) in seen_m.iter().enumerate().filter(|(part, _)| line_of(*part).is_none()) {
            let reach_m = scene.half_side_m - radius_m(part) - PLANNED_GAP_M;
            let is_clear = |&p_m: &Vec2| {
                (0..seen_m.len()).filter(|&other| other != part).all(|other| {
                    let away_m = match (line_of(other), places_m[other]) {
                        (Some(line), _) => line.nearest(p_m, 0.0, line.length_m()).1 - stray_m,
                        (None, Some(other_m)) if furthest > 0 => (p_m - other_m).norm(),
                        (None, _) => f64::INFINITY,
                    };
                    away_m >= radius_m(part) + radius_m(other) + PLANNED_GAP_M
                }) && (p_m == at_m || p_m.amax() <= reach_m)
            };
            if places_m[part].is_none() {
                places_m[part] = around(at_m, furthest).find(is_clear);
            }
        }
    }
    places_m.iter().zip(seen_m).map(|(place_m, seen_m)| place_m.unwrap_or(*seen_m)).collect()
}

/// `at_m`, and places round it, the nearest first.
fn around(at_m: Vec2, furthest: usize) -> impl Iterator<Item = Vec2> {
    let ring = move |distance: usize| {
        (0..DIRECTIONS).map(move |k| {
            let (sin, cos) = libm::sincos(std::f64::consts::TAU * k as f64 / DIRECTIONS as f64);
            at_m + STEP_M * distance as f64 * Vec2::new(cos, sin)
        })
    };
    std::iter::once(at_m).chain((1..=furthest).flat_map(ring))
}
