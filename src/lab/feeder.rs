//! The longitudinally vibrating feeder (Reznik and Canny, "Design verification and optimization of novel parts feeders
//! with the Impulse dynamic simulator", section III): a plate shaken along one line carries a part by friction alone.
//!
//! The part is a point: a block that cannot turn about the vertical has the same friction wherever its pressure is.

mod part;
mod plate;
mod published;

use self::part::{Sliding, quasi_static_mps, viscosity_nspm};
use self::plate::PlateCycle;
pub use self::published::reproduce;
use super::settings::{Field, Setting, settings};
use super::sweep::Progress;
use super::texts::{figure, figures};
use super::{ExperimentResult, Figure, LabError};
use upm_core::units::{GRAVITY_MPS2, mm_from_m};

/// A dyne, N.
const DYN_N: f64 = 1e-5;
/// A plate and the part on it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Feeder {
    plate: PlateCycle,
    friction: f64,
    mass_kg: f64,
    force_n: f64,
}

/// Parameters of a feeder.
pub const SETTINGS: &[Setting<Feeder>] = settings! {
    "accel_mps2", [1e-3, 1e6], 1.0, plate.accel_mps2, "acceleration of the plate";
    "period_ms", [1e-3, 1e5], 1e-3, plate.period_s, "length of a cycle";
    "duty", [0.5, 1.0], 1.0, plate.duty, "share of the cycle in which the plate moves forwards";
    "friction", [1e-4, 10.0], 1.0, friction, "Coulomb friction between part and plate";
    "mass_g", [1e-6, 1e6], 1e-3, mass_kg, "mass of the part";
    "force_dyn", [-1e6, 1e6], DYN_N, force_n, "external force along the feed";
};

impl Feeder {
    /// The paper's device at its optimal duty (section III-C.1).
    pub fn published() -> Self {
        let plate = PlateCycle { accel_mps2: 150.0, period_s: 0.02, duty: 0.586 };
        Self { plate, friction: 1.0, mass_kg: 1e-4, force_n: 0.0 }
    }

    fn sliding(&self) -> Sliding {
        Sliding { drag_mps2: self.friction * GRAVITY_MPS2, push_mps2: self.force_n / self.mass_kg }
    }
}

