//! Assignment of detections to the parts of the job.

use crate::run_end::{OrEnd, RunEnd};
use upm_core::geometry::Vec2;
use upm_core::job::Finding;
use upm_core::rig::PartKind;
use upm_perception::vision::Detection;

/// A part that the job expects on the plate.
#[derive(Clone, Debug, PartialEq)]
pub struct ExpectedPart {
    /// Name for people: `penny-1`.
    pub id: String,
    /// Index into the kinds.
    pub kind: usize,
    /// The place the job gives, m; `None` when it may be anywhere.
    pub expected_m: Option<Vec2>,
}

/// Gives each part of the job its detection: parts with a known place take the nearest of their kind, the others the
/// remaining ones from left to right.
///
/// # Errors
/// A part without a detection; with `counts`, also a detection too many.
pub(super) fn name_parts(
    mut found: Vec<Detection>,
    kinds: &[PartKind],
    parts: &[ExpectedPart],
    counts: bool,
) -> OrEnd<Vec<Detection>> {
    if counts {
        count_parts(&found, kinds, parts)?;
    }
    found.sort_by(|a, b| a.position_m.x.total_cmp(&b.position_m.x).then(a.position_m.y.total_cmp(&b.position_m.y)));
    let mut named: Vec<Option<Detection>> = vec![None; parts.len()];
    let by_certainty = (0..parts.len()).filter(|&i| parts[i].expected_m.is_some());
    let rest = (0..parts.len()).filter(|&i| parts[i].expected_m.is_none());
    for i in by_certainty.chain(rest) {
        let part = &parts[i];
        let same_kind = found.iter().enumerate().filter(|(_, detection)| detection.kind == part.kind);
        // all are as near where the job gives no place: the first is taken
        let away = |of: &Detection| part.expected_m.map_or(0.0, |place| (of.position_m - place).norm_squared());
        let choice = same_kind.min_by(|(_, a), (_, b)| away(a).total_cmp(&away(b))).map(|(at, _)| at);
        named[i] = choice.map(|at| found.remove(at));
    }
    let missing = || RunEnd::failed_because(Finding::PartCount, "a part of the job was not found");
    named.into_iter().collect::<Option<_>>().ok_or_else(missing)
}

fn count_parts(found: &[Detection], kinds: &[PartKind], parts: &[ExpectedPart]) -> OrEnd {
    for (kind, spec) in kinds.iter().enumerate() {
        let seen = found.iter().filter(|detection| detection.kind == kind).count();
        let expected = parts.iter().filter(|part| part.kind == kind).count();
        if seen != expected {
            let reason = format!("the camera sees {seen} of kind {:?}, the job has {expected}", spec.name);
            return Err(RunEnd::failed_because(Finding::PartCount, reason));
        }
    }
    Ok(())
}

/// Gives each part the detection of its kind that is nearest to its former place, each detection to one part; `None`
/// when the numbers differ. Also returns the longest such distance, m.
pub(super) fn match_parts(mut found: Vec<Detection>, before: &[Detection]) -> Option<(Vec<Detection>, f64)> {
    if found.len() != before.len() {
        return None;
    }
    let mut farthest_m = 0.0f64;
    let mut matched = Vec::with_capacity(before.len());
    for part in before {
        let away_m = |detection: &Detection| (detection.position_m - part.position_m).norm();
        let same_kind = found.iter().enumerate().filter(|(_, detection)| detection.kind == part.kind);
        let (at, _) = same_kind.min_by(|(_, a), (_, b)| away_m(a).total_cmp(&away_m(b)))?;
        let detection = found.swap_remove(at);
        farthest_m = farthest_m.max(away_m(&detection));
        matched.push(detection);
    }
    Some((matched, farthest_m))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn detection(kind: usize, x: f64, y: f64) -> Detection {
        Detection {
            kind,
            center_px: Vec2::zeros(),
            radius_px: 40.0,
            position_m: Vec2::new(x, y),
            score: 1.0,
            covariance_px2: nalgebra::Matrix2::from_diagonal_element(1e-4),
        }
    }

    fn part(kind: usize, expected_m: Option<Vec2>) -> ExpectedPart {
        ExpectedPart { id: String::new(), kind, expected_m }
    }

    fn kinds() -> Vec<PartKind> {
        ["penny", "quarter"].map(|name| PartKind { name: name.into(), radius_m: 0.01, thickness_m: 0.0015 }).to_vec()
    }

    #[test]
    fn known_places_are_served_before_the_rest() {
        let found = vec![detection(0, 0.02, 0.0), detection(1, 0.0, 0.0), detection(0, -0.02, 0.0)];
        let parts = [part(0, None), part(0, Some(Vec2::new(-0.019, 0.0))), part(1, None)];
        let named = name_parts(found, &kinds(), &parts, true).unwrap();
        let x: Vec<f64> = named.iter().map(|d| d.position_m.x).collect();
        assert_eq!(x, [0.02, -0.02, 0.0]);
    }

    #[test]
    fn wrong_part_count_ends_the_run_with_a_reason() {
        let ending =
            name_parts(vec![detection(0, 0.0, 0.0)], &kinds(), &[part(0, None), part(0, None)], true).err().unwrap();
        let says = "the camera sees 1 of kind \"penny\", the job has 2; put the parts of the job on the plate";
        assert!(ending.reason.starts_with(says), "{}", ending.reason);
    }
}
