use super::numerics::rms;
use super::pulses::envelope;
use super::shaken::{BarePlate, steady_motion};
use super::sweep::Progress;
use super::texts::figures;
use super::{ExperimentResult, Figure, LabError, LabRig};
use upm_core::background::on_all_cores;
use upm_core::geometry::Twist;
use upm_core::units::mm_from_m;
use upm_perception::estimation::nearest_pump;
use upm_planning::cor_library::Entry;

/// Centres farther than this many half sides count as translations, as in `upm check`.
const FARTHEST: f64 = 20.0;

/// Radius at which spin is weighted like velocity, m.
const REACH_M: f64 = 0.1;

/// The centres of rotation of a whole library (UPM paper, sections 3.2 and 4.1): calibration steers them over and
/// around the plate and reads each through the accelerometers; the simulated plate gives the true ones.
///
/// # Errors
///
/// [`LabError::Rig`] when calibration refuses the rig.
pub fn cor_map(lab: &LabRig, progress: Progress<'_>) -> Result<ExperimentResult, LabError> {
    let mut plate = BarePlate::new(lab);
    let (axes, entries) = plate.calibrated(|session, params| session.steer(params))?;
    let envelope = envelope(lab, 0.1);
    let arm_m = lab.model.accelerometer_in_plate_m.norm();
    let read = |entry: &Entry| {
        let drive = lab.drive_around(lab.model.motor_arrangement.turned(entry.amplitudes), &axes.shapes, envelope);
        [entry.pump, nearest_pump(&steady_motion(lab, &drive), arm_m).0]
    };
    let read = on_all_cores(&entries, progress, read);
    let half_side_m = 0.5 * lab.model.plate_side_m;
    Ok(ExperimentResult { figures: figures_of(&read, half_side_m).into(), ..ExperimentResult::default() })
}

/// Figures of the motions as calibration reads them, each beside the true one.
fn figures_of(read: &[[Twist; 2]], half_side_m: f64) -> [Figure; 9] {
    let centers = read.iter().filter_map(|[read, truth]| {
        let (read, truth) = (read.center_of_rotation()?, truth.center_of_rotation()?);
        (truth.norm() < FARTHEST * half_side_m).then_some((read, truth))
    });
    let (inside, outside): (Vec<_>, Vec<_>) = centers.partition(|(_, truth)| truth.amax() <= half_side_m);
    let largest = |values: &[f64]| values.iter().copied().fold(0.0, f64::max);
    let misses_mm: Vec<f64> = inside.iter().map(|(read, truth)| mm_from_m((read - truth).norm())).collect();
    let shares: Vec<f64> = outside.iter().map(|(read, truth)| 100.0 * (read - truth).norm() / truth.norm()).collect();
    let translations = read.len() - inside.len() - outside.len();
    // the motion that was read would send parts backwards
    let is_wrong_way = |[read, truth]: &&[Twist; 2]| {
        let along = read.velocity_mps.dot(&truth.velocity_mps) + read.spin_radps * truth.spin_radps * REACH_M * REACH_M;
        along <= 0.0
    };
    let wrong = read.iter().filter(is_wrong_way).count();
    let turned_deg = |[read, truth]: &[Twist; 2]| read.velocity_mps.angle(&truth.velocity_mps).to_degrees();
    let is_straight = |[_, truth]: &&[Twist; 2]| {
        truth.center_of_rotation().is_none_or(|center| center.norm() >= FARTHEST * half_side_m)
    };
    let turned_deg: Vec<f64> = read.iter().filter(is_straight).map(turned_deg).collect();
    figures([
        ("centres inside the plate", inside.len() as f64),
        ("centres outside", outside.len() as f64),
        ("translations", translations as f64),
        ("read-out inside, rms", rms(&misses_mm)),
        ("read-out inside, worst", largest(&misses_mm)),
        ("read-out outside, rms", rms(&shares)),
        ("read-out outside, worst", largest(&shares)),
        ("direction of translations, worst", largest(&turned_deg)),
        ("wrong way round", wrong as f64),
    ])
}

#[cfg(test)]
mod tests {
    use super::super::testing::lab_rig;
    use super::*;

    /// Centres of rotation on `rig` are read well.
    fn centers_are_read_well(rig: &str, seed: u64) {
        let outcome = cor_map(&LabRig { seed, ..lab_rig(rig) }, &|_| ()).unwrap();
        let figure = |name: &str| outcome.figures.iter().find(|figure| figure.name == name).unwrap().measured;
        assert!(figure("centres inside the plate") > 100.0 && figure("centres outside") > 40.0);
        let inside_mm = figure("read-out inside, rms");
        assert!(inside_mm < 0.5, "{rig}, seed {seed}: {inside_mm} mm");
        let outside = figure("read-out outside, worst");
        assert!(outside < 2.0, "{rig}, seed {seed}: {outside} %");
        assert_eq!(figure("wrong way round"), 0.0);
    }

    #[test]
    fn centres_are_read_to_half_a_millimetre() {
        centers_are_read_well("upm-1", 1);
    }

    #[test]
    #[ignore = "long: `cargo test -- --ignored` runs it"]
    fn centres_are_read_to_half_a_millimetre_on_the_other_rig_and_with_other_seeds() {
        centers_are_read_well("upm-1", 2);
        centers_are_read_well("upm-2", 1);
        centers_are_read_well("upm-2", 2);
    }
}
