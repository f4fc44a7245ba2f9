//! The Coulomb pump: mean friction against speed, equilibrium speed of the general wave, a part's approach to the
//! belt's speed, and a disc's friction, each against its closed form; and the acceleration at which parts of this rig
//! begin to slide.

use std::f64::consts::TAU;

use super::pumped::{FAINT, PUMP, PumpedLine, sliding_threshold};
use super::sweep::Progress;
use super::texts::{chart, figure, figures};
use super::{ExperimentResult, LabError, LabRig, coulomb_pump, disc_friction, general_wave};
use upm_chart::{Chart, Color};
use upm_core::units::GRAVITY_MPS2;
use upm_sim::PartParams;

/// Number of speeds at which the mean force is measured, from rest to the belt's.
const SPEEDS: u32 = 20;
/// Steps of a cycle for a force: one step on the wrong side of the plate's speed is 2e-5 of μ m g.
const FORCE_STEPS: u32 = 100_000;

/// Amplitude of the plate's acceleration `A w`, g (Appendix A). The paper's friction and frequency, 0.3 and 60 Hz, are
/// those of the shipped rigs.
const PEAK_G: f64 = 2.0;
/// Factor on the rig's frequency over its friction: a part's speed then changes within a cycle by less than 1 % of the
/// belt's; and a factor on that for the force at rest.
const FASTER: f64 = 100.0 / 0.3;
const STILL_FASTER: f64 = 10.0;
const BELT_STEPS: u32 = 2_000;
/// Duration of the approach, in time constants.
const APPROACH: f64 = 3.0;

/// Mean friction force against speed and the viscous approach in the limit of fast vibration, the acceleration at which
/// the rig's parts begin to slide, and the friction of a disc that spins.
///
/// # Errors
///
/// [`LabError::Rig`] unless friction, base frequency and time step are positive numbers.
pub fn force_curve(rig: &LabRig, _: Progress<'_>) -> Result<ExperimentResult, LabError> {
    if ![rig.penny.friction, rig.model.base_radps, rig.sim.step_s].iter().all(|v| v.is_finite() && *v > 0.0) {
        return Err(LabError::Rig("friction, base frequency and time step must be positive".to_owned()));
    }
    let mut outcome = ExperimentResult::default();
    report_forces(rig, &mut outcome);
    general_wave::report(rig, &mut outcome);
    report_approach(rig, &mut outcome);
    disc_friction::report(&mut outcome);
    let threshold = sliding_threshold(rig.penny, rig.model.base_radps, rig.sim.step_s);
    let slides = figure("plate acceleration A w from which this rig's part slides", threshold);
    outcome.figures.push(slides.with(Some(1.0 / coulomb_pump::peak_acceleration())));
    outcome.notes.push("figures in units of μ m g, μ g, f0, A or 1 do not depend on friction and base_hz".into());
    Ok(outcome)
}

fn report_forces(rig: &LabRig, outcome: &mut ExperimentResult) {
    let line = PumpedLine { amplitude_mps: 1.0, base_radps: rig.model.base_radps, second: PUMP, steps: FORCE_STEPS };
    let part = PartParams { friction: FAINT, ..rig.penny };
    let at = |i: u32| coulomb_pump::BELT * f64::from(i) / f64::from(SPEEDS - 1);
    let rows: Vec<[f64; 3]> =
        (0..SPEEDS).map(at).map(|u| [u, line.mean_force(part, u), coulomb_pump::mean_force(u)]).collect();

    let at_rest = coulomb_pump::mean_force(0.0);
    let (slower, belt) = rows.split_at(rows.len() - 1);
    let worst = slower.iter().map(|[_, force, exact]| (force / exact - 1.0).abs()).max_by(f64::total_cmp);
    // The closed form is zero at the belt's speed: errors there are relative to f0.
    let at_belt = belt.iter().map(|[_, force, exact]| (force - exact).abs() / at_rest).fold(0.0, f64::max);
    let [force_at_rest, others @ ..] = figures([
        ("mean force on a part at rest, f0", rows[0][1]),
        ("relative deviation of the mean force, largest", worst.unwrap_or(f64::NAN)),
        ("deviation of the mean force at A/2", at_belt),
    ]);
    outcome.figures.push(force_at_rest.with(Some(at_rest)));
    outcome.figures.extend(others);
    outcome.charts.push(force_chart(&rows));
}

