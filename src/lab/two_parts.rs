//! Two parts, four centres of rotation (UPM paper, Fig. 3 and Eqs. 1 to 3): distance by which one large step misses its
//! goals, and its decrease when the same step is split into several, each planned from a new observation.
//!
//! First in the ideal field, which parts follow exactly; then on a plate with sufficiently strong motors, whose motion
//! is prescribed; then on the rig's own plate, as strongly as its motors can. The paper prints no figures.

mod calibrated_pulses;
mod plan;
mod report;
mod task;

use self::calibrated_pulses::{CalibratedPulses, STRONG_SPIN_RADPS};
use self::plan::{CENTERS, PartPositions, flow};
use self::task::{StepSeries, TwoPartProblem};
use super::pulses::strongest_spin;
use super::sweep::Progress;
use super::{ExperimentResult, LabError, LabRig};
use upm_core::job::PlateMode;

/// Makes one large step with two parts about four centres, then the same in more observations: in the ideal field, on a
/// plate with strong motors and on the rig's own.
///
/// # Errors
///
/// [`LabError::Rig`] when the four fields are dependent, when parts stick or creep backwards, when longer pulses do not
/// carry a part further, and when the rig's figures give no valid pulse. A step that fails on a plate is a figure.
pub fn two_parts(rig: &LabRig, _: Progress<'_>) -> Result<ExperimentResult, LabError> {
    let task = TwoPartProblem::on(rig);
    let exactly =
        |parts: &PartPositions, center: usize, d: f64| Ok(parts.map(|part| flow(task.centers_m[center], part, d)));
    let ideal = StepSeries::of("ideal field", &task, exactly);
    if let Some((_, fault)) = ideal.failed.first() {
        return Err(fault.clone());
    }

    let strong = [STRONG_SPIN_RADPS; CENTERS];
    let kinematic = CalibratedPulses::calibrated(rig, PlateMode::Kinematic, task.centers_m, strong)?;
    let strong = StepSeries::of("strong plate", &task, |parts, center, d| kinematic.rotate(parts, center, d));

    let mut spin_radps = [0.0; CENTERS];
    for (spin, center) in spin_radps.iter_mut().zip(task.centers_m) {
        *spin = strongest_spin(rig, center)?;
    }
    let dynamic = CalibratedPulses::calibrated(rig, PlateMode::Dynamic, task.centers_m, spin_radps)?;
    let own = StepSeries::of("rig's plate", &task, |parts, center, d| dynamic.rotate(parts, center, d));

    Ok(report::outcome(&task, [&ideal, &strong, &own], [&kinematic, &dynamic]))
}

#[cfg(test)]
mod tests {
    use super::super::testing::{assert_sources_are_short, lab_rig, measured};
    use super::plan::tests::flow_in_steps;
    use super::task::OBSERVATIONS;
    use super::*;

    /// The result on upm-1.
    fn weak() -> &'static ExperimentResult {
        static RESULT: std::sync::OnceLock<ExperimentResult> = std::sync::OnceLock::new();
        RESULT.get_or_init(|| two_parts(&lab_rig("upm-1"), &|_| ()).unwrap())
    }

    /// Observations and misses, mm, of a mover.
    fn misses(outcome: &ExperimentResult, mover: &str) -> [Vec<f64>; 2] {
        let chart = outcome.charts.iter().find(|chart| chart.name == "two-parts-observations").unwrap();
        let layer = chart.layers.iter().find(|layer| layer.label.starts_with(mover)).unwrap();
        [0, 1].map(|axis| layer.points.iter().map(|point| point[axis]).collect())
    }

    #[test]
    fn miss_falls_with_observations_where_motors_are_strong() {
        let outcome = two_parts(&lab_rig("upm-2"), &|_| ()).unwrap();
        let order = measured(&outcome, "order at which E falls with observations, ideal field");
        assert!((order - 2.0).abs() < 0.1, "{order}");
        for mover in ["ideal field", "strong plate", "rig's plate"] {
            let [observations, misses] = misses(&outcome, mover);
            assert_eq!(observations, [1.0, 2.0, 4.0, 8.0]);
            assert!(misses.is_sorted_by(|a, b| a > b), "{mover}: {misses:?}");
            assert!(misses[3] < 0.1 * misses[0], "{mover}: {misses:?}");
        }
    }

    #[test]
    fn one_observation_in_the_ideal_field_equals_the_integrated_field() {
        let rig = lab_rig("upm-1");
        let task = TwoPartProblem::on(&rig);
        let rotate = |parts: &PartPositions, center: usize, d: f64| {
            Ok(parts.map(|part| flow_in_steps(task.centers_m[center], part, d)))
        };
        let integrated_mm = 1e3 * task.go(1, rotate).unwrap().miss_m;
        let measured_mm = measured(weak(), "E of 1 observation, ideal field");
        assert!((measured_mm / integrated_mm - 1.0).abs() < 1e-6, "{measured_mm} {integrated_mm}");
    }

    #[test]
    fn weak_motors_miss_farther_than_strong_ones() {
        let outcome = weak();
        assert!(measured(outcome, "saturation, strong plate") < 0.5);
        assert!(measured(outcome, "saturation, rig's plate") > 1.0);
        let [_, strong] = misses(outcome, "strong plate");
        assert!(strong.len() == 4 && strong.is_sorted_by(|a, b| a > b), "{strong:?}");
        let [_, own] = misses(outcome, "rig's plate");
        assert!(own.iter().zip(&strong).all(|(own, strong)| own > strong), "{own:?}");
        let failed = outcome.figures.iter().filter(|figure| figure.name == "failed try, rig's plate").count();
        assert_eq!(own.len() + failed, OBSERVATIONS.len());
        assert_sources_are_short(outcome);
    }
}
