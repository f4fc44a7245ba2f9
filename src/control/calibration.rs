//! Calibration of a rig: how its axes answer and how far its pulses carry parts (UPM paper, sections 3.2 and 4.1).
//!
//! 1. Axes: pulses along x, y and spin. The plate's rigidity gives the accelerometers' gains relative to each other;
//!    the response of both harmonics gives the pre-compensation of every axis and the gain matrix from motor amplitudes
//!    to the plate's twist.
//! 2. Resonances: a multisine on each axis; natural frequency and damping ratio from the accelerometers' spectra, by
//!    FFT. Every later pulse is computed with them.
//! 3. Displacement: a few motions, played as pulses of rising length; the camera measures how far the coins move. This
//!    step precedes the next one, whose many pulses carry the coins off the plate.
//! 4. Steering: centres of rotation on and around the plate and translations, each played in both directions as
//!    strongly as the motors allow and read back through the accelerometers.
//! 5. Fields, where the rig makes synthesised motions: each of their harmonics on each axis, read back likewise, gives
//!    the plate's response in amplitude and phase.
//! 6. Closing: the last pulses of the axes again, with the same drives, to detect a coil or channel that has changed.
//!
//! No measurement is accepted unchecked: channels must agree with the plate's rigidity, coils with the rig's data sheet
//! and with each other, and the closing pulses with the opening ones. A mismatch is refused with the component's name
//! ([`CalibrationFault`]).

mod axes;
mod axis_pulse;
mod closing;
mod coils;
mod displacement;
mod fault;
mod fields;
mod params;
mod resonance;
mod session;
mod steering;

use std::sync::atomic::AtomicBool;

use session::CalibrationSession;
use steering::SteeringMotion;
use upm_core::rig::{Rig, RigModel};
use upm_planning::cor_library::{Entry, Library};

pub use axes::Axes;
pub use fault::{CalibrationFault, CoilFault, MiswiredChannel, RigComponent};
pub use params::{CalibrationParams, CalibrationProgress};
pub use resonance::AxisResonance;

/// A rig whose fastest motion exceeds the gentle speed by this factor also gets separate gentle motions.
const STRONG: f64 = 2.0;

/// Measures the response of the axes of `rig` with the accelerometers alone. Motors are at zero when this returns.
///
/// # Errors
/// [`CalibrationFault::Rig`] when the rig refuses or fails, [`CalibrationFault::Stopped`] once `stop` is set, and
/// [`CalibrationFault::Trace`] when a trace cannot be read. A channel, coil or axis that fails its check is
/// [`CalibrationFault::Channel`], [`CalibrationFault::NotRigid`], [`CalibrationFault::Coil`],
/// [`CalibrationFault::Coupled`], [`CalibrationFault::Still`] or [`CalibrationFault::Resonance`].
pub fn measure_axes(
    rig: &mut dyn Rig,
    model: &RigModel,
    params: &CalibrationParams,
    stop: &AtomicBool,
    progress: &mut dyn FnMut(CalibrationProgress),
) -> Result<Axes, CalibrationFault> {
    CalibrationSession::new(rig, model, stop, progress).work(|session| axes::measure(session, params))
}

/// The part of a library that needs accelerometers only: the axes, then every motion as strong as the motors allow.
/// Motors are at zero when this returns.
///
/// # Errors
/// As [`measure_axes`]; [`CalibrationFault::Singular`] when the axes do not move the plate independently.
pub fn steer(
    rig: &mut dyn Rig,
    model: &RigModel,
    params: &CalibrationParams,
    stop: &AtomicBool,
    progress: &mut dyn FnMut(CalibrationProgress),
) -> Result<(Axes, Vec<Entry>), CalibrationFault> {
    CalibrationSession::new(rig, model, stop, progress).work(|session| {
        let axes = axes::measure(session, params)?;
        let entries = steering::measure(session, &axes, params, &wanted(&axes, model, params))?;
        Ok((axes, entries))
    })
}

