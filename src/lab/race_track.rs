//! The race track (UPM paper, Fig. 2): three coins on a line to the right of a centre of rotation near the plate's
//! lower left corner flow along one rotation field. In the ideal field all travel the same distance, so that the inner
//! ones turn through larger angles. Here the rig's own plate is shaken about that centre, as strongly as its motors
//! can.

use std::f64::consts::{FRAC_PI_2, TAU};

use super::pulses::{
    EDGE_M, FINER, Played, SERIES_HZ, calm_envelope, check_carries, mm, play, saturation, strongest_spin, turn,
};
use super::sweep::Progress;
use super::texts::{figure, figures};
use super::{ExperimentResult, Figure, LabError, LabRig};
use upm_chart::{Chart, Color, Layer, Mark};
use upm_core::geometry::Vec2;
use upm_core::job::PlateMode;
use upm_sim::OpenPulse;

/// Starting positions of the coins, as fractions of the distance from the centre to the plate's other side.
const LANES: [f64; 3] = [0.4, 0.7, 1.0];
const NAMES: [&str; 3] = ["inner coin", "middle coin", "outer coin"];
const OUTER: usize = 2;
/// Periods of a pulse's sustain: as short as possible, for weak pulses. Still shorter ones are nearly all flank, in
/// which the belt is slow and saturates.
const SUSTAINED_PERIODS: f64 = 2.0;
/// Number of snapshots, the start included.
const SNAPSHOTS: usize = 4;
/// Pulses tried at first; doubled until a coin has travelled as far as the plate allows.
const FIRST_PULSES: usize = 32;
const MOST_PULSES: usize = 4096;

/// The field and the starting positions of the coins.
struct RaceCourse {
    cor_m: Vec2,
    starts_m: [Vec2; 3],
    spin_radps: f64,
    pulse: OpenPulse,
    /// Length of a pulse with its rest, in whole steps, s.
    pulse_s: f64,
}

impl RaceCourse {
    fn on(rig: &LabRig) -> Result<Self, LabError> {
        let coin_radius_m = rig.penny.radius_m;
        let inset_m = 0.5 * rig.sim.plate.side_m - coin_radius_m - EDGE_M;
        let cor_m = Vec2::new(-inset_m, -inset_m);
        let lane_m = 2.0 * inset_m * (LANES[1] - LANES[0]);
        if lane_m <= 2.0 * coin_radius_m {
            return Err(LabError::Rig(format!(
                "three coins do not fit beside each other: expected lanes more than {:.1} mm apart, found {:.1} mm",
                2e3 * coin_radius_m,
                1e3 * lane_m
            )));
        }
        let spin_radps = strongest_spin(rig, cor_m)?;
        check_carries(rig, spin_radps, 2.0 * inset_m * LANES[0])?;
        let envelope = calm_envelope(rig, PlateMode::Dynamic, SUSTAINED_PERIODS * TAU / rig.model.base_radps);
        Ok(Self {
            cor_m,
            starts_m: LANES.map(|lane| cor_m + Vec2::new(2.0 * inset_m * lane, 0.0)),
            spin_radps,
            pulse: OpenPulse::about(cor_m, spin_radps, envelope),
            pulse_s: (envelope.total_s() / rig.sim.step_s).round() * rig.sim.step_s,
        })
    }

    /// The last sample before `pulses` pulses and their rests are over.
    fn sample_after(&self, pulses: usize) -> usize {
        const ROUNDING: f64 = 1e-6;
        (pulses as f64 * self.pulse_s * SERIES_HZ * FINER as f64 + ROUNDING) as usize
    }

    fn radius_m(&self, coin: usize) -> f64 {
        (self.starts_m[coin] - self.cor_m).norm()
    }

    /// True when no coin has turned by more than a quarter after `pulses` pulses.
    fn all_in_quarter(&self, played: &Played, pulses: usize) -> bool {
        played.ways_m.iter().zip(self.starts_m).all(|(way_m, start)| {
            let at = way_m.get(self.sample_after(pulses));
            at.is_some_and(|&at| turn(self.cor_m, start, at).0.abs() < FRAC_PI_2)
        })
    }
}

