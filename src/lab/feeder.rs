//! The longitudinally vibrating feeder (Reznik and Canny, "Design verification and optimization of novel parts feeders
//! with the Impulse dynamic simulator", section III): a plate shaken along one line carries a part by friction alone.
//!
//! The part is a point: a block that cannot turn about the vertical has the same friction wherever its pressure is.

mod closed_form;
mod part;
mod plate;
mod published;

use self::closed_form::{feed_rate_mps, quasi_static_mps, saturation, viscosity_nspm};
use self::part::Sliding;
use self::plate::PlateCycle;
pub use self::published::reproduce;
use super::settings::Setting;
use super::sweep::Progress;
use super::{ExperimentResult, Figure, LabFault, Series};
use upm_chart::{Chart, Color, Layer, Mark};
use upm_core::units::{GRAVITY_MPS2, mm_from_m};

/// A dyne, N.
const DYN_N: f64 = 1e-5;
/// Duty above which the viscosity under ±15 dyn differs from the closed form: the force drives the part into
/// saturation.
const VISCOUS_BELOW: f64 = 0.55;

/// A plate and the part on it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Feeder {
    plate: PlateCycle,
    friction: f64,
    mass_kg: f64,
    force_n: f64,
}

/// Parameters of a feeder.
pub const SETTINGS: &[Setting<Feeder>] = &[
    Setting::<Feeder>::number("accel_mps2", [1e-3, 1e6], 1.0, |feeder| &mut feeder.plate.accel_mps2)
        .about("acceleration of the plate"),
    Setting::<Feeder>::number("period_ms", [1e-3, 1e5], 1e-3, |feeder| &mut feeder.plate.period_s)
        .about("length of a cycle"),
    Setting::<Feeder>::number("duty", [0.5, 1.0], 1.0, |feeder| &mut feeder.plate.duty)
        .about("share of the cycle in which the plate moves forwards"),
    Setting::<Feeder>::number("friction", [1e-4, 10.0], 1.0, |feeder| &mut feeder.friction)
        .about("Coulomb friction between part and plate"),
    Setting::<Feeder>::number("mass_g", [1e-6, 1e6], 1e-3, |feeder| &mut feeder.mass_kg).about("mass of the part"),
    Setting::<Feeder>::number("force_dyn", [-1e6, 1e6], DYN_N, |feeder| &mut feeder.force_n)
        .about("external force along the feed"),
];

impl Feeder {
    /// The paper's device at its optimal duty (section III-C.1).
    pub fn published() -> Self {
        let plate = PlateCycle { accel_mps2: 150.0, period_s: 0.02, duty: 0.586 };
        Self { plate, friction: 1.0, mass_kg: 1e-4, force_n: 0.0 }
    }

    fn sliding(&self) -> Sliding {
        Sliding { drag_mps2: self.friction * GRAVITY_MPS2, push_mps2: self.force_n / self.mass_kg }
    }

    /// Rejects feeders outside the model: a part that sticks to the plate, or one that a force carries away.
    fn check(&self) -> Result<(), LabFault> {
        let Sliding { drag_mps2, push_mps2 } = self.sliding();
        if self.plate.accel_mps2 <= drag_mps2 {
            return Err(LabFault::Setting(format!(
                "accel_mps2: expected more than {drag_mps2:.3} (friction times gravity), found {}: the part sticks",
                self.plate.accel_mps2
            )));
        }
        if push_mps2.abs() >= drag_mps2 {
            return Err(LabFault::Setting(format!(
                "force_dyn: expected less than {:.3} (friction times weight), found {:.3}: the force carries the part away",
                drag_mps2 * self.mass_kg / DYN_N,
                self.force_n / DYN_N
            )));
        }
        Ok(())
    }

    fn saturates(&self) -> bool {
        self.plate.duty > saturation(self.plate.accel_mps2, self.friction)
    }
}

