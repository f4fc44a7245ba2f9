use super::super::Figure;
use super::super::numerics::rms;
use super::verdicts::{PartError, SceneVerdict, TableVerdict};
use upm_core::units::mm_from_m;
use upm_scene::Difficulty;

/// Kinds of failure.
const CAUSES: [&str; 5] = ["tables not found", "tables misplaced", "parts missed", "parts invented", "parts misnamed"];
/// Most seeds reported for one cause.
const MOST_SEEDS: usize = 10;

/// Statistics of one difficulty's verdicts.
pub struct VerdictCounts {
    difficulty: Difficulty,
    scenes: usize,
    parts: usize,
    /// Failures, and the seeds of their scenes, by cause.
    failures: [(usize, Vec<u64>); CAUSES.len()],
    /// Reasons why tables were not found, and the scenes' seeds.
    faults: Vec<(String, Vec<u64>)>,
    corner_errors_px: Vec<f64>,
    errors: Vec<PartError>,
    /// Largest error of a centre, px, and the seed of its scene.
    worst_center: Option<(f64, u64)>,
}

impl VerdictCounts {
    pub fn new(difficulty: Difficulty, verdicts: &[SceneVerdict]) -> Self {
        let mut counts = Self {
            difficulty,
            scenes: verdicts.len(),
            parts: verdicts.iter().map(|verdict| verdict.parts).sum(),
            failures: Default::default(),
            faults: Vec::new(),
            corner_errors_px: Vec::new(),
            errors: Vec::new(),
            worst_center: None,
        };
        verdicts.iter().for_each(|verdict| counts.add(verdict));
        counts
    }

    fn add(&mut self, verdict: &SceneVerdict) {
        let seed = verdict.seed;
        let counts = match &verdict.table {
            TableVerdict::NotFound(fault) => {
                let fault = fault.to_string();
                match self.faults.iter_mut().find(|(known, _)| *known == fault) {
                    Some((_, seeds)) => seeds.push(seed),
                    None => self.faults.push((fault, vec![seed])),
                }
                [1, 0, 0, 0, 0]
            }
            TableVerdict::Misplaced => [0, 1, 0, 0, 0],
            TableVerdict::Found { corner_errors_px, parts } => {
                self.corner_errors_px.extend(corner_errors_px);
                for error in &parts.errors {
                    if self.worst_center.is_none_or(|(worst, _)| error.center_px > worst) {
                        self.worst_center = Some((error.center_px, seed));
                    }
                }
                self.errors.extend(&parts.errors);
                [0, 0, parts.missed, parts.invented, parts.misnamed]
            }
        };
        for ((all, seeds), count) in self.failures.iter_mut().zip(counts).filter(|(_, count)| *count > 0) {
            *all += count;
            seeds.push(seed);
        }
    }

    pub fn difficulty(&self) -> Difficulty {
        self.difficulty
    }

    pub fn center_errors_px(&self) -> Vec<f64> {
        self.errors.iter().map(|error| error.center_px).collect()
    }

