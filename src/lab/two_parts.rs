//! Two parts, four centres of rotation (UPM paper, Fig. 3 and Eqs. 1 to 3): how far one large step misses its goals, and
//! how the miss falls when the same step is taken in several looks.
//!
//! First in the ideal field, which parts follow exactly; then on a plate with motors strong enough for it, whose motion is
//! prescribed; then on the rig's own plate, as strongly as its motors can. The paper prints no figures.

mod machine;
mod plan;
mod report;

use self::machine::Machine;
use self::plan::{CENTERS, Places, condition, distances, field_matrix, flow, mean_miss};
use super::pulses::strongest_spin;
use super::{LabFault, LabRig, Outcome};
use upm_core::geometry::Vec2;
use upm_sim::PlateMode;

/// Corners of the workspace, in half sides of the plate: counter-clockwise from the upper left, in the order of rotation.
const CORNERS: [[f64; 2]; CENTERS] = [[-1.0, 1.0], [-1.0, -1.0], [1.0, -1.0], [1.0, 1.0]];
/// Starts and goals, in half sides of the plate; the steps are large on purpose, as in the paper.
const STARTS: [[f64; 2]; 2] = [[-0.26, -0.19], [0.49, 0.0]];
const GOALS: [[f64; 2]; 2] = [[-0.6, -0.11], [0.3, -0.29]];
/// Looks into which the step is split.
const LOOKS: [usize; 4] = [1, 2, 4, 8];
/// Spin of a plate with strong motors, rad/s: parts then stay slow against the belt, all over the workspace.
const STRONG_SPIN_RADPS: f64 = 8.0;

/// The problem on a plate of this size.
struct Task {
    half_side_m: f64,
    centers_m: [Vec2; CENTERS],
    starts_m: Places,
    goals_m: Places,
}

impl Task {
    fn on(rig: &LabRig) -> Self {
        let half_side_m = 0.5 * rig.sim.plate.side_m;
        let scaled = |[x, y]: [f64; 2]| Vec2::new(x, y) * half_side_m;
        Self { half_side_m, centers_m: CORNERS.map(scaled), starts_m: STARTS.map(scaled), goals_m: GOALS.map(scaled) }
    }

    /// Where the parts shall be after `done` of `looks` looks: on straight lines to their goals.
    fn waypoints_m(&self, done: usize, looks: usize) -> Places {
        let share = done as f64 / looks as f64;
        std::array::from_fn(|i| self.starts_m[i] + (self.goals_m[i] - self.starts_m[i]) * share)
    }

    /// Splits the step into `looks` looks; at each, solves for d where the parts are and rotates them by it with `rotate`,
    /// centre after centre.
    fn go(
        &self,
        looks: usize,
        mut rotate: impl FnMut(&Places, usize, f64) -> Result<Vec<Places>, LabFault>,
    ) -> Result<Way, LabFault> {
        let mut at = self.starts_m;
        let mut way = Way { corners: vec![at], samples: Vec::new(), miss_m: f64::NAN };
        for look in 1..=looks {
            let wanted = self.waypoints_m(look, looks);
            let d_m = distances(&self.centers_m, &at, &wanted).ok_or_else(|| self.singular(&at))?;
            for (center, &d) in d_m.iter().enumerate() {
                let samples = rotate(&at, center, d)?;
                at = samples.last().copied().unwrap_or(at);
                way.corners.push(at);
                way.samples.extend(samples);
            }
        }
        way.miss_m = mean_miss(&at, &self.goals_m);
        Ok(way)
    }

    fn singular(&self, at: &Places) -> LabFault {
        let [a, b] = at.map(|part| part * 1e3);
        let number = condition(&field_matrix(&self.centers_m, at));
        LabFault::Rig(format!(
            "fields dependent at ({:.0}, {:.0}), ({:.0}, {:.0}) mm: condition number {number:.0e}",
            a.x, a.y, b.x, b.y
        ))
    }
}

/// The way the parts went.
struct Way {
    /// Where the parts were at first and after each rotation.
    corners: Vec<Places>,
    /// Where they were at each sample of the simulation.
    samples: Vec<Places>,
    /// E at the end, m.
    miss_m: f64,
}

/// One mover, the step in 1, 2, 4 and 8 looks.
struct Runs {
    name: &'static str,
    /// Looks and the way they led.
    ways: Vec<(usize, Way)>,
    /// Looks that led nowhere, and why: a part fell, or the four fields became dependent.
    failed: Vec<(usize, LabFault)>,
}

impl Runs {
    fn of(
        name: &'static str,
        task: &Task,
        rotate: impl Fn(&Places, usize, f64) -> Result<Vec<Places>, LabFault>,
    ) -> Self {
        let mut runs = Self { name, ways: Vec::new(), failed: Vec::new() };
        for looks in LOOKS {
            match task.go(looks, &rotate) {
                Ok(way) => runs.ways.push((looks, way)),
                Err(fault) => runs.failed.push((looks, fault)),
            }
        }
        runs
    }

    /// E after `looks` looks, m.
    fn miss_m(&self, looks: usize) -> Option<f64> {
        self.ways.iter().find(|(of, _)| *of == looks).map(|(_, way)| way.miss_m)
    }

