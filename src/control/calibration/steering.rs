use std::f64::consts::{FRAC_1_SQRT_2, TAU};

use nalgebra::Vector3;

use super::axes::Axes;
use super::session::EFFORT;
use super::{CalibrationError, CalibrationParams, CalibrationSession};
use upm_core::geometry::{Twist, Vec2};
use upm_core::rig::RigModel;
use upm_core::signal::MotorArrangement;
use upm_planning::cor_library::Entry;

/// A motion to be measured.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct SteeringMotion {
    /// Its velocity field, at any scale.
    pub direction: Twist,
    /// Limit for the plate's speed amplitude anywhere on the plate, m/s; infinite where only the motors limit it.
    pub top_mps: f64,
}

/// Plate speed amplitude of the gentle motions, m/s; these make the shortest steps.
pub(super) const GENTLE_MPS: f64 = 0.04;
/// Rows and columns of the gentle motions' grid of centres, and their number of directions of translation.
const GENTLE_GRID: usize = 7;
const GENTLE_TRANSLATIONS: usize = 24;
/// Half the side of a grid of centres, as a share of half the plate's side.
const GRID_REACH: f64 = 1.05;
/// Sustain of a pulse, s.
const READ_SUSTAIN_S: f64 = 0.1;
/// Peak of `cos a - sin 2a`.
const WAVE_PEAK: f64 = 1.7602;
/// A rig whose fastest motion exceeds the gentle speed by this factor also gets separate gentle motions.
const STRONG: f64 = 2.0;
/// Size of the amplitudes at which a drive's peak is computed; large, so that rounding is negligible.
const TRIAL_COUNTS: f64 = 1e4;

/// A deviation above this share of the wanted twist (m/s, m/s, rad/s, not weighted) is corrected once. Motions about a
/// centre on the plate turn at 1 rad/s before they are scaled: a hundredth of that is about a centimetre of the centre.
const MISS: f64 = 0.01;

/// Plays every wanted motion as strongly as the motors allow and records the plate's measured twist.
pub(super) fn measure(
    session: &mut CalibrationSession<'_>,
    axes: &Axes,
    wanted: &[SteeringMotion],
) -> Result<Vec<Entry>, CalibrationError> {
    let counts_from_twist = axes.twist_from_counts.try_inverse().ok_or(CalibrationError::Singular)?;
    let mut entries = Vec::with_capacity(wanted.len());
    for (i, SteeringMotion { direction, top_mps }) in wanted.iter().enumerate() {
        session.report("centres", i, wanted.len());
        let mut aim = direction.vector();
        let mut entry = play(session, axes, counts_from_twist * aim, *top_mps)?;
        let miss = miss(&entry.pump, direction, 0.5 * session.model.plate_side_m);
        if miss.norm() > MISS * aim.norm() {
            aim -= miss;
            entry = play(session, axes, counts_from_twist * aim, *top_mps)?;
        }
        entries.push(entry);
    }
    Ok(entries)
}

/// Plays axis amplitudes `counts` (any scale) as strongly as motors and `top_mps` allow, in both directions, and reads
/// the plate's twist.
fn play(
    session: &mut CalibrationSession<'_>,
    axes: &Axes,
    counts: Vector3<f64>,
    top_mps: f64,
) -> Result<Entry, CalibrationError> {
    let amplitudes = |counts| amplitudes(session.model.motor_arrangement, counts);
    let trial = counts * (TRIAL_COUNTS / counts.amax().max(f64::MIN_POSITIVE));
    let strongest = trial * (EFFORT * session.headroom(amplitudes(trial), &axes.shapes));
    let expected = axes.twist_from_counts * strongest;
    let corner_m = session.model.plate_side_m * FRAC_1_SQRT_2;
    let fastest_mps = expected.xy().norm() + expected.z.abs() * corner_m;
    let amplitudes = amplitudes(strongest * (top_mps / fastest_mps).min(1.0));
    let drive = session.drive(amplitudes, &axes.shapes, session.read_sustain_s(READ_SUSTAIN_S));
    let what = format!("amplitudes {amplitudes:?}");
    let there = session.read_twist(&what, &drive)?;
    let back = session.read_twist(&what, &drive.reversed())?;
    Ok(Entry { amplitudes, pump: (there.pump - back.pump) * 0.5 })
}

