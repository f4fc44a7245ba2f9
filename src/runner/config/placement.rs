use rand_distr::{Distribution, StandardNormal, Uniform};

use super::clearance::{START_GAP_M, START_MARGIN_M};
use super::job::JobSpec;
use super::kinds::{PartGroup, part_ids};
use upm_core::document::{Diagnostic, Path, counted};
use upm_core::geometry::Vec2;
use upm_core::random::{Rng, Streams};
use upm_sim::PartParams;

/// Attempts to place one part before starting over.
const TRIES: usize = 2000;

/// Attempts to place all parts.
const ROUNDS: usize = 50;

/// Least and largest friction drawn, whatever the spread.
const FRICTION_RANGE: (f64, f64) = (0.01, 2.0);

/// A part with its start position.
#[derive(Clone, Debug, PartialEq)]
pub struct PlacedPart {
    /// Index into the rig's kinds.
    pub kind: usize,
    /// Kind and number within it: `penny-1`.
    pub id: String,
    /// Start position of its centre, m.
    pub position_m: Vec2,
    /// Outline, mass and the friction drawn for it.
    pub params: PartParams,
}

/// Places the job's parts on the plate, in the order of the job: given positions as they are, the others at random,
/// with rims [`START_GAP_M`] apart and [`START_MARGIN_M`] inside the edge. Draws each part's friction from `streams`.
/// `Err` if no places are found.
pub fn place_parts(job: &JobSpec, streams: Streams) -> Result<Vec<PlacedPart>, Diagnostic> {
    let parts = unplaced(job, streams);
    let mut rng = Streams::new(job.placement_seed()).stream("placement");
    let half_m = 0.5 * job.rig.model.plate_side_m;
    if let Some(places_m) = (0..ROUNDS).find_map(|_| scatter(&parts, half_m, &mut rng)) {
        let placed = parts.into_iter().zip(places_m);
        return Ok(placed.map(|((part, _), position_m)| PlacedPart { position_m, ..part }).collect());
    }
    let found = format!("{}, not all placed in {ROUNDS} rounds of {TRIES} tries each", counted(parts.len(), "part"));
    Err(Diagnostic::new(&job.file, Path::root().key("parts"), found, "fewer or smaller parts, or given positions"))
}

/// Each part, and its given position if it has one.
fn unplaced(job: &JobSpec, streams: Streams) -> Vec<(PlacedPart, Option<Vec2>)> {
    let groups = job.parts.iter().flat_map(|group| std::iter::repeat_n(group, group.count));
    let part = |(i, (group, id)): (u64, (&PartGroup, String))| {
        let spec = job.rig.kinds.get(group.kind)?;
        // normal about the kind's, truncated at three standard deviations
        let normal: f64 = StandardNormal.sample(&mut streams.numbered("part friction", i));
        let share = 1.0 + job.rig.document.friction.spread * normal.clamp(-3.0, 3.0);
        let friction = (spec.friction * share).clamp(FRICTION_RANGE.0, FRICTION_RANGE.1);
        let params = PartParams { friction, ..spec.part() };
        let position_m = group.position_m.unwrap_or_default();
        Some((PlacedPart { kind: group.kind, id, position_m, params }, group.position_m))
    };
    (0..).zip(groups.zip(part_ids(&job.parts, &job.rig.kinds))).filter_map(part).collect()
}

/// One attempt: random positions one after another; `None` if a part finds no place.
fn scatter(parts: &[(PlacedPart, Option<Vec2>)], half_m: f64, rng: &mut Rng) -> Option<Vec<Vec2>> {
    let mut places_m: Vec<Option<Vec2>> = parts.iter().map(|(_, given_m)| *given_m).collect();
    for i in 0..parts.len() {
        if places_m[i].is_none() {
            let others = places_m.iter().zip(parts);
            let others = others.filter_map(|(place_m, (other, _))| Some(((*place_m)?, other.params.radius_m)));
            places_m[i] = Some(free_place(parts[i].0.params.radius_m, others, half_m, rng)?);
        }
    }
    places_m.into_iter().collect()
}

/// A random place for a disc, its rim [`START_MARGIN_M`] inside the edge and [`START_GAP_M`] from those of the `others`
/// (centre and radius, m); `None` where none is found.
pub(crate) fn free_place(
    radius_m: f64,
    others: impl Iterator<Item = (Vec2, f64)> + Clone,
    half_m: f64,
    rng: &mut Rng,
) -> Option<Vec2> {
    let reach_m = half_m - START_MARGIN_M - radius_m;
    let side = Uniform::new_inclusive(-reach_m, reach_m).ok()?;
    let free = |p_m: &Vec2| {
        others
            .clone()
            .all(|(other_m, other_radius_m)| (p_m - other_m).norm() >= radius_m + other_radius_m + START_GAP_M)
    };
    (0..TRIES).map(|_| Vec2::new(side.sample(rng), side.sample(rng))).find(free)
}