/// The feed rate of one feeder, compared with the closed form where there is one.
///
/// # Errors
///
/// A feeder outside the model.
pub fn measure(feeder: &Feeder, _: Progress<'_>) -> Result<ExperimentResult, LabFault> {
    feeder.check()?;
    let Feeder { plate, friction, mass_kg, force_n } = *feeder;
    let cycle = feeder.sliding().settled(&plate)?;
    let rate_mps = cycle.way_m / plate.period_s;
    let viscosity = viscosity_nspm(&plate, friction, mass_kg);
    let exact_mps = feed_rate_mps(&plate, friction);
    let rate_against = |closed_form_mps: f64, source: &str| {
        Figure::against("feed rate", "mm/s", mm_from_m(rate_mps), mm_from_m(closed_form_mps), source)
    };
    let rate = match (force_n == 0.0, feeder.saturates()) {
        (true, true) => rate_against(exact_mps, "Impulse paper, Eq. 7"),
        (true, false) => rate_against(exact_mps, "Impulse paper, Eq. 3"),
        (false, false) => rate_against(exact_mps + force_n / viscosity, "Impulse paper, Eqs. 3 and 4"),
        (false, true) => Figure::alone("feed rate", "mm/s", mm_from_m(rate_mps), "simulated; no closed form for it"),
    };
    let alone = Figure::alone::<&str>;
    let figures = vec![
        rate,
        alone("quasi-static feed rate", "mm/s", mm_from_m(quasi_static_mps(&plate)), "Impulse paper, Eq. 3 and below"),
        alone("duty at which the part saturates", "1", saturation(plate.accel_mps2, friction), "Impulse paper, Eq. 5"),
        alone("viscosity K", "dyn s/cm", viscosity / (DYN_N / 0.01), "Impulse paper, Eq. 4"),
        alone("largest speed of the plate", "mm/s", mm_from_m(plate.peak_mps()), "(a T/2)(d - sqrt(2 d - 1))"),
        alone("stroke of the plate", "mm", mm_from_m(plate.stroke_m()), "(a T²/4)(1 - d)²"),
    ];
    let notes = if force_n != 0.0 && plate.duty > VISCOUS_BELOW {
        vec![format!(
            "duty {}: forces of the order of friction leave the closed form of K above {VISCOUS_BELOW}",
            plate.duty
        )]
    } else {
        Vec::new()
    };
    let (chart, series) = cycle_chart(&plate, &cycle.events);
    Ok(ExperimentResult { figures, notes, charts: vec![chart], series, ..ExperimentResult::default() })
}

/// Velocity of plate and part over a cycle.
fn cycle_chart(plate: &PlateCycle, events: &[[f64; 2]]) -> (Chart, Vec<Series>) {
    let ms_mm = |&[t_s, speed_mps]: &[f64; 2]| [1e3 * t_s, mm_from_m(speed_mps)];
    let corners = plate.stretches().into_iter().scan([0.0, 0.0], |at, stretch| {
        *at = [at[0] + stretch.length_s, at[1] + stretch.accel_mps2 * stretch.length_s];
        Some(*at)
    });
    let plate: Vec<[f64; 2]> = std::iter::once([0.0, 0.0]).chain(corners).map(|at| ms_mm(&at)).collect();
    let part: Vec<[f64; 2]> = events.iter().map(ms_mm).collect();
    let mut series = Series::columns(["plate_t_ms", "plate_mm_s"], &plate);
    series.extend(Series::columns(["part_t_ms", "part_mm_s"], &part));
    let chart = Chart::plot(
        "feeder-cycle",
        "One cycle of the plate, and the part on it",
        ["time (ms)", "velocity (mm/s)"],
        vec![Layer::new("plate", Mark::Line, Color::Gray, plate), Layer::new("part", Mark::Line, Color::Blue, part)],
    );
    (chart, series)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::settings::{SettingAssignment, assigned};

    fn set(text: &str) -> Result<ExperimentResult, LabFault> {
        let assignments: Vec<SettingAssignment> = text.split_whitespace().map(|one| one.parse().unwrap()).collect();
        measure(&assigned(SETTINGS, &Feeder::published(), &assignments)?, &|_| ())
    }

    #[test]
    fn settings_outside_the_model_are_refused_with_the_limit() {
        for (text, fault) in [
            ("accel_mps2=9", "accel_mps2: expected more than 9.807 (friction times gravity), found 9: the part sticks"),
            ("force_dyn=99", "force_dyn: expected less than 98.066 (friction times weight), found 99.000: the force"),
            ("duty=0.4", "duty: expected 0.5 to 1, found 0.4"),
        ] {
            let said = set(text).unwrap_err().to_string();
            assert!(said.starts_with(fault), "{said}");
        }
    }

    #[test]
    fn figure_has_a_reference_where_there_is_a_closed_form_alone() {
        for text in ["duty=0.55", "duty=0.9", "duty=0.55 force_dyn=5"] {
            let figure = &set(text).unwrap().figures[0];
            assert!(figure.relative_error().unwrap().abs() < 1e-4, "{text}: {figure:?}");
        }
        let forced = set("duty=0.9 force_dyn=5").unwrap();
        assert!(forced.figures[0].reference.is_none() && forced.notes.len() == 1);
    }
}