/// Angle, rad, and arc, m, of a coin's rotation about `cor_m`.
fn lap(way_m: &[Vec2], cor_m: Vec2) -> (f64, f64) {
    let turns = way_m.windows(2).map(|pair| turn(cor_m, pair[0], pair[1]));
    turns.fold((0.0, 0.0), |(angle, arc), (turned, gone)| (angle + turned, arc + gone))
}

/// The pulses played, up to the last one before a coin would have left its quarter.
struct Race {
    course: RaceCourse,
    pulses: usize,
    end_s: f64,
    ways_m: Vec<Vec<Vec2>>,
}

impl Race {
    fn run(rig: &LabRig) -> Result<Self, LabError> {
        let course = RaceCourse::on(rig)?;
        let mut tried = FIRST_PULSES;
        while tried <= MOST_PULSES {
            let pulses = vec![course.pulse.clone(); tried];
            let played = play(rig, PlateMode::Dynamic, &course.starts_m, &pulses, SERIES_HZ * FINER as f64)?;
            let pulses = (1..=tried).take_while(|&k| course.all_in_quarter(&played, k)).last().unwrap_or(0);
            if pulses == 0 {
                return Err(LabError::Rig("one pulse carries a coin out of its quarter of a turn".to_owned()));
            }
            if pulses < tried {
                let last = course.sample_after(pulses);
                let (end_s, mut ways_m) = (played.t_s.get(last).copied().unwrap_or(f64::NAN), played.ways_m);
                ways_m.iter_mut().for_each(|way_m| way_m.truncate(last + 1));
                return Ok(Self { end_s, course, pulses, ways_m });
            }
            tried *= 2;
        }
        Err(LabError::Rig(format!("{MOST_PULSES} pulses carry no coin through a quarter of a turn")))
    }

    /// The smallest gap between two rims at any time, m.
    fn least_gap_m(&self, coin_radius_m: f64) -> f64 {
        let gaps = [(0, 1), (0, 2), (1, 2)].into_iter().flat_map(|(a, b)| {
            let together = self.ways_m[a].iter().zip(&self.ways_m[b]);
            together.map(move |(a, b)| (a - b).norm() - 2.0 * coin_radius_m)
        });
        gaps.fold(f64::INFINITY, f64::min)
    }
}

/// Shakes the rig's plate about a point near its lower left corner until the first coin has made a quarter turn, and
/// measures each coin's distance.
///
/// # Errors
///
/// [`LabError::Rig`] when three coins do not fit beside each other, when they stick or creep backwards, when one pulse
/// carries a coin out of its quarter of a turn or thousands of pulses carry none through it, and when the rig's figures
/// give no valid pulse.
pub fn race_track(rig: &LabRig, _: Progress<'_>) -> Result<ExperimentResult, LabError> {
    let race = Race::run(rig)?;
    let charts = vec![map(rig, &race)];
    Ok(ExperimentResult { figures: figures_of(rig, &race), charts, ..ExperimentResult::default() })
}

fn figures_of(rig: &LabRig, race: &Race) -> Vec<Figure> {
    let (course, spin_radps) = (&race.course, race.course.spin_radps);
    let mut found = figures([
        ("amplitude of spin", spin_radps),
        ("pulses", race.pulses as f64),
        ("plate time", race.end_s),
        ("least gap between rims", 1e3 * race.least_gap_m(rig.penny.radius_m)),
    ])
    .to_vec();
    let laps: Vec<(f64, f64)> = race.ways_m.iter().map(|way_m| lap(way_m, course.cor_m)).collect();
    for (i, (coin, (angle_rad, arc_m))) in NAMES.into_iter().zip(&laps).enumerate() {
        let saturation = saturation(rig, spin_radps, course.radius_m(i), &course.pulse.envelope);
        let radius = format!("starts {:.1} mm from the centre", 1e3 * course.radius_m(i));
        let end_m = race.ways_m[i].last().map_or(f64::NAN, |end| (end - course.cor_m).norm());
        found.extend([
            figure("{}: saturation", saturation).of(coin),
            Figure::alone(format!("{coin}: arc"), "mm", 1e3 * arc_m, &radius),
            Figure::alone(format!("{coin}: angle turned"), "deg", angle_rad.to_degrees(), &radius),
            figure("{}: radial drift", 1e3 * (end_m - course.radius_m(i))).of(coin),
        ]);
    }
    let outer_m = laps[OUTER].1;
    let over_outer = |coin: usize| figure("{}: arc over the outer coin's", laps[coin].1 / outer_m).of(NAMES[coin]);
    found.extend((0..OUTER).map(over_outer));
    found
}

