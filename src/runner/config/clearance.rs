//! Checks whether parts have room at their start and at their targets.

use super::kinds::{KindSpec, LEAST_SEEN_RADIUS_M, PartGroup};
use super::rig::RigSpec;
use upm_core::document::{Diagnostics, Path, counted};
use upm_core::geometry::Vec2;
use upm_core::units::mm_from_m;

/// Least gap between the rims of parts placed at random, m.
pub const START_GAP_M: f64 = 3e-3;

/// Least distance of such a rim from the plate's edge, m.
pub const START_MARGIN_M: f64 = 5e-3;

/// Gap between rims that the planner keeps, and therefore the least gap between targets, m.
pub const REST_GAP_M: f64 = 2e-3;

/// Distance of rims from the plate's edge that the planner keeps, and therefore the least for targets, m.
pub const REST_MARGIN_M: f64 = 1e-3;

/// Shortfall that counts as rounding, m.
pub(super) const ROUNDING_M: f64 = 1e-9;

/// True if a part of `kind` fits on the plate and the camera can find it, else a fault at `at`.
pub(super) fn check_size(kind: usize, rig: &RigSpec, at_random: bool, at: &Path, faults: &mut Diagnostics) -> bool {
    let margin_m = if at_random { START_MARGIN_M } else { 0.0 };
    let found = rig.kinds.get(kind).map_or(0.0, |spec| mm_from_m(2.0 * spec.kind.radius_m));
    let (least, most) = (mm_from_m(2.0 * LEAST_SEEN_RADIUS_M), mm_from_m(rig.model.plate_side_m - 2.0 * margin_m));
    let (is_seen, fits) = (rig.kinds.get(kind).is_none_or(KindSpec::can_be_seen), found <= most);
    faults.require(fits, at, format!("a part of {found:.3} mm"), format!("up to {most:.3} mm on this plate"));
    let allowed = format!("{least} mm or more (the camera cannot see less; `upm simulate` takes it)");
    faults.require(is_seen, at, format!("a part of {found:.3} mm"), allowed);
    is_seen && fits
}

/// Most parts of a job.
const MOST_PARTS: usize = 64;

/// False if a job has more parts than any may have, which is a fault. The work of the other checks grows with the
/// square of their number.
pub(super) fn check_total(groups: &[PartGroup], faults: &mut Diagnostics) -> bool {
    let total: usize = groups.iter().map(|group| group.count).sum();
    let allowed = format!("up to {MOST_PARTS} in all");
    faults.require(total <= MOST_PARTS, Path::root().key("parts"), counted(total, "part"), allowed)
}

/// Reports parts that start off the plate or in one another.
pub(super) fn check(groups: &[PartGroup], rig: &RigSpec, faults: &mut Diagnostics) {
    let (half_m, at) = (0.5 * rig.model.plate_side_m, Path::root().key("parts"));
    let radius = |group: &PartGroup| rig.kinds.get(group.kind).map_or(0.0, |spec| spec.kind.radius_m);
    let given: Vec<(Vec2, f64, Path)> = (0..)
        .zip(groups)
        .filter_map(|(i, group)| Some((group.position_m?, radius(group), at.index(i).key("position_mm"))))
        .collect();
    for (position_m, radius_m, at) in &given {
        check_inside(*position_m, *radius_m, half_m, 0.0, at, faults);
    }
    check_apart(&given, 0.0, faults);
}

/// Reports a disc at `at` whose rim is not on the plate, `margin_m` inside its edge.
pub(super) fn check_inside(
    center_m: Vec2,
    radius_m: f64,
    half_m: f64,
    margin_m: f64,
    at: &Path,
    faults: &mut Diagnostics,
) {
    let most_m = half_m - radius_m - margin_m;
    let most_mm = mm_from_m(most_m).max(0.0);
    let why = match margin_m {
        0.0 => "the whole part on the plate".to_owned(),
        _ => format!("the whole part on the plate, {:.3} mm inside its edge", mm_from_m(margin_m)),
    };
    let allowed = format!("from {:.3} to {most_mm:.3} ({why})", -most_mm);
    for (i, found) in center_m.iter().enumerate() {
        let inside = found.abs() <= most_m + ROUNDING_M;
        faults.require(inside, at.index(i), format!("{:.3}", mm_from_m(*found)), allowed.clone());
    }
}

/// Reports every disc whose rim is less than `gap_m` from that of an earlier one, once for discs of one place in the
/// file; returns these places.
pub(super) fn check_apart<'a>(discs: &'a [(Vec2, f64, Path)], gap_m: f64, faults: &mut Diagnostics) -> Vec<&'a Path> {
    let mut told = Vec::new();
    for (i, (center_m, radius_m, at)) in discs.iter().enumerate() {
        let least_m = |other_radius_m: &f64| radius_m + other_radius_m + gap_m;
        let near = discs
            .iter()
            .take(i)
            .find(|(other_m, other_radius_m, _)| (center_m - other_m).norm() < least_m(other_radius_m) - ROUNDING_M);
        if let Some((other_m, other_radius_m, other)) = near
            && told.last() != Some(&at)
        {
            told.push(at);
            let found = format!("{:.3} mm from {other}", mm_from_m((center_m - other_m).norm()));
            faults.push(at, found, apart_allowed(least_m(other_radius_m), gap_m));
        }
    }
    told
}

/// Text of the allowed distance between two centres.
pub(super) fn apart_allowed(least_m: f64, gap_m: f64) -> String {
    let why = match gap_m {
        0.0 => "parts cannot overlap".to_owned(),
        _ => format!("both radii and {:.3} mm between the rims", mm_from_m(gap_m)),
    };
    format!("{:.3} mm or more ({why})", mm_from_m(least_m))
}