fn force_chart(rows: &[[f64; 3]]) -> Chart {
    const CURVE: u32 = 200;
    let curve = (0..=CURVE).map(|i| coulomb_pump::BELT * f64::from(i) / f64::from(CURVE));
    let belt = [[0.0, coulomb_pump::mean_force(0.0)], [coulomb_pump::BELT, 0.0]];
    chart("force-curve")
        .dashes("viscous belt (Eq. 19)", Color::Gray, belt)
        .line("closed form (Eq. 18)", Color::Blue, curve.map(|u| [u, coulomb_pump::mean_force(u)]))
        .dots("simulated", Color::Orange, rows.iter().map(|row| [row[0], row[1]]))
}

/// A part's speed from rest, simulated on the paper's belt and in closed form, at the same instants.
struct Approach {
    t_s: Vec<f64>,
    speed_mps: Vec<f64>,
    exact_mps: Vec<f64>,
    belt_mps: f64,
}

impl Approach {
    /// Simulates and evaluates in closed form; `μ g / A` of `line` and `part` is the scale of rates.
    fn of(line: &PumpedLine, part: PartParams, rate_hz: f64) -> Self {
        let duration_s = APPROACH / (2.0 * coulomb_pump::mean_force(0.0) * rate_hz);
        let cycles = (duration_s / line.cycle_s()).ceil() as u32;
        let speed_mps: Vec<f64> = line.states(part, 0.0, cycles).into_iter().map(|[_, speed_mps]| speed_mps).collect();
        let exact = coulomb_pump::speeds(line.cycle_s() * rate_hz, speed_mps.len());
        let exact_mps = exact.into_iter().map(|u| u * line.amplitude_mps).collect();
        let t_s = (0..=cycles).map(|i| f64::from(i) * line.cycle_s()).collect();
        Self { t_s, speed_mps, exact_mps, belt_mps: coulomb_pump::BELT * line.amplitude_mps }
    }

    /// Time at which the part reaches 1 - 1/e of the belt's speed, s; linear interpolation between the cycles.
    fn rise_s(&self) -> f64 {
        let wanted = rise() * self.belt_mps;
        let steps = self.t_s.windows(2).zip(self.speed_mps.windows(2));
        let Some((&[from, to], &[before, after])) = steps.into_iter().find(|(_, speeds)| speeds[1] >= wanted) else {
            return f64::NAN;
        };
        from + (to - from) * (wanted - before) / (after - before)
    }

    /// Largest deviation from the closed form, as a fraction of the belt's speed.
    fn deviation(&self) -> f64 {
        let pairs = self.speed_mps.iter().zip(&self.exact_mps);
        pairs.map(|(speed, exact)| (speed - exact).abs()).max_by(f64::total_cmp).unwrap_or(f64::NAN) / self.belt_mps
    }
}

/// Fraction of the belt's speed that a viscous belt gives in one time constant.
fn rise() -> f64 {
    1.0 - (-1.0f64).exp()
}

/// Adds the approach to the belt's speed in the limit of fast vibration. The force is above the viscous belt's straight
/// line, so that parts reach 1 - 1/e of the belt's speed sooner than in 1/k2: the time is compared with the closed-form
/// force integrated, not with the exponential.
fn report_approach(rig: &LabRig, outcome: &mut ExperimentResult) {
    let (part, friction, hz) = (rig.penny, rig.penny.friction, rig.model.base_radps / TAU);
    let amplitude_mps = PEAK_G * GRAVITY_MPS2 / rig.model.base_radps;
    let base_radps = rig.model.base_radps * FASTER * friction;
    let line = PumpedLine { amplitude_mps, base_radps, second: PUMP, steps: BELT_STEPS };
    let rate_hz = friction * GRAVITY_MPS2 / amplitude_mps;

    // The slope over the first cycle, in which the speed stays near zero.
    let first = PumpedLine { steps: FORCE_STEPS, base_radps: STILL_FASTER * base_radps, ..line };
    let slope = first.mean_force(part, 0.0);
    let (k2, exact_k2) = (2.0 * slope * rate_hz, 2.0 * coulomb_pump::mean_force(0.0) * rate_hz);
    let approach = Approach::of(&line, part, rate_hz);
    let exact_rise_s = coulomb_pump::time_to(rise() * coulomb_pump::BELT) / rate_hz;
    let setting = format!("μ {friction}, A = {PEAK_G} g/w, w of {hz:.0} Hz");
    let found = [
        figure("initial rate k2", k2).with(Some(exact_k2)),
        figure("initial time constant 1/k2", 1e3 / k2).with(Some(1e3 / exact_k2)),
        figure("time to 1 - 1/e of A/2", 1e3 * approach.rise_s()).with(Some(1e3 * exact_rise_s)),
        figure("deviation of speed against time, largest", approach.deviation()),
    ];
    outcome.figures.extend(found.map(|figure| figure.of(&setting)));
    outcome.charts.push(approach_chart(&approach, exact_k2));
}