    /// The way of the fewest looks.
    fn first(&self) -> Option<&Way> {
        self.ways.first().map(|(_, way)| way)
    }
}

/// Takes one large step with two parts about four centres, then the same in more looks: in the ideal field, on a plate
/// with strong motors and on the rig's own.
pub fn two_parts(rig: &LabRig) -> Result<Outcome, LabFault> {
    let task = Task::on(rig);
    let exactly =
        |parts: &Places, center: usize, d: f64| Ok(vec![parts.map(|part| flow(task.centers_m[center], part, d))]);
    let d_m = distances(&task.centers_m, &task.starts_m, &task.goals_m);
    let d_m = d_m.ok_or_else(|| task.singular(&task.starts_m))?;
    let ideal = Runs::of("ideal field", &task, exactly);
    if let Some((_, fault)) = ideal.failed.first() {
        return Err(fault.clone());
    }

    let middle_m = Vec2::zeros();
    let strong = [STRONG_SPIN_RADPS; CENTERS];
    let kinematic = Machine::calibrated(rig, PlateMode::Kinematic, task.centers_m, strong, middle_m)?;
    let strong = Runs::of("strong plate", &task, |parts, center, d| kinematic.rotate(parts, center, d));

    let mut spin_radps = [0.0; CENTERS];
    for (spin, center) in spin_radps.iter_mut().zip(task.centers_m) {
        *spin = strongest_spin(rig, center)?;
    }
    let dynamic = Machine::calibrated(rig, PlateMode::Dynamic, task.centers_m, spin_radps, middle_m)?;
    let own = Runs::of("rig's plate", &task, |parts, center, d| dynamic.rotate(parts, center, d));

    let shortest_m = [&kinematic, &dynamic].map(Machine::shortest_m);
    let saturation = [&kinematic, &dynamic].map(|machine| machine.saturation(middle_m));
    let asides = report::Asides { d_m, spin_radps, shortest_m, saturation };
    Ok(report::outcome(rig, &task, &[ideal, strong, own], &asides))
}

#[cfg(test)]
mod tests {
    use super::super::testing::{assert_sources_are_short, lab_rig};
    use super::plan::flow_in_steps;
    use super::*;

    fn series(outcome: &Outcome, name: &str) -> Vec<f64> {
        outcome.series.iter().find(|series| series.name == name).unwrap().values.clone()
    }

    fn figure(outcome: &Outcome, name: &str) -> f64 {
        outcome.figures.iter().find(|figure| figure.name == name).unwrap().measured
    }

    #[test]
    fn the_miss_falls_with_looks_where_motors_are_strong() {
        let outcome = two_parts(&lab_rig("upm-2")).unwrap();
        let order = figure(&outcome, "order at which E falls with looks, ideal field");
        assert!((order - 2.0).abs() < 0.1, "{order}");
        for mover in ["ideal_field", "strong_plate", "rigs_plate"] {
            assert_eq!(series(&outcome, &format!("{mover}_looks")), [1.0, 2.0, 4.0, 8.0]);
            let misses = series(&outcome, &format!("{mover}_miss_m"));
            assert!(misses.is_sorted_by(|a, b| a > b), "{mover}: {misses:?}");
            assert!(misses[3] < 0.1 * misses[0], "{mover}: {misses:?}");
        }
        let motion = outcome.motion.unwrap();
        assert!(motion.tracks.iter().all(|track| track.places_m.len() == motion.t_s.len()));
    }

    #[test]
    fn one_look_in_the_ideal_field_is_the_field_integrated() {
        let rig = lab_rig("upm-1");
        let task = Task::on(&rig);
        let rotate = |parts: &Places, center: usize, d: f64| {
            Ok(vec![parts.map(|part| flow_in_steps(task.centers_m[center], part, d))])
        };
        let integrated_mm = 1e3 * task.go(1, rotate).unwrap().miss_m;
        let measured_mm = figure(&two_parts(&rig).unwrap(), "E of 1 look, ideal field");
        assert!((measured_mm / integrated_mm - 1.0).abs() < 1e-6, "{measured_mm} {integrated_mm}");
    }

    #[test]
    fn weak_motors_lose_what_strong_ones_keep() {
        let outcome = two_parts(&lab_rig("upm-1")).unwrap();
        assert!(figure(&outcome, "saturation, strong plate") < 0.5);
        assert!(figure(&outcome, "saturation, rig's plate") > 1.0);
        let strong = series(&outcome, "strong_plate_miss_m");
        assert!(strong.len() == 4 && strong.is_sorted_by(|a, b| a > b), "{strong:?}");
        let own = series(&outcome, "rigs_plate_miss_m");
        assert!(own.iter().zip(&strong).all(|(own, strong)| own > strong), "{own:?}");
        let failed = outcome.figures.iter().filter(|figure| figure.name == "failed try, rig's plate").count();
        assert_eq!(own.len() + failed, LOOKS.len());
        let looks = outcome.charts.iter().find(|chart| chart.name == "two-parts-looks").unwrap();
        let legend =
            |name: &str| looks.layers.iter().find(|layer| layer.label.starts_with(name)).unwrap().label.clone();
        assert_eq!(legend("strong plate"), "strong plate");
        assert_eq!(legend("rig's plate").contains("failed"), failed > 0);
        assert_sources_are_short(&outcome);
    }
}