fn map(rig: &LabRig, race: &Race) -> Chart {
    let course = &race.course;
    let mut layers = vec![
        Layer::plate(1e3 * (0.5 * rig.sim.plate.side_m)),
        Layer::new("centre of rotation", Mark::Crosses, Color::Red, [mm(course.cor_m)]),
    ];
    for (i, way_m) in race.ways_m.iter().enumerate() {
        let path = way_m.iter().step_by(FINER).map(|place| mm(*place));
        layers.push(Layer::new("", Mark::Line, Color::Gray, path));
        // the start and thirds of the pulses, each at rest
        let samples = (0..SNAPSHOTS).map(|k| course.sample_after(k * race.pulses / (SNAPSHOTS - 1)));
        let seen = samples.filter_map(|sample| way_m.get(sample)).map(|place| mm(*place));
        let circles = Mark::Circles { radius: 1e3 * rig.penny.radius_m };
        layers.push(Layer::new(NAMES[i], circles, Color::nth(i), seen));
    }
    Chart::plate_map("race-track", "Three coins on one rotation field, four snapshots", None, layers)
}

#[cfg(test)]
mod tests {
    use super::super::testing::{assert_sources_are_short, lab_rig, measured};
    use super::*;
    use std::sync::OnceLock;

    /// The results on upm-1 and upm-2.
    fn raced(rig: &str) -> &'static ExperimentResult {
        static RESULTS: [OnceLock<ExperimentResult>; 2] = [const { OnceLock::new() }; 2];
        RESULTS[usize::from(rig == "upm-2")].get_or_init(|| race_track(&lab_rig(rig), &|_| ()).unwrap())
    }

    #[test]
    fn inner_coins_turn_through_larger_angles_where_the_motors_are_strong() {
        let outcome = raced("upm-2");
        assert_sources_are_short(outcome);
        let angle = NAMES.map(|coin| measured(outcome, &format!("{coin}: angle turned")));
        assert!(angle[0] > 1.15 * angle[1] && angle[1] > 1.15 * angle[2] && angle[0] > 80.0, "{angle:?}");
        for coin in NAMES {
            assert!(measured(outcome, &format!("{coin}: saturation")) < 1.0);
            let drift_mm = measured(outcome, &format!("{coin}: radial drift"));
            assert!(drift_mm.abs() < 5.0, "the plate rests between pulses: {coin}: {drift_mm}");
        }
        for coin in &NAMES[..OUTER] {
            let arcs = measured(outcome, &format!("{coin}: arc over the outer coin's"));
            // the inner coin's belt is nearest to saturation
            assert!((0.7..1.05).contains(&arcs), "{coin}: {arcs}");
        }
    }

    #[test]
    fn weak_motors_turn_the_plate_into_a_belt() {
        let outcome = raced("upm-1");
        let arc = NAMES.map(|coin| measured(outcome, &format!("{coin}: arc")));
        assert!(arc[0] < arc[1] && arc[1] < arc[2], "{arc:?}");
        for coin in NAMES {
            assert!(measured(outcome, &format!("{coin}: saturation")) > 1.0);
        }
    }

    #[test]
    fn coins_stay_on_the_plate_and_apart() {
        for name in ["upm-1", "upm-2"] {
            let rig = lab_rig(name);
            let outcome = raced(name);
            assert!(measured(outcome, "least gap between rims") > 0.0);
            let reach = 0.5 * rig.sim.plate.side_m - rig.penny.radius_m;
            let ways =
                outcome.charts[0].layers.iter().filter(|layer| layer.color == Color::Gray && layer.label.is_empty());
            assert_eq!(ways.clone().count(), 3);
            for place in ways.flat_map(|way| &way.points).flatten() {
                assert!(place.abs() < 1e3 * reach, "{name}: {place}");
            }
        }
    }

    #[test]
    fn motors_too_weak_to_slide_a_coin_are_refused() {
        let mut rig = lab_rig("upm-1");
        rig.sim.motors.force_limit_n *= 0.1;
        assert!(matches!(race_track(&rig, &|_| ()), Err(LabError::Rig(why)) if why.contains("stick")));
    }
}