    /// The figures. Errors are distances: both axes taken together. Parts of scenes whose table was not
    /// located correctly are neither missed nor measured.
    pub fn figures(&self) -> Vec<Figure> {
        const TRUTH: &str = "rendered scenes, against the truth";
        let name = |what: &str| format!("{}: {what}", self.difficulty);
        let figure = |what: &str, unit: &str, measured: f64, bar: Option<f64>| match bar {
            // a bar is not a published figure: being below it is not an error
            Some(bar) if bar > 0.0 => {
                Figure::alone(name(what), unit, measured, &format!("bar {bar} {unit}; rendered scenes"))
            }
            Some(none) => Figure::against(name(what), unit, measured, none, "rendered scenes; none allowed"),
            None => Figure::alone(name(what), unit, measured, TRUTH),
        };
        let (center_bar, corner_bar) = match self.difficulty {
            Difficulty::Clean => (Some(0.03), Some(0.05)),
            Difficulty::Rough => (Some(0.10), Some(0.15)),
            Difficulty::Hard | Difficulty::Papers => (None, None),
        };
        let centers_px = self.center_errors_px();
        let positions_mm: Vec<f64> = self.errors.iter().map(|error| mm_from_m(error.position_m)).collect();
        let radii_px: Vec<f64> = self.errors.iter().map(|error| error.radius_px).collect();
        let over_covariance = self.errors.iter().map(|error| error.over_covariance).sum::<f64>();
        let failures =
            CAUSES.iter().zip(&self.failures).map(|(cause, (n, _))| figure(cause, "1", *n as f64, Some(0.0)));
        let mut figures = vec![
            figure("centre rms", "px", rms(&centers_px), center_bar),
            figure("centre worst", "px", worst(&centers_px), None),
            figure("corner rms", "px", rms(&self.corner_errors_px), corner_bar),
            figure("corner worst", "px", worst(&self.corner_errors_px), None),
            figure("radius rms", "px", rms(&radii_px), None),
            figure("position rms", "mm", rms(&positions_mm), Some(0.05)),
            figure("position worst", "mm", worst(&positions_mm), None),
        ];
        figures.extend(failures);
        let source = "squared error of an axis over its variance, mean; 1 if honest";
        let over_covariance = over_covariance / self.errors.len() as f64;
        figures.push(Figure::alone(name("centre over covariance"), "1", over_covariance, source));
        figures.push(Figure::alone(name("parts in all"), "1", self.parts as f64, "rendered scenes"));
        figures
    }

    /// Seeds that need attention, one cause a line.
    pub fn notes(&self) -> Vec<String> {
        let faults = self.faults.iter().map(|(fault, seeds)| (fault.as_str(), seeds.as_slice()));
        let causes = CAUSES.into_iter().zip(&self.failures).map(|(cause, (_, seeds))| (cause, seeds.as_slice()));
        let causes = causes.skip(1).filter(|(_, seeds)| !seeds.is_empty());
        let line = |(cause, seeds): (&str, &[u64])| {
            let shown: Vec<String> = seeds.iter().take(MOST_SEEDS).map(u64::to_string).collect();
            let more = if seeds.len() > MOST_SEEDS { ", ..." } else { "" };
            let (difficulty, all, few) = (self.difficulty, self.scenes, shown.join(", "));
            format!("{difficulty}: {cause}: {} of {all} scenes, seeds {few}{more}", seeds.len())
        };
        let worst =
            self.worst_center.map(|(px, seed)| format!("{}: worst centre: {px:.3} px, seed {seed}", self.difficulty));
        faults.chain(causes).map(line).chain(worst).collect()
    }
}

fn worst(errors: &[f64]) -> f64 {
    errors.iter().copied().fold(f64::NAN, f64::max)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::vision::verdicts::PartsVerdict;
    use upm_perception::vision::TableFault;

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
            let parts = PartsVerdict { errors, missed, invented: 0, misnamed: 1 };
            TableVerdict::Found { corner_errors_px: [0.1; 4], parts }
        };
        let tables = [
            found(&[0.3], 0),
            TableVerdict::NotFound(TableFault::NotASquare),
            TableVerdict::Misplaced,
            found(&[0.4], 2),
        ];
        let verdicts: Vec<SceneVerdict> =
            tables.into_iter().zip(7..).map(|(table, seed)| SceneVerdict { seed, parts: 3, table }).collect();
        let verdict_counts = VerdictCounts::new(Difficulty::Rough, &verdicts);
        let figures = verdict_counts.figures();
        let figure = |name: &str| figures.iter().find(|figure| figure.name == format!("rough: {name}")).unwrap();
        for (name, expected) in [
            ("centre rms", (0.125f64).sqrt()),
            ("centre worst", 0.4),
            ("corner rms", 0.1),
            ("radius rms", (0.125f64).sqrt()),
            ("position rms", (0.125f64).sqrt()),
            ("parts missed", 2.0),
            ("parts invented", 0.0),
            ("parts misnamed", 2.0),
            ("tables not found", 1.0),
            ("tables misplaced", 1.0),
            ("parts in all", 12.0),
            ("centre over covariance", 2.0),
        ] {
            assert!((figure(name).measured - expected).abs() < 1e-12, "{name}: {}", figure(name).measured);
        }
        assert_eq!(figure("centre rms").source, "bar 0.1 px; rendered scenes");
        assert_eq!(
            verdict_counts.notes(),
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
