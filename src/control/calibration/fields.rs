use nalgebra::{Complex, Matrix3, Vector3};

use super::{CalibrationError, CalibrationSession};
use upm_core::rig::FieldDriveModel;
use upm_core::signal::{Drive, Envelope, Harmonic};
use upm_perception::estimation::{MAX_PERIODS, TwistFit};
use upm_planning::cor_library::{FieldResponse, motor_harmonics};

/// Share of the count limit at which a harmonic is played: less than that of the axis pulses, whose signals the
/// accelerometers resolved, because the restoring force at the slower base frequency needs room too.
const EFFORT: f64 = 0.5;
/// Time at full height, s: long enough for the transient of the flank to decay before the last periods are read.
const SUSTAIN_S: f64 = 0.2;
const NAMES: [&str; 3] = ["field x", "field y", "field spin"];

/// Plays every harmonic of the rig's synthesised motions on every axis, in both directions, and reads the plate's
/// response on all three; `None` where the rig makes none.
pub(super) fn measure(session: &mut CalibrationSession<'_>) -> Result<Option<FieldResponse>, CalibrationError> {
    let Some(fields) = session.model.fields else { return Ok(None) };
    let mut twist_from_counts = Vec::with_capacity(fields.harmonics);
    for k in 1..=fields.harmonics {
        // velocity phasors of x, y and spin, a column for one count of each axis
        let mut response = Matrix3::zeros();
        for (axis, name) in NAMES.iter().enumerate() {
            session.report("fields", 3 * (k - 1) + axis, 3 * fields.harmonics);
            let unit = pulse(session, &fields, k, axis, 1.0);
            let counts = EFFORT * session.model.count_limit / unit.peak_counts();
            let drive = pulse(session, &fields, k, axis, counts);
            let what = format!("{name}, harmonic {k}");
            let there = session.read_twist(&what, &drive)?;
            let back = session.read_twist(&what, &drive.reversed())?;
            let read = |fit: &TwistFit, of: usize| if k == 1 { fit.axes[of].first } else { fit.axes[of].second };
            let moved = |of: usize, _: usize| (read(&there, of) - read(&back, of)) / Complex::from(2.0 * counts);
            response.set_column(axis, &Vector3::from_fn(moved));
        }
        response.try_inverse().ok_or(CalibrationError::Singular)?;
        twist_from_counts.push(response);
    }
    Ok(Some(FieldResponse {
        base_radps: fields.base_radps,
        attack_s: fields.attack_s,
        rest_s: fields.rest_s,
        limit_counts: session.model.count_limit,
        twist_from_counts,
    }))
}

/// `counts · cos kwt` on one axis, written as the second harmonic of half its frequency: the read-out of two harmonics
/// then sees twice the periods and needs only eight samples in each. As a first harmonic its period would be too long.
fn pulse(session: &CalibrationSession<'_>, fields: &FieldDriveModel, k: usize, axis: usize, counts: f64) -> Drive {
    let read_s = std::f64::consts::TAU * MAX_PERIODS as f64 / fields.base_radps;
    let sustain_s = SUSTAIN_S.max(read_s).min(session.model.max_sustain_s);
    let envelope = Envelope { attack_s: fields.attack_s, sustain_s, rest_s: fields.rest_s };
    let axis_counts = Vector3::from_fn(|i, _| Complex::from(if i == axis { counts } else { 0.0 }));
    let forces = session.model.motor_arrangement.turned(motor_harmonics(&axis_counts));
    let (base_radps, motors) = if k == 1 {
        (fields.base_radps, forces.map(|force| vec![force]))
    } else {
        (0.5 * k as f64 * fields.base_radps, forces.map(|force| vec![Harmonic::default(), force]))
    };
    Drive { base_radps, motors, envelope, ..Drive::default() }
}