/// Whole motor amplitudes for axis amplitudes fx, fy, s in counts; the two motors of an axis share the work.
fn amplitudes(arrangement: MotorArrangement, axis_counts: Vector3<f64>) -> [i32; 4] {
    let [fx, fy, s] = [axis_counts.x, axis_counts.y, axis_counts.z];
    let around = [fx / 2.0 - s / 4.0, -fx / 2.0 - s / 4.0, fy / 2.0 + s / 4.0, -fy / 2.0 + s / 4.0];
    arrangement.turned(around).map(|a| a.round() as i32)
}

/// Deviation of `found` from the direction `wanted`, both scaled alike, as a twist vector. Spin is weighted by the
/// speed it causes at `reach_m`.
fn miss(found: &Twist, wanted: &Twist, reach_m: f64) -> Vector3<f64> {
    let weight = Vector3::new(1.0, 1.0, reach_m);
    let found = found.vector().component_mul(&weight);
    let wanted = wanted.vector().component_mul(&weight);
    let scale = found.dot(&wanted) / found.norm_squared().max(f64::MIN_POSITIVE);
    (found * scale - wanted).component_div(&weight)
}

/// The motions of a library for a rig with these axes: a grid of centres, rings of centres outside the plate, and
/// translations, as strong as the motors allow. A strong rig has gentle ones as well, on a coarser grid of centres, for
/// steps shorter than a strong pulse can make.
pub(super) fn wanted(axes: &Axes, model: &RigModel, params: &CalibrationParams) -> Vec<SteeringMotion> {
    let half_side_m = 0.5 * model.plate_side_m;
    let rings = params.rings.iter().enumerate().flat_map(|(k, radius)| {
        (0..params.ring_centers).map(move |i| {
            let angle = TAU * (i as f64 + 0.5 * (k % 2) as f64) / params.ring_centers as f64;
            let center = Vec2::new(libm::cos(angle), libm::sin(angle)) * *radius * half_side_m;
            Twist::about(center, 1.0 / (radius * half_side_m))
        })
    });
    let strong = grid(params.grid, GRID_REACH * half_side_m).chain(rings);
    let strong = strong.chain(translations(params.translations));
    let strong = strong.map(|direction| SteeringMotion { direction, top_mps: f64::INFINITY });
    let gentle = grid(GENTLE_GRID, GRID_REACH * half_side_m).chain(translations(GENTLE_TRANSLATIONS));
    let gentle = gentle.map(|direction| SteeringMotion { direction, top_mps: GENTLE_MPS });
    // the strongest translation along x
    let top_mps = axes.twist_from_counts.column(0).xy().norm() * (2.0 * model.count_limit / WAVE_PEAK);
    strong.chain(gentle.filter(|_| top_mps > STRONG * GENTLE_MPS)).collect()
}

fn grid(n: usize, reach_m: f64) -> impl Iterator<Item = Twist> {
    let at = move |i: usize| reach_m * (2.0 * i as f64 / (n.max(2) - 1) as f64 - 1.0);
    (0..n * n).map(move |i| Twist::about(Vec2::new(at(i % n), at(i / n)), 1.0))
}

/// Translations in `n` directions over half a turn: both directions along a line are one entry.
fn translations(n: usize) -> impl Iterator<Item = Twist> {
    (0..n).map(move |i| {
        let angle = 0.5 * TAU * i as f64 / n as f64;
        Twist::new(libm::cos(angle), libm::sin(angle), 0.0)
    })
}