/// The feed rate of one feeder, compared with the closed form where there is one.
///
/// # Errors
///
/// A feeder outside the model: a part that sticks to the plate, or one that a force carries away.
pub fn measure(feeder: &Feeder, _: Progress<'_>) -> Result<ExperimentResult, LabError> {
    let Feeder { plate, friction, mass_kg, force_n } = *feeder;
    let sliding = feeder.sliding();
    let Sliding { drag_mps2, push_mps2 } = sliding;
    if plate.accel_mps2 <= drag_mps2 {
        let (least, found) = (format!("{drag_mps2:.3} (friction times gravity)"), plate.accel_mps2);
        return Err(LabError::Setting(format!(
            "accel_mps2: expected more than {least}, found {found}: the part sticks"
        )));
    }
    if push_mps2.abs() >= drag_mps2 {
        return Err(LabError::Setting(format!(
            "force_dyn: expected less than {:.3} (friction times weight), found {:.3}: the force carries the part away",
            drag_mps2 * mass_kg / DYN_N,
            force_n / DYN_N
        )));
    }
    let cycle = sliding.settled(&plate)?;
    let rate_mps = cycle.way_m / plate.period_s;
    let viscosity = viscosity_nspm(&plate, friction, mass_kg);
    let saturation = sliding.saturation(plate.accel_mps2);
    let (is_forced, saturates) = (force_n != 0.0, plate.duty > saturation);
    let source = match (is_forced, saturates) {
        (false, false) => "Impulse paper, Eq. 3",
        (true, false) => "Impulse paper, Eqs. 3 and 4",
        (false, true) => "Impulse paper, Eq. 7",
        (true, true) => "as Impulse paper, Eq. 7, with the force",
    };
    let exact_mps = sliding.rate_mps(&plate);
    let rate = Figure::alone("feed rate", "mm/s", mm_from_m(rate_mps), source).with(exact_mps.map(mm_from_m));
    let others = figures([
        ("quasi-static feed rate", mm_from_m(quasi_static_mps(&plate))),
        ("duty at which the part saturates", saturation),
        ("viscosity K", viscosity / (DYN_N / 0.01)),
    ]);
    let peak_source = "(a T/2)(d - sqrt(2 d - 1))";
    let ends = [
        Figure::alone("largest speed of the plate", "mm/s", mm_from_m(plate.peak_mps()), peak_source),
        figure("stroke of the plate", mm_from_m(plate.stroke_m())),
    ];
    let figures = [rate].into_iter().chain(others).chain(ends).collect();
    let mut notes = Vec::new();
    if exact_mps.is_none() {
        let flank = "no closed form: the part rides along on a flank of the plate's velocity";
        notes.push(format!("{flank} up to accel_mps2 = {:.3}", sliding.least_accel_mps2()));
    } else if is_forced && saturates {
        let end = format!("duty = {saturation:.4}, where the part saturates");
        notes.push(format!("K describes the rate under this force up to {end}"));
    }
    Ok(ExperimentResult { figures, notes, ..ExperimentResult::default() })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::settings::{assigned, assignment};
    use rand::RngExt;
    use upm_core::random::Streams;

    fn set(text: &str) -> Result<ExperimentResult, LabError> {
        let assignments: Vec<_> = text.split_whitespace().map(|one| assignment(one).unwrap()).collect();
        measure(&assigned(SETTINGS, &Feeder::published(), &assignments)?, &|_| ())
    }

    #[test]
    fn rate_has_a_reference_wherever_a_closed_form_holds_and_notes_say_where_it_ends() {
        for (text, notes) in [
            ("duty=0.55", 0),
            ("duty=0.9", 0),
            ("duty=0.55 force_dyn=5", 0),
            ("duty=0.9 force_dyn=5", 1),
            ("duty=0.53 friction=0.5 accel_mps2=100 period_ms=10 force_dyn=45", 1),
        ] {
            let outcome = set(text).unwrap();
            assert!(outcome.figures[0].relative_error().unwrap().abs() < 1e-4, "{text}: {:?}", outcome.figures[0]);
            assert_eq!(outcome.notes.len(), notes, "{text}: {:?}", outcome.notes);
        }
        let riding = set("accel_mps2=12 force_dyn=50").unwrap();
        assert_eq!(riding.figures[0].reference, None);
        assert!(riding.notes[0].ends_with("up to accel_mps2 = 14.807"), "{:?}", riding.notes);
    }

    /// Rate of a part that is stepped in time, its plate's velocity a straight line in each step: friction acts against
    /// the slip, and from the moment when that vanishes removes it as far as μ g suffices.
    fn stepped_rate_mps(feeder: &Feeder) -> f64 {
        const STEPS: usize = 100;
        let Feeder { plate: PlateCycle { accel_mps2, period_s, duty }, friction, mass_kg, force_n } = *feeder;
        let (drag_mps2, push_mps2) = (friction * GRAVITY_MPS2, force_n / mass_kg);
        let forwards_s = duty * period_s;
        let flank_s = 0.5 * (forwards_s - period_s * (2.0 * duty - 1.0).sqrt());
        let (top, bottom) = (accel_mps2 * flank_s, -0.5 * accel_mps2 * (period_s - forwards_s));
        let corners = [
            [0.0, 0.0],
            [flank_s, top],
            [forwards_s - flank_s, top],
            [0.5 * (forwards_s + period_s), bottom],
            [period_s, 0.0],
        ];
        let between = |from: [f64; 2], to: [f64; 2], i: usize| {
            [0, 1].map(|axis| from[axis] + (to[axis] - from[axis]) * i as f64 / STEPS as f64)
        };
        let steps: Vec<[[f64; 2]; 2]> = corners
            .windows(2)
            .flat_map(|pair| (0..STEPS).map(move |i| [i, i + 1].map(|i| between(pair[0], pair[1], i))))
            .collect();
        let mut speed_mps = 0.0;
        for _ in 0..20_000 {
            let (from_mps, mut way_m) = (speed_mps, 0.0);
            for [[from_s, from_mps], [to_s, to_mps]] in &steps {
                let (step_s, slip_mps) = (to_s - from_s, from_mps - speed_mps);
                let slope = (to_mps - from_mps) / step_s;
                let sliding = push_mps2 + drag_mps2.copysign(slip_mps);
                let meets_s = slip_mps / (sliding - slope);
                let first_s = if meets_s < 0.0 { step_s } else { meets_s.min(step_s) };
                let held = push_mps2 + (slope - push_mps2).clamp(-drag_mps2, drag_mps2);
                for (accel, time_s) in [(sliding, first_s), (held, step_s - first_s)] {
                    way_m += (speed_mps + 0.5 * accel * time_s) * time_s;
                    speed_mps += accel * time_s;
                }
            }
            if (speed_mps - from_mps).abs() < 1e-10 * accel_mps2 * period_s {
                return way_m / period_s;
            }
        }
        f64::NAN
    }

    #[test]
    #[expect(clippy::print_stdout, reason = "the table, with --nocapture")]
    fn references_of_forty_random_feeders_are_those_of_time_steps() {
        let mut rng = Streams::new(43).stream("feeders");
        let (mut compared, mut worst) = (0, 0.0f64);
        for i in 0..40 {
            let accel_mps2 = 10f64.powf(rng.random_range(0.5..3.0));
            let plate =
                PlateCycle { accel_mps2, period_s: rng.random_range(1e-3..0.1), duty: rng.random_range(0.5..0.98) };
            let friction = (accel_mps2 / GRAVITY_MPS2 * 10f64.powf(rng.random_range(-1.5..-0.02))).min(10.0);
            let mass_kg = 10f64.powf(rng.random_range(-5.0..-2.0));
            let share = if i % 4 == 0 { 0.0 } else { rng.random_range(-0.95..0.95) };
            let feeder = Feeder { plate, friction, mass_kg, force_n: share * friction * GRAVITY_MPS2 * mass_kg };
            let outcome = measure(&feeder, &|_| ()).unwrap();
            let Some(reference) = outcome.figures[0].reference else {
                assert!(outcome.notes[0].starts_with("no closed form"), "{feeder:?}");
                continue;
            };
            let stepped = mm_from_m(stepped_rate_mps(&feeder));
            println!("{i:2} {:?} {share:+.2}: {reference:.4} {stepped:.4} mm/s", plate);
            (compared, worst) = (compared + 1, worst.max((stepped / reference - 1.0).abs()));
        }
        println!("{compared} compared, largest error {worst:.1e}");
        assert!(compared >= 25 && worst < 1e-3, "{compared} {worst}");
    }
}
