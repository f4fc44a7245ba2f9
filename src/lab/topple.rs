//! Orienting parts by a low ledge (Singer and Seering, "Utilizing dynamic stability to orient parts", section 2): a
//! part that slides against it topples above a critical speed that depends on its orientation.

mod cascade;
mod impact;
mod peg;
mod published;
mod trials;

use self::peg::{Peg, Pivot, Shape, ratio_of_orientations};
pub use self::published::reproduce;
use self::trials::{Band, TrialScatter, band};
use super::settings::{Field, Setting, settings};
use super::sweep::Progress;
use super::texts::{chart, figures};
use super::{ExperimentResult, LabError};
use upm_chart::{Chart, Color};
use upm_core::random::Streams;
use upm_core::units::mm_from_m;

/// A part, a ledge, and the scatter of the experiment.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Topple {
    cylinder: u32,
    length_m: f64,
    height_m: f64,
    ledge_m: f64,
    scatter: TrialScatter,
    seed: u32,
}

/// Parameters of a part and its ledge.
pub const SETTINGS: &[Setting<Topple>] = settings! {
    "cylinder", [0.0, 2.0], count, cylinder, "0 for a block, 1 for a cylinder that stands, 2 for one on its side along the way";
    "length_mm", [1e-3, 1e4], 1e-3, length_m, "length along the way; diameter of a cylinder that stands";
    "height_mm", [1e-3, 1e4], 1e-3, height_m, "height of the part; diameter of a cylinder on its side";
    "ledge_mm", [0.0, 1e4], 1e-3, ledge_m, "height of the ledge";
    "belt_percent", [0.0, 20.0], 1e-2, scatter.belt, "standard deviation of the belt's speed";
    "friction", [0.0, 5.0], 1.0, scatter.friction, "friction between belt and part";
    "friction_sd", [0.0, 1.0], 1.0, scatter.friction_sd, "standard deviation of that friction";
    "way_mm", [0.0, 1e5], 1e-3, scatter.way_m, "way on the belt before the ledge";
    "seed", [0.0, 1e9], count, seed, "seed of the trials";
};

impl Topple {
    /// A peg of half an inch and the paper's ledge; the scatter is our choice, since the paper prints none.
    pub fn published() -> Self {
        let scatter = TrialScatter { belt: 0.01, friction: 0.3, friction_sd: 0.05, way_m: 0.3, way_sd: 0.1 };
        Self { cylinder: 1, length_m: 6.35e-3, height_m: 12.7e-3, ledge_m: 0.889e-3, scatter, seed: 1 }
    }

    fn peg(&self) -> Peg {
        let shape = match self.cylinder {
            0 => Shape::BLOCK,
            1 => Shape::CYLINDER,
            _ => Shape::LYING_CYLINDER,
        };
        Peg { shape, length_m: self.length_m, height_m: self.height_m }
    }
}

