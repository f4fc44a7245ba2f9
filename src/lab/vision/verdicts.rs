use crate::numerics::suppress_neighbours;
use upm_core::geometry::Vec2;
use upm_core::rig::PartKind;
use upm_perception::vision::{CoinFinder, Detection, TableError, locate_table};
use upm_scene::{Difficulty, Scene, ScenePartTruth, kinds};

/// Error of a corner, px, above which a located table counts as misplaced.
const MISPLACED_PX: f64 = 5.0;

/// Verdict on one scene. Parts of a scene whose table was not located correctly are not compared.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct SceneVerdict {
    pub seed: u64,
    pub parts: usize,
    /// Why no table was found.
    pub fault: Option<TableError>,
    /// True where a table was located, but in the wrong place.
    pub misplaced: bool,
    /// Distances of the corners from the true ones, px, of a table located correctly.
    pub corner_errors_px: Option<[f64; 4]>,
    /// Errors of the parts that were found.
    pub errors: Vec<PartError>,
    pub missed: usize,
    /// Detections where no part is.
    pub invented: usize,
    /// Parts found but taken for another kind.
    pub misnamed: usize,
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PartError {
    /// Distance of the outline's centre from the true one, px.
    pub center_px: f64,
    /// Difference of the radius from the true one, px.
    pub radius_px: f64,
    /// Distance from the true position on the plate, m.
    pub position_m: f64,
    /// Squared error of the centre over the reported covariance, mean of the two axes.
    pub over_covariance: f64,
}

/// Locates table and parts in the scene's picture and compares them with its truth.
pub fn evaluate(difficulty: Difficulty, scene: &Scene) -> SceneVerdict {
    let verdict = SceneVerdict { seed: scene.seed, parts: scene.parts.len(), ..SceneVerdict::default() };
    let frame = scene.frame();
    let table = match locate_table(&frame, &scene.lens, scene.side_m) {
        Ok(table) => table,
        Err(fault) => return SceneVerdict { fault: Some(fault), ..verdict },
    };
    let truth = scene.corners_px();
    let corner_errors_px = [0, 1, 2, 3].map(|i| (table.corners_px[i] - truth[i]).norm());
    if !corner_errors_px.iter().all(|&off| off < MISPLACED_PX) {
        return SceneVerdict { misplaced: true, ..verdict };
    }
    let kinds = kinds_of(difficulty);
    let found = CoinFinder::new(&table, scene.size_px, &kinds, scene.dark_parts()).find(&frame);
    compare(SceneVerdict { corner_errors_px: Some(corner_errors_px), ..verdict }, &scene.truth(), &found)
}

/// The kinds searched for.
fn kinds_of(difficulty: Difficulty) -> Vec<PartKind> {
    let mut kinds = kinds();
    kinds.truncate(if difficulty == Difficulty::Papers { 1 } else { kinds.len() });
    kinds
}

/// `verdict` with that on the parts. Matches nearest pairs first; a part is found where a detection is within half its
/// radius.
fn compare(verdict: SceneVerdict, truth: &[ScenePartTruth], found: &[Detection]) -> SceneVerdict {
    let distance = |i: usize, k: usize| (found[k].center_px - truth[i].center_px).norm();
    let near = |&(i, k): &(usize, usize)| distance(i, k) < truth[i].radius_px / 2.0;
    let mut pairs: Vec<(usize, usize)> =
        (0..truth.len()).flat_map(|i| (0..found.len()).map(move |k| (i, k))).filter(near).collect();
    pairs.sort_by(|a, b| distance(a.0, a.1).total_cmp(&distance(b.0, b.1)));
    let mut matched = suppress_neighbours(pairs, |pair: &(usize, usize), (i, k)| pair.0 != *i && pair.1 != *k);
    matched.sort_unstable();
    SceneVerdict {
        errors: matched.iter().map(|&(i, k)| error(&truth[i], &found[k])).collect(),
        missed: truth.len() - matched.len(),
        invented: found.len() - matched.len(),
        misnamed: matched.iter().filter(|&&(i, k)| truth[i].kind != found[k].kind).count(),
        ..verdict
    }
}

fn error(truth: &ScenePartTruth, found: &Detection) -> PartError {
    let off: Vec2 = found.center_px - truth.center_px;
    let inverse = found.covariance_px2.try_inverse();
    PartError {
        center_px: off.norm(),
        radius_px: found.radius_px - truth.radius_px,
        position_m: (found.position_m - truth.at_m).norm(),
        over_covariance: inverse.map_or(f64::INFINITY, |inverse| off.dot(&(inverse * off)) / 2.0),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Matrix2;

    fn part(x: f64, kind: usize) -> ScenePartTruth {
        ScenePartTruth { kind, at_m: Vec2::new(x * 1e-3, 0.0), center_px: Vec2::new(x, 0.0), radius_px: 10.0 }
    }

    fn detection(x: f64, kind: usize) -> Detection {
        Detection {
            kind,
            center_px: Vec2::new(x, 0.0),
            radius_px: 10.0,
            position_m: Vec2::new(x * 1e-3, 0.0),
            score: 1.0,
            covariance_px2: Matrix2::from_diagonal_element(0.04),
        }
    }

    #[test]
    fn parts_are_missed_invented_and_misnamed() {
        let truth = [part(0.0, 0), part(20.0, 1), part(40.0, 2)];
        // One right, one of another kind, a second one on the same part, one where none is.
        let found = [detection(0.2, 0), detection(20.0, 3), detection(21.0, 1), detection(100.0, 0)];
        let verdict = compare(SceneVerdict::default(), &truth, &found);
        assert_eq!((verdict.missed, verdict.invented, verdict.misnamed), (1, 2, 1));
        let error = verdict.errors[0];
        assert!((error.center_px - 0.2).abs() < 1e-12 && (error.position_m - 2e-4).abs() < 1e-12);
        assert!((error.over_covariance - 0.5).abs() < 1e-12);
    }
}
