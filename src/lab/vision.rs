//! Tests of the vision against rendered pictures with ground truth.

mod verdict_counts;
mod verdicts;

use super::sweep::Progress;
use super::{ExperimentResult, LabError, LabRig};
use upm_core::background::on_all_cores;
use upm_scene::{Difficulty, Scene};
use verdict_counts::{figures, notes};
use verdicts::evaluate;

/// Scenes of each difficulty by default.
const SCENES: usize = 50;

/// Locates table and parts without prior knowledge in 50 scenes of every difficulty, starting at the seed. Independent
/// of the rig.
///
/// # Errors
///
/// None: the seed is all that it takes from the rig.
pub fn vision(lab: &LabRig, progress: Progress<'_>) -> Result<ExperimentResult, LabError> {
    Ok(vision_of(lab.seed, SCENES, progress))
}

/// The same in `scenes` scenes of every difficulty, of the seeds `seed`, `seed + 1`, ... The result does not depend on
/// the number of threads.
pub fn vision_of(seed: u64, scenes: usize, progress: Progress<'_>) -> ExperimentResult {
    let seeds = (0..scenes as u64).map(|i| seed.wrapping_add(i));
    let scene = |difficulty| seeds.clone().map(move |seed| (difficulty, seed));
    let all: Vec<(Difficulty, u64)> = Difficulty::ALL.into_iter().flat_map(scene).collect();
    let verdicts =
        on_all_cores(&all, progress, |&(difficulty, seed)| evaluate(difficulty, &Scene::generate(difficulty, seed)));
    let by_difficulty = || Difficulty::ALL.into_iter().zip(verdicts.chunks(scenes.max(1)));
    ExperimentResult {
        figures: by_difficulty().flat_map(|(difficulty, verdicts)| figures(difficulty, verdicts)).collect(),
        notes: by_difficulty().flat_map(|(difficulty, verdicts)| notes(difficulty, verdicts)).collect(),
        ..ExperimentResult::default()
    }
}

#[cfg(test)]
mod tests {
    use super::super::testing::{assert_sources_are_short, measured};
    use super::*;

    /// Fingers like parts, strips beside the table, plates on bright ground, glints, hands darker than any part: each
    /// of these pictures was misread by an earlier version.
    #[test]
    fn formerly_misread_pictures_are_read() {
        let hard = [20, 42, 138, 190, 272, 312, 373, 388, 422, 433, 434, 485, 525, 663, 934, 935, 961];
        let clean = [8, 23, 30, 140, 187].map(|seed| (Difficulty::Clean, seed));
        for (difficulty, seed) in hard.map(|seed| (Difficulty::Hard, seed)).into_iter().chain(clean) {
            let parts = evaluate(difficulty, &Scene::generate(difficulty, seed));
            let Some(corner_errors_px) = parts.corner_errors_px else { panic!("{difficulty:?} {seed}: no table") };
            assert!(
                corner_errors_px.iter().all(|&error| error < 0.3),
                "{difficulty:?} {seed}: {corner_errors_px:?} px"
            );
            assert_eq!((parts.missed, parts.invented, parts.misnamed), (0, 0, 0), "{difficulty:?} {seed}");
            assert!(parts.errors.iter().all(|error| error.center_px < 0.5), "{difficulty:?} {seed}");
        }
    }

    #[test]
    fn a_campaign_counts_every_part_and_is_the_same_again() {
        let outcome = vision_of(3, 2, &|_| ());
        assert_sources_are_short(&outcome);
        for difficulty in Difficulty::ALL {
            let figure = |name: &str| measured(&outcome, &format!("{}: {name}", difficulty.code()));
            let parts: usize = [3, 4].map(|seed| Scene::generate(difficulty, seed).parts.len()).iter().sum();
            assert_eq!(figure("parts in all"), parts as f64);
        }
        assert_eq!(vision_of(3, 2, &|_| ()), outcome);
    }
}
