//! What a COR library can do on a plate: how well it moves a part where, and where its centres lie.

use upm_core::geometry::Vec2;
use upm_library::Library;
use upm_planner::Reach;

#[cfg(test)]
pub(super) mod fixture;
#[cfg(test)]
mod tests;

/// Places along each side of the plate that are looked at; odd, so that one is its middle.
const PLACES: usize = 21;

/// Steps along each side in which the largest gap is looked for.
const GAP_STEPS: usize = 200;

/// A centre farther away than this many sides is that of a translation: the flow turns by less than 6 degrees over
/// the plate.
const FAR_SIDES: f64 = 10.0;

/// What a library can do on a plate.
#[derive(Clone, Debug, PartialEq)]
pub struct Coverage {
    /// Half the plate's side, m.
    pub half_side_m: f64,
    /// Middles of equal squares that fill the plate, row by row from the top, each from the left.
    pub places: Vec<Place>,
    /// Places in a row, and rows.
    pub columns: usize,
    /// Every entry's centre of rotation that is no translation's, m.
    pub centers_m: Vec<Vec2>,
    /// How many of them lie on the plate.
    pub inside: usize,
    /// How many lie outside it.
    pub outside: usize,
    /// Entries that move the whole plate nearly one way.
    pub translations: usize,
    /// The place on the plate farthest from every centre; `None` where there is no centre.
    pub gap: Option<Gap>,
    /// Entries that at no place and along no direction do most.
    pub never_strongest: Vec<usize>,
    /// The longest step that was measured at all, m.
    pub best_step_m: f64,
}

/// How well a part at one place is moved in the direction in which it is moved worst.
#[derive(Clone, Debug, PartialEq)]
pub struct Place {
    /// Where, m.
    pub position_m: Vec2,
    /// Unit vector of that direction.
    pub weakest_direction: Vec2,
    /// The longest step along it as a part of the longest that was measured, 0 to 1.
    pub share: f64,
    /// Longest step along it in one pulse, m.
    pub longest_step_m: f64,
    /// Standard deviation of such a step, m.
    pub longest_sd_m: f64,
    /// Shortest step along it in one pulse, m; `None` where there is none.
    pub shortest_step_m: Option<f64>,
}

/// A place far from every centre.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Gap {
    /// Where, m, to a two-hundredth of the plate's side.
    pub position_m: Vec2,
    /// From there to the nearest centre, m.
    pub distance_m: f64,
}

impl Place {
    /// Below this share of the longest measured step a direction counts as one that cannot be reached.
    pub const LEAST_SHARE: f64 = 0.1;

    /// The place at `position_m`, of the reach there.
    pub(super) fn of(position_m: Vec2, reach: &Reach) -> Self {
        Self {
            position_m,
            weakest_direction: reach.weakest_direction,
            share: reach.weakest_projection,
            longest_step_m: reach.longest_step_m,
            longest_sd_m: reach.longest_sd_m,
            shortest_step_m: reach.shortest_step_m,
        }
    }

    /// True where a part can be moved in every direction.
    pub fn is_reached(&self) -> bool {
        self.share >= Self::LEAST_SHARE
    }
}

impl Coverage {
    /// What `library` can do on its rig's plate.
    pub fn of(library: &Library) -> Self {
        let half_side_m = 0.5 * library.plate_side_m;
        let model = &library.displacement;
        let mut is_strongest = vec![false; library.entries.len()];
        let mut places = Vec::with_capacity(PLACES * PLACES);
        for position_m in grid(half_side_m) {
            let reach = Reach::of(library, position_m);
            reach.strongest.iter().for_each(|&entry| is_strongest[entry] = true);
            places.push(Place::of(position_m, &reach));
        }
        let far_m = FAR_SIDES * 2.0 * half_side_m;
        let centers = library.entries.iter().filter_map(|entry| entry.center_m());
        let centers_m: Vec<Vec2> = centers.filter(|center| center.norm() <= far_m).collect();
        let inside = centers_m.iter().filter(|center| center.amax() <= half_side_m).count();
        Self {
            half_side_m,
            places,
            columns: PLACES,
            inside,
            outside: centers_m.len() - inside,
            translations: library.entries.len() - centers_m.len(),
            gap: largest_gap(&centers_m, half_side_m),
            centers_m,
            never_strongest: (0..library.entries.len()).filter(|&entry| !is_strongest[entry]).collect(),
            best_step_m: model.speed_mps.last().map_or(0.0, |&fastest| model.max_distance(fastest)),
        }
    }

    /// The place where a part is moved worst.
    pub fn weakest(&self) -> Option<&Place> {
        self.places.iter().min_by(|a, b| a.longest_step_m.total_cmp(&b.longest_step_m))
    }

    /// The longest step along the weakest direction, at the place where it is longest, m.
    pub fn strongest_step_m(&self) -> f64 {
        self.places.iter().map(|place| place.longest_step_m).fold(0.0, f64::max)
    }

    /// Part of the plate where some direction cannot be reached, 0 to 1.
    pub fn unreached_share(&self) -> f64 {
        self.places.iter().filter(|place| !place.is_reached()).count() as f64 / self.places.len().max(1) as f64
    }
}

/// Middles of equal squares that fill the plate, row by row from the top.
fn grid(half_side_m: f64) -> impl Iterator<Item = Vec2> {
    let at = move |k: usize| half_side_m * ((2 * k + 1) as f64 / PLACES as f64 - 1.0);
    (0..PLACES).flat_map(move |row| (0..PLACES).map(move |column| Vec2::new(at(column), -at(row))))
}

fn largest_gap(centers_m: &[Vec2], half_side_m: f64) -> Option<Gap> {
    if centers_m.is_empty() {
        return None;
    }
    let at = |k: usize| half_side_m * (2.0 * k as f64 / GAP_STEPS as f64 - 1.0);
    let places = (0..=GAP_STEPS).flat_map(|row| (0..=GAP_STEPS).map(move |column| Vec2::new(at(column), at(row))));
    let nearest_sq = |place: Vec2| centers_m.iter().map(|c| (c - place).norm_squared()).fold(f64::INFINITY, f64::min);
    let farther = |best: (f64, Vec2), next: (f64, Vec2)| if next.0 > best.0 { next } else { best };
    let (distance_sq, position_m) = places.map(|place| (nearest_sq(place), place)).reduce(farther)?;
    Some(Gap { position_m, distance_m: distance_sq.sqrt() })
}
