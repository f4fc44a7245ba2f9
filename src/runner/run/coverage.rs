//! Coverage of a COR library: how well it moves a part at each place of the plate, and the positions of its centres.

use upm_core::geometry::{Vec2, nearest_distance_squared};
use upm_planning::cor_library::Library;
use upm_planning::planner::Reach;

#[cfg(test)]
pub(super) mod fixture;
#[cfg(test)]
mod tests;

/// Sampled places along each side of the plate; odd, so that one is the plate's centre.
const PLACES: usize = 21;

/// Grid steps along each side in the search for the largest gap.
const GAP_STEPS: usize = 200;

/// Distance of a centre, in sides of the plate, beyond which the entry counts as a translation: the flow turns by less
/// than 6 degrees over the plate.
const FAR_SIDES: f64 = 10.0;

/// Difference of longest steps below which a plate counts as even, m: one unit of the last digit of the report.
const EVEN_M: f64 = 1e-5;

/// Coverage of a plate by a COR library.
#[derive(Clone, Debug, PartialEq)]
pub struct Coverage {
    /// Half the plate's side, m.
    pub half_side_m: f64,
    /// Places at the middles of equal squares that fill the plate, row by row from the top, each from the left.
    pub places: Vec<PlaceReach>,
    /// Number of places in a row, equal to the number of rows.
    pub columns: usize,
    /// Centres of rotation of all entries that are not translations, m.
    pub centers_m: Vec<Vec2>,
    /// Number of centres on the plate.
    pub inside: usize,
    /// Number of centres outside the plate.
    pub outside: usize,
    /// Number of entries that move the whole plate in nearly one direction.
    pub translations: usize,
    /// Place on the plate farthest from all centres; `None` without centres.
    pub gap: Option<CoverageHole>,
    /// Indices of entries that are not the strongest at any place in any direction.
    pub never_strongest: Vec<usize>,
    /// Longest measured step, m.
    pub best_step_m: f64,
}

/// Effect of single pulses on a part at one place.
#[derive(Clone, Debug, PartialEq)]
pub struct PlaceReach {
    /// Place of the part, m from the plate's centre.
    pub position_m: Vec2,
    /// Reach of the library there.
    pub reach: Reach,
}

/// A place far from every centre.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CoverageHole {
    /// Position, m, to a two-hundredth of the plate's side.
    pub position_m: Vec2,
    /// Distance to the nearest centre, m.
    pub distance_m: f64,
}

impl PlaceReach {
    /// Share of the longest measured step below which a direction counts as unreachable.
    pub const LEAST_SHARE: f64 = 0.1;

    /// The place at `position_m`.
    pub(super) fn of(library: &Library, position_m: Vec2) -> Self {
        Self { position_m, reach: Reach::of(library, position_m) }
    }

    /// True if a part can be moved in every direction.
    pub fn is_reached(&self) -> bool {
        self.reach.weakest_projection >= Self::LEAST_SHARE
    }
}

impl Coverage {
    /// Coverage of the plate that `library` was measured on.
    pub fn of(library: &Library) -> Self {
        let half_side_m = 0.5 * library.plate_side_m;
        let model = &library.displacement;
        let places: Vec<_> = grid(half_side_m).map(|position_m| PlaceReach::of(library, position_m)).collect();
        let is_strongest = |entry: &usize| places.iter().any(|place| place.reach.strongest.contains(entry));
        let far_m = FAR_SIDES * 2.0 * half_side_m;
        let centers = library.entries.iter().filter_map(|entry| entry.center_m());
        let centers_m: Vec<Vec2> = centers.filter(|center| center.norm() <= far_m).collect();
        let inside = centers_m.iter().filter(|center| center.amax() <= half_side_m).count();
        Self {
            half_side_m,
            columns: PLACES,
            inside,
            outside: centers_m.len() - inside,
            translations: library.entries.len() - centers_m.len(),
            gap: largest_gap(&centers_m, half_side_m),
            centers_m,
            never_strongest: (0..library.entries.len()).filter(|entry| !is_strongest(entry)).collect(),
            places,
            best_step_m: model.speed_mps.last().map_or(0.0, |&fastest| model.max_distance(fastest)),
        }
    }

    /// Place whose longest step along its weakest direction is shortest.
    pub fn weakest(&self) -> Option<&PlaceReach> {
        self.places.iter().min_by(|a, b| a.reach.longest_step_m.total_cmp(&b.reach.longest_step_m))
    }

    /// Least and largest of the longest steps along the weakest direction, m, over all places that are reached; `None`
    /// if none is.
    pub fn steps_m(&self) -> Option<[f64; 2]> {
        let steps = || self.places.iter().filter(|place| place.is_reached()).map(|place| place.reach.longest_step_m);
        let least_m = steps().min_by(f64::total_cmp)?;
        Some([least_m, steps().fold(least_m, f64::max)])
    }

    /// True if the longest steps along the weakest direction differ by less than 0.01 mm wherever every direction is
    /// reached; false where none is reached.
    pub fn is_even(&self) -> bool {
        self.steps_m().is_some_and(|[least_m, most_m]| most_m - least_m < EVEN_M)
    }

    /// Longest step at each place on the scale of [`Coverage::steps_m`], 0 to 1; the middle on an even plate, and 0
    /// where a direction is out of reach.
    pub fn shades(&self) -> Vec<f64> {
        let (steps_m, is_even) = (self.steps_m(), self.is_even());
        let shade = |place: &PlaceReach| match steps_m {
            Some(_) if is_even => 0.5,
            Some([least_m, most_m]) => (place.reach.longest_step_m - least_m) / (most_m - least_m),
            None => 0.0,
        };
        self.places.iter().map(|place| if place.is_reached() { shade(place) } else { 0.0 }).collect()
    }

    /// Share of the places at which some direction is unreachable, 0 to 1.
    pub fn unreached_share(&self) -> f64 {
        self.places.iter().filter(|place| !place.is_reached()).count() as f64 / self.places.len().max(1) as f64
    }
}

/// Middles of equal squares that fill the plate, row by row from the top.
fn grid(half_side_m: f64) -> impl Iterator<Item = Vec2> {
    let at = move |k: usize| half_side_m * ((2 * k + 1) as f64 / PLACES as f64 - 1.0);
    (0..PLACES).flat_map(move |row| (0..PLACES).map(move |column| Vec2::new(at(column), -at(row))))
}

fn largest_gap(centers_m: &[Vec2], half_side_m: f64) -> Option<CoverageHole> {
    if centers_m.is_empty() {
        return None;
    }
    let at = |k: usize| half_side_m * (2.0 * k as f64 / GAP_STEPS as f64 - 1.0);
    let places = (0..=GAP_STEPS).flat_map(|row| (0..=GAP_STEPS).map(move |column| Vec2::new(at(column), at(row))));
    let farther = |best: (f64, Vec2), next: (f64, Vec2)| if next.0 > best.0 { next } else { best };
    let (distance_sq, position_m) =
        places.map(|place| (nearest_distance_squared(centers_m, place), place)).reduce(farther)?;
    Some(CoverageHole { position_m, distance_m: distance_sq.sqrt() })
}