fn approach_chart(approach: &Approach, k2: f64) -> Chart {
    const DOTS: usize = 25;
    let mm = |values: &[f64]| approach.t_s.iter().zip(values).map(|(t, v)| [1e3 * t, 1e3 * v]).collect::<Vec<_>>();
    let exponential: Vec<f64> = approach.t_s.iter().map(|t| approach.belt_mps * (1.0 - (-k2 * t).exp())).collect();
    let every = (approach.t_s.len() / DOTS).max(1);
    let dots = mm(&approach.speed_mps).into_iter().step_by(every);
    chart("force-curve-approach")
        .dashes("viscous belt (Eq. 20)", Color::Gray, mm(&exponential))
        .line("closed-form force, integrated", Color::Blue, mm(&approach.exact_mps))
        .dots("simulated", Color::Orange, dots)
}

#[cfg(test)]
mod tests {
    use super::super::testing::{assert_sources_are_short, curve, lab_rig};
    use super::*;

    fn figure<'a>(outcome: &'a ExperimentResult, name: &str) -> &'a crate::Figure {
        outcome.figures.iter().find(|figure| figure.name == name).unwrap()
    }

    #[test]
    fn force_approach_disc_and_threshold_are_those_of_the_closed_forms() {
        let outcome = force_curve(&lab_rig("upm-1"), &|_| ()).unwrap();
        let below = |name: &str, bar: f64| {
            let measured = figure(&outcome, name).measured;
            assert!(measured < bar, "{name}: {measured}");
        };
        below("relative deviation of the mean force, largest", 0.01);
        below("deviation of the mean force at A/2", 0.01);
        below("relative deviation of a disc's force, largest", 0.005);
        below("relative deviation of a disc's torque, largest", 0.005);
        below("deviation of speed against time, largest", 0.01);
        let near = |name: &str, bar: f64| {
            let error = figure(&outcome, name).relative_error().unwrap();
            assert!(error.abs() < bar, "{name}: {error}");
        };
        near("mean force on a part at rest, f0", 0.01);
        near("initial rate k2", 0.001);
        near("time to 1 - 1/e of A/2", 0.001);
        near("plate acceleration A w from which this rig's part slides", 0.001);
        let paper_f0 = 0.24;
        assert!((figure(&outcome, "mean force on a part at rest, f0").measured / paper_f0 - 1.0).abs() < 0.01);
        assert_sources_are_short(&outcome);
        let forces = curve(&outcome, "force-curve", "simulated");
        assert_eq!(forces.len(), 20);
        assert!(forces.is_sorted_by(|a, b| a[1] > b[1]), "falls with speed");
    }

    #[test]
    fn settings_move_the_approach_and_its_closed_form() {
        let mut rig = lab_rig("upm-1");
        (rig.penny.friction, rig.model.base_radps) = (0.6, 2.0 * TAU * 60.0);
        let [usual, set] = [lab_rig("upm-1"), rig].map(|rig| {
            let mut outcome = ExperimentResult::default();
            report_approach(&rig, &mut outcome);
            outcome
        });
        for name in ["initial rate k2", "time to 1 - 1/e of A/2"] {
            let ratio = figure(&set, name).measured / figure(&usual, name).measured;
            let exact = if name.starts_with("initial") { 4.0 } else { 0.25 };
            assert!((ratio / exact - 1.0).abs() < 0.001, "{name}: {ratio}");
            assert!(figure(&set, name).relative_error().unwrap().abs() < 0.001, "{name}");
        }
    }
}