/// Measures the plate's response to the synthesised motions of `rig` with the accelerometers alone; `None` where the
/// rig makes none. Motors are at zero when this returns.
///
/// # Errors
/// As [`measure_axes`].
pub fn measure_fields(
    rig: &mut dyn Rig,
    model: &RigModel,
    params: &CalibrationParams,
    stop: &AtomicBool,
    progress: &mut dyn FnMut(CalibrationProgress),
) -> Result<Option<upm_planning::cor_library::FieldResponse>, CalibrationFault> {
    CalibrationSession::new(rig, model, stop, progress).work(|session| {
        axes::measure(session, params)?;
        fields::measure(session)
    })
}

/// Measures the resonances of `rig`'s axes x, y and spin with the accelerometers alone; `None` where its longest
/// sustain is too short to resolve them. Motors are at zero when this returns.
///
/// # Errors
/// As [`measure_axes`].
pub fn measure_resonances(
    rig: &mut dyn Rig,
    model: &RigModel,
    params: &CalibrationParams,
    stop: &AtomicBool,
    progress: &mut dyn FnMut(CalibrationProgress),
) -> Result<Option<[AxisResonance; 3]>, CalibrationFault> {
    CalibrationSession::new(rig, model, stop, progress).work(|session| {
        axes::measure(session, params)?;
        resonance::measure(session)
    })
}

/// Runs the full calibration of `rig` and returns its library. Motors are at zero when this returns.
///
/// # Errors
/// As [`steer`], and when table or coins are not found or are lost. [`CalibrationFault::TooWeak`] when the strongest
/// pulse moves no coin; [`CalibrationFault::StepChanged`] or [`CalibrationFault::Changed`] when the closing pulses
/// differ from the opening ones.
pub fn calibrate(
    rig: &mut dyn Rig,
    model: &RigModel,
    fingerprint: &str,
    params: &CalibrationParams,
    stop: &AtomicBool,
    progress: &mut dyn FnMut(CalibrationProgress),
) -> Result<Library, CalibrationFault> {
    CalibrationSession::new(rig, model, stop, progress).work(|session| measure(session, fingerprint, params))
}

fn measure(
    session: &mut CalibrationSession<'_>,
    fingerprint: &str,
    params: &CalibrationParams,
) -> Result<Library, CalibrationFault> {
    let half_side_m = 0.5 * session.model.plate_side_m;
    let axes = axes::measure(session, params)?;
    let plate = resonance::measure(session)?.as_ref().map(AxisResonance::plate_response);
    session.plate = plate.unwrap_or_default();
    let mut library = Library {
        rig: session.model.name.clone(),
        fingerprint: fingerprint.to_owned(),
        motor_arrangement: session.model.motor_arrangement,
        plate_side_m: session.model.plate_side_m,
        base_radps: session.model.base_radps,
        attack_s: session.model.attack_s,
        rest_s: session.model.rest_s,
        accelerometer_gain: axes.accelerometer_gain,
        shapes: axes.shapes,
        entries: steering::measure(session, &axes, params, &displacement::motions(half_side_m, params.gentle_mps))?,
        displacement: Default::default(),
        fields: None,
        plate,
    };
    library.displacement = displacement::measure(session, &library, params)?;
    library.entries = steering::measure(session, &axes, params, &wanted(&axes, session.model, params))?;
    library.fields = fields::measure(session)?;
    closing::check(session, &axes)?;
    Ok(library)
}

/// The motions of a library for a rig with these axes.
fn wanted(axes: &Axes, model: &RigModel, params: &CalibrationParams) -> Vec<SteeringMotion> {
    let half_side_m = 0.5 * model.plate_side_m;
    let too_strong = axes.top_speed_mps(model.count_limit) > STRONG * params.gentle_mps;
    let gentle = if too_strong { steering::gentle_motions(half_side_m, params) } else { Vec::new() };
    [steering::strong_motions(half_side_m, params), gentle].concat()
}
