//! Checks whether the places of a shape, or a part on its path, fit on the plate, and computes the size that would fit.

use super::clearance::{REST_GAP_M, REST_MARGIN_M, ROUNDING_M, apart_allowed};
use super::task::TaskContext;
use upm_core::document::{Diagnostics, Path, counted};
use upm_core::geometry::Vec2;
use upm_core::units::mm_from_m;
use upm_planning::shapes::Pattern;

/// Least ratio by which a pair must ask for a larger shape to be reported in place of an earlier pair.
pub(super) const TIGHTER: f64 = 1.0 + 1e-9;

/// Lengths in a job file with which a shape scales about its middle.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Growth {
    /// Name for messages: a key, or words.
    pub name: &'static str,
    /// Present lengths, m.
    pub size_m: Vec<f64>,
    /// Fixed point of the scaling, m.
    pub center_m: Vec2,
}

impl Growth {
    /// Text for messages: `height_mm of at least 131 mm`, `a length of at least 131 mm`.
    pub fn at_least(&self, scale: f64) -> String {
        format!("{}{} of at least {} mm", self.article(), self.name, self.scaled(scale, rounded_up))
    }

    fn at_most(&self, scale: f64) -> String {
        format!("{}{} of at most {} mm", self.article(), self.name, self.scaled(scale, rounded_down))
    }

    /// The article of a name in words; a key has none.
    fn article(&self) -> &'static str {
        if self.name.contains('_') { "" } else { "a " }
    }

    fn scaled(&self, scale: f64, rounded: fn(f64) -> f64) -> String {
        let figures: Vec<String> = self.size_m.iter().map(|size_m| rounded(scale * size_m).to_string()).collect();
        if let [only] = &figures[..] { only.clone() } else { format!("[{}]", figures.join(", ")) }
    }

    /// True if a size between the two scales can be written with one decimal.
    fn is_between(&self, least: f64, most: f64) -> bool {
        most > 0.0
            && self.size_m.iter().all(|size_m| rounded_up(least * size_m) <= rounded_down(most * size_m))
            && self.size_m.iter().all(|size_m| rounded_down(most * size_m) > 0.0)
    }
}

/// Rounds up to a tenth of a millimetre, with a tolerance for rounding errors.
fn rounded_up(m: f64) -> f64 {
    (10.0 * mm_from_m(m) - 1e-6).ceil() / 10.0
}

fn rounded_down(m: f64) -> f64 {
    (10.0 * mm_from_m(m) + 1e-6).floor() / 10.0
}

/// A pair of parts, the distance between them and the least that they need.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Pair {
    pub parts: [usize; 2],
    pub distance_m: f64,
    pub least_m: f64,
}

impl Pair {
    /// Factor by which the shape, or both paths, must at least grow.
    pub fn scale(&self) -> f64 {
        (self.least_m - ROUNDING_M) / self.distance_m
    }
}

/// A shape with one place per part, and its path in the file.
pub(super) struct FittedOutline {
    pub at: Path,
    pub pattern: Pattern,
    pub growth: Growth,
}

