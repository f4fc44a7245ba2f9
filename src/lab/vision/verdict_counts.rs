use super::super::Figure;
use super::super::numerics::rms;
use super::super::texts::figure;
use super::verdicts::{PartError, SceneVerdict};
use upm_core::units::mm_from_m;
use upm_scene::Difficulty;

/// Kinds of failure.
const CAUSES: [&str; 5] = ["tables not found", "tables misplaced", "parts missed", "parts invented", "parts misnamed"];
/// Most seeds reported for one cause.
const MOST_SEEDS: usize = 10;

/// Errors of the parts that were found, with the seeds of their scenes.
fn errors(verdicts: &[SceneVerdict]) -> impl Iterator<Item = (u64, &PartError)> {
    verdicts.iter().flat_map(|verdict| verdict.errors.iter().map(move |error| (verdict.seed, error)))
}

/// The figures of the scenes of one difficulty. Errors are distances: both axes taken together. Parts of scenes whose
/// table was not located correctly are neither missed nor measured.
pub fn figures(difficulty: Difficulty, verdicts: &[SceneVerdict]) -> Vec<Figure> {
    let errors_of = |of: fn(&PartError) -> f64| errors(verdicts).map(|(_, error)| of(error)).collect::<Vec<f64>>();
    let (centers_px, radii_px) = (errors_of(|error| error.center_px), errors_of(|error| error.radius_px));
    let positions_mm = errors_of(|error| mm_from_m(error.position_m));
    let over_covariance = errors_of(|error| error.over_covariance);
    let corners_px: Vec<f64> = verdicts.iter().filter_map(|verdict| verdict.corner_errors_px).flatten().collect();
    let errors = [
        ("centre rms", rms(&centers_px)),
        ("centre worst", worst(&centers_px)),
        ("corner rms", rms(&corners_px)),
        ("corner worst", worst(&corners_px)),
        ("radius rms", rms(&radii_px)),
        ("position rms", rms(&positions_mm)),
        ("position worst", worst(&positions_mm)),
    ];
    let failed = |cause: usize| verdicts.iter().map(|verdict| failures(verdict)[cause]).sum::<usize>() as f64;
    let failures = CAUSES.into_iter().enumerate().map(|(cause, name)| (name, failed(cause)));
    let parts = verdicts.iter().map(|verdict| verdict.parts).sum::<usize>();
    let ends = [
        ("centre over covariance", over_covariance.iter().sum::<f64>() / over_covariance.len() as f64),
        ("parts in all", parts as f64),
    ];
    let all = errors.into_iter().chain(failures).chain(ends);
    all.map(|(name, measured)| figure(&format!("{}: {name}", difficulty.code()), measured)).collect()
}

/// Seeds that need attention, one cause a line: why tables were not found, then the other failures.
pub fn notes(difficulty: Difficulty, verdicts: &[SceneVerdict]) -> Vec<String> {
    let faults = verdicts.iter().filter_map(|verdict| Some((verdict.fault.as_ref()?.to_string(), verdict.seed)));
    let causes = (1..CAUSES.len()).flat_map(|cause| {
        let failed = verdicts.iter().filter(move |verdict| failures(verdict)[cause] > 0);
        failed.map(move |verdict| (CAUSES[cause].to_owned(), verdict.seed))
    });
    let mut seeds_of: Vec<(String, Vec<u64>)> = Vec::new();
    for (cause, seed) in faults.chain(causes) {
        match seeds_of.iter_mut().find(|(known, _)| *known == cause) {
            Some((_, seeds)) => seeds.push(seed),
            None => seeds_of.push((cause, vec![seed])),
        }
    }
    let line = |(cause, seeds): (String, Vec<u64>)| {
        let shown: Vec<String> = seeds.iter().take(MOST_SEEDS).map(u64::to_string).collect();
        let more = if seeds.len() > MOST_SEEDS { ", ..." } else { "" };
        let (difficulty, all, few) = (difficulty.code(), verdicts.len(), shown.join(", "));
        format!("{difficulty}: {cause}: {} of {all} scenes, seeds {few}{more}", seeds.len())
    };
    let worst = errors(verdicts).max_by(|a, b| a.1.center_px.total_cmp(&b.1.center_px));
    let worst = worst.map(|(seed, PartError { center_px, .. })| {
        format!("{}: worst centre: {center_px:.3} px, seed {seed}", difficulty.code())
    });
    seeds_of.into_iter().map(line).chain(worst).collect()
}

/// Numbers of failures in a scene by cause.
fn failures(verdict: &SceneVerdict) -> [usize; CAUSES.len()] {
    let SceneVerdict { fault, misplaced, missed, invented, misnamed, .. } = verdict;
    [usize::from(fault.is_some()), usize::from(*misplaced), *missed, *invented, *misnamed]
}

fn worst(errors: &[f64]) -> f64 {
    errors.iter().copied().fold(f64::NAN, f64::max)
}

#[cfg(test)]
mod tests {
    use super::*;
    use upm_perception::vision::TableError;

    #[test]
    fn verdicts_add_up() {
        let found = |errors: &[f64], missed| {
            let error = |&center_px: &f64| PartError {
                center_px,
                radius_px: -center_px,
                position_m: 1e-3 * center_px,
                over_covariance: 2.0,
            };
            let errors: Vec<PartError> = errors.iter().map(error).collect();
            let corner_errors_px = Some([0.1; 4]);
            SceneVerdict { corner_errors_px, errors, missed, misnamed: 1, ..SceneVerdict::default() }
        };
        let tables = [
            found(&[0.3], 0),
            SceneVerdict { fault: Some(TableError::NotASquare), ..SceneVerdict::default() },
            SceneVerdict { misplaced: true, ..SceneVerdict::default() },
            found(&[0.4], 2),
        ];
        let verdicts: Vec<SceneVerdict> =
            tables.into_iter().zip(7..).map(|(table, seed)| SceneVerdict { seed, parts: 3, ..table }).collect();
        let figures = figures(Difficulty::Rough, &verdicts);
        let figure = |name: &str| figures.iter().find(|figure| figure.name == format!("rough: {name}")).unwrap();
        let rms = 0.125f64.sqrt();
        let errors = [("centre rms", rms), ("radius rms", rms), ("position rms", rms), ("centre worst", 0.4)];
        let counts = [("parts in all", 12.0), ("parts missed", 2.0), ("parts invented", 0.0), ("parts misnamed", 2.0)];
        let tables = [("corner rms", 0.1), ("tables not found", 1.0), ("tables misplaced", 1.0)];
        for (name, expected) in errors.into_iter().chain(counts).chain(tables).chain([("centre over covariance", 2.0)])
        {
            assert!((figure(name).measured - expected).abs() < 1e-12, "{name}: {}", figure(name).measured);
        }
        assert_eq!(figure("centre rms").source, "bar 0.1 px; rendered scenes");
        assert_eq!(
            notes(Difficulty::Rough, &verdicts),
            [
                "rough: no four lines make a square that is lighter or darker than the ground: 1 of 4 scenes, seeds 8",
                "rough: tables misplaced: 1 of 4 scenes, seeds 9",
                "rough: parts missed: 1 of 4 scenes, seeds 10",
                "rough: parts misnamed: 2 of 4 scenes, seeds 7, 10",
                "rough: worst centre: 0.400 px, seed 10",
            ]
        );
    }
}
