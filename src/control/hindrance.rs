//! Which parts stand in the way of which, for people.

use super::params::ControlParams;
use upm_core::geometry::{Segment, Vec2};
use upm_core::units::mm_from_m;

/// Gap between rims below which one part hinders the way of another, m: that for which ways round parts are searched.
const WAY_GAP_M: f64 = 3e-3;
/// Gap between the rims of parts at their places from which on places are no longer dense, m.
const ROOMY_M: f64 = 5e-3;

/// The parts that `part` meets on its straight way from its place in `seen_m` to that in `ends_m`, as ` past penny-2,
/// dime-1`; empty where there are none.
pub(super) fn past(params: &ControlParams, part: usize, seen_m: &[Vec2], ends_m: &[Vec2]) -> String {
    let (Some(&from), Some(&to)) = (seen_m.get(part), ends_m.get(part)) else { return String::new() };
    let meets = |(other, other_m): (usize, &Vec2)| {
        let least_m = params.radius_m(part) + params.radius_m(other) + WAY_GAP_M;
        (other != part && Segment { from, to }.distance(*other_m) < least_m).then(|| params.id(other))
    };
    let others: Vec<&str> = seen_m.iter().enumerate().filter_map(meets).collect();
    if others.is_empty() { String::new() } else { format!(" past {}", others.join(", ")) }
}

/// How dense the places round that of `part` are, where the next part leaves less than [`ROOMY_M`] between rims.
pub(super) fn dense_places(params: &ControlParams, part: usize, ends_m: &[Vec2]) -> Option<String> {
    let end_m = ends_m.get(part)?;
    let gap_m = |(other, other_m): (usize, &Vec2)| {
        let rims_m = (other_m - end_m).norm() - params.radius_m(part) - params.radius_m(other);
        (other != part).then_some((rims_m, other))
    };
    let (gap_m, other) = ends_m.iter().enumerate().filter_map(gap_m).min_by(|a, b| a.0.total_cmp(&b.0))?;
    (gap_m < ROOMY_M).then(|| {
        let [gap_mm, roomy_mm] = [gap_m, ROOMY_M].map(mm_from_m);
        let [part, other] = [part, other].map(|part| params.id(part));
        format!("the places of {part} and {other} leave {gap_mm:.1} mm between rims, {roomy_mm:.0} mm or more help")
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::ExpectedPart;
    use upm_core::rig::PartKind;

    #[test]
    fn parts_in_the_way_and_dense_places_are_told_by_name() {
        let part = |id: &str| ExpectedPart { id: id.into(), kind: 0, expected_m: None };
        let kinds = vec![PartKind { name: "disc".into(), radius_m: 8.5e-3, thickness_m: 1e-3 }];
        let parts = ["left", "right"].map(part).to_vec();
        let params = ControlParams { parts, kinds, ..ControlParams::default() };
        let at = |xs: [f64; 2]| xs.map(|x| Vec2::new(x, 0.0));
        assert_eq!(past(&params, 0, &at([0.03, 0.01]), &at([0.0, 0.05])), " past right");
        assert_eq!(past(&params, 0, &at([0.03, 0.06]), &at([0.0, 0.05])), "");
        let told = "the places of right and left leave 3.0 mm between rims, 5 mm or more help";
        assert_eq!(dense_places(&params, 1, &at([0.0, 0.02])), Some(told.into()));
        assert_eq!(dense_places(&params, 1, &at([0.0, 0.03])), None);
    }
}