impl TaskContext<'_> {
    /// Places of `shape` for the parts, m. Faults where they are too close to each other or to the edge; each names the
    /// size, or else the number of parts, that would fit.
    pub(super) fn places_of(&self, shape: &FittedOutline, faults: &mut Diagnostics) -> Option<Vec<Vec2>> {
        let places_m = shape.pattern.places(self.kinds.len())?;
        let most = self.largest_scale(&places_m, &self.radii_m, shape.growth.center_m);
        let tightest = self.tightest(&places_m);
        let mut discs = places_m.iter().zip(&self.radii_m).zip(&self.ids);
        if let Some(pair) = tightest.filter(|pair| pair.scale() > 1.0) {
            let [a, b] = pair.parts.map(|part| self.ids.get(part).map_or("part", String::as_str));
            let found = format!("{a} and {b} {:.3} mm apart", mm_from_m(pair.distance_m));
            let remedy = self.remedy(shape, pair.scale(), most);
            faults.push(&shape.at, found, format!("{}; {remedy}", apart_allowed(pair.least_m, REST_GAP_M)));
        } else if let Some(((place_m, &radius_m), id)) = discs.find(|((at, r), _)| at.amax() > self.reach_m(**r)) {
            let [x, y] = [place_m.x, place_m.y].map(mm_from_m);
            let remedy = self.remedy(shape, tightest.map_or(0.0, |pair| pair.scale()), most);
            let allowed = format!("{}; {remedy}", self.inside_allowed(radius_m));
            faults.push(&shape.at, format!("{id} at [{x:.3}, {y:.3}]"), allowed);
        }
        Some(places_m)
    }

    /// Reports a part of radius `radius_m` that leaves the plate on its path through `points_m`.
    pub(super) fn check_path(
        &self,
        points_m: &[Vec2],
        radius_m: f64,
        growth: &Growth,
        at: &Path,
        faults: &mut Diagnostics,
    ) {
        let Some(outside_m) = points_m.iter().find(|point_m| point_m.amax() > self.reach_m(radius_m)) else { return };
        let radii_m = vec![radius_m; points_m.len()];
        let most = self.largest_scale(points_m, &radii_m, growth.center_m);
        let [x, y] = [outside_m.x, outside_m.y].map(mm_from_m);
        let remedy = if growth.is_between(0.0, most) { growth.at_most(most) } else { NEARER.to_owned() };
        faults.push(
            at,
            format!("a way through [{x:.3}, {y:.3}]"),
            format!("{}; {remedy}", self.inside_allowed(radius_m)),
        );
    }

    /// Text of what would fit, if the shape must grow by at least `least` and at most `most`.
    fn remedy(&self, shape: &FittedOutline, least: f64, most: f64) -> String {
        let FittedOutline { growth, pattern, .. } = shape;
        if growth.is_between(least, most) {
            return if least > 1.0 { growth.at_least(least) } else { growth.at_most(most) };
        }
        if most <= 0.0 {
            return NEARER.to_owned();
        }
        let has_room = |count: &usize| {
            let Some(places_m) = pattern.places(*count) else { return false };
            let least = self.tightest(&places_m).map_or(0.0, |pair| pair.scale());
            growth.is_between(least, self.largest_scale(&places_m, &self.radii_m, growth.center_m))
        };
        let none = format!("no {} gives {} room there", growth.name, counted(self.kinds.len(), "part"));
        match (1..self.kinds.len()).rev().find(has_room) {
            Some(fewer) => format!("{none}, at most {fewer}"),
            None => none,
        }
    }

    /// The pair of parts that asks for the largest shape.
    fn tightest(&self, places_m: &[Vec2]) -> Option<Pair> {
        let pairs = places_m.iter().enumerate().flat_map(|(b, place_m)| {
            places_m.iter().enumerate().take(b).map(move |(a, other_m)| ([a, b], (place_m - other_m).norm()))
        });
        let radius_m = |part: usize| self.radii_m.get(part).copied().unwrap_or_default();
        pairs
            .map(|([a, b], distance_m)| Pair {
                parts: [a, b],
                distance_m,
                least_m: radius_m(a) + radius_m(b) + REST_GAP_M,
            })
            .reduce(|tightest, pair| if pair.scale() > tightest.scale() * TIGHTER { pair } else { tightest })
    }

    /// Largest factor by which points may be scaled about `center_m` with discs about them still on the plate; at most
    /// 0 if the centre itself is off the plate.
    fn largest_scale(&self, points_m: &[Vec2], radii_m: &[f64], center_m: Vec2) -> f64 {
        let along = |center_m: f64, point_m: f64, reach_m: f64| match point_m - center_m {
            0.0 if center_m.abs() <= reach_m => f64::INFINITY,
            0.0 => 0.0,
            way_m => (reach_m - center_m * way_m.signum()) / way_m.abs(),
        };
        let of_point = |(point_m, radius_m): (&Vec2, &f64)| {
            let reach_m = self.reach_m(*radius_m);
            along(center_m.x, point_m.x, reach_m).min(along(center_m.y, point_m.y, reach_m))
        };
        points_m.iter().zip(radii_m).map(of_point).fold(f64::INFINITY, f64::min)
    }

    /// Largest distance of a part's centre from the middle along an axis, m.
    fn reach_m(&self, radius_m: f64) -> f64 {
        self.half_m - radius_m - REST_MARGIN_M + ROUNDING_M
    }

    fn inside_allowed(&self, radius_m: f64) -> String {
        let most_mm = mm_from_m(self.reach_m(radius_m)).max(0.0);
        let margin_mm = mm_from_m(REST_MARGIN_M);
        format!("from {:.3} to {most_mm:.3} (the whole part on the plate, {margin_mm:.3} mm inside its edge)", -most_mm)
    }
}

const NEARER: &str = "a middle nearer to that of the plate";