/// Critical speed of one part, in closed form, simulated, and by fifteen trials per speed, and the window of speeds
/// that topple one of its orientations and leave the other (Fig. 2b).
///
/// # Errors
///
/// A ledge as high as the part's centre.
pub fn measure(topple: &Topple, _: Progress<'_>) -> Result<ExperimentResult, LabError> {
    let peg = topple.peg();
    let too_high = || {
        let [most, found] = [0.5 * peg.height_m, topple.ledge_m].map(mm_from_m);
        LabError::Setting(format!("ledge_mm: expected less than {most} (half of the part's height), found {found}"))
    };
    let pivot = peg.pivot(topple.ledge_m).ok_or_else(too_high)?;
    let (exact_mps, simulated_mps) = (pivot.critical_mps(), pivot.simulated_critical_mps());
    let trials = |critical_mps| band(&topple.scatter, critical_mps, &Streams::new(topple.seed.into()));
    let band = trials(simulated_mps);
    let holds = |pivot: &Pivot| pivot.rise()[0] >= pivot.rise()[1];
    let mut found = figures([
        ("least speed that topples the part, simulated", mm_from_m(simulated_mps)),
        ("highest speed at which none fell", mm_from_m(band.none_mps)),
        ("lowest speed at which all fell", mm_from_m(band.all_mps)),
        ("middle of these two", mm_from_m(band.middle_mps())),
        ("their distance over their middle", 100.0 * band.width()),
    ])
    .to_vec();
    found[0].reference = holds(&pivot).then_some(mm_from_m(exact_mps));
    let mut bands = vec![("this orientation", pivot, band)];
    if let Some(other) = peg.toppled().pivot(topple.ledge_m) {
        let other_mps = other.critical_mps();
        bands.push(("other orientation", other, trials(other_mps)));
        let [slow, fast] = if other_mps > exact_mps { [0, 1] } else { [1, 0] }.map(|i: usize| &bands[i].2);
        found.extend(figures([
            ("the same for the other orientation", mm_from_m(other_mps)),
            ("window that tells the two apart, from", mm_from_m(slow.all_mps)),
            ("window that tells the two apart, to", mm_from_m(fast.none_mps)),
        ]));
    }
    let note = |(name, pivot, _): &(&str, Pivot, Band)| {
        let [sine, least] = pivot.rise();
        format!(
            "{name}: Eq. 2.3 does not hold, the ledge would have to hold the part down: its centre is too low for its length, \
             the angle's sine {sine:.3} of at least {least:.3}"
        )
    };
    let notes = bands.iter().filter(|(_, pivot, _)| !holds(pivot)).map(note).collect();
    Ok(ExperimentResult { figures: found, notes, charts: vec![trials_chart(&bands)], ..ExperimentResult::default() })
}

/// The velocity line of Fig. 2b: the trials of each orientation about its critical speed.
fn trials_chart(bands: &[(&str, Pivot, Band)]) -> Chart {
    let mut chart = chart("topple-trials");
    for (i, (name, pivot, band)) in bands.iter().enumerate() {
        let exact = [0.0, 1.0].map(|share| [mm_from_m(pivot.critical_mps()), share]);
        let shares = band.shares.iter().map(|&[mps, share]| [mm_from_m(mps), share]);
        chart = chart.dashes(&format!("{name}: Eq. 2.3"), Color::nth(i), exact).dots("", Color::nth(i), shares);
    }
    chart
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::settings::{assigned, assignment};

    fn set(text: &str) -> Result<ExperimentResult, LabError> {
        let assignments: Vec<_> = text.split_whitespace().map(|one| assignment(one).unwrap()).collect();
        measure(&assigned(SETTINGS, &Topple::published(), &assignments)?, &|_| ())
    }

    #[test]
    fn trials_without_scatter_have_no_band() {
        let outcome = set("belt_percent=0 friction_sd=0").unwrap();
        let figure = |name: &str| outcome.figures.iter().find(|figure| figure.name == name).unwrap().measured;
        assert!(figure("their distance over their middle") < 1.0, "one step of the speed");
        let slow = set("friction=0.05 friction_sd=0 way_mm=10").unwrap();
        assert!(slow.figures[2].measured.is_nan(), "the belt never gets the part up to the speed");
    }

    #[test]
    fn squat_cylinder_has_no_reference_and_its_other_orientation_shares_the_window() {
        let squat = set("length_mm=20 height_mm=6 ledge_mm=0").unwrap();
        assert_eq!(squat.figures[0].reference, None);
        assert!(
            squat.notes.len() == 1 && squat.notes[0].contains("the angle's sine 0.287 of at least 0.49"),
            "{:?}",
            squat.notes
        );
        let lying = set("cylinder=2 length_mm=6 height_mm=20 ledge_mm=0").unwrap();
        let window = |outcome: &ExperimentResult| [6, 7].map(|i| outcome.figures[i].measured);
        assert_eq!(window(&squat).map(f64::round), window(&lying).map(f64::round));
    }
}
