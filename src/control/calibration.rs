//! Calibration: what can this rig do, and how far do parts go when it does? (UPM paper, sections 3.2 and 4.1.)
//!
//! 1. Axes: pulses along x, y and spin; that the plate is rigid gives the accelerometers' gains against each other, the
//!    response of both harmonics the pre-compensation of every axis and the gain matrix from motor amplitudes to the
//!    plate's twist.
//! 2. Displacement: a few motions, pulses of rising length, the camera measures how far the coins go. This comes
//!    before the many pulses of the next step carry the coins off the plate.
//! 3. Steering: centres of rotation over and around the plate and translations, each played both ways at the
//!    strongest the motors allow and read back through the accelerometers.
//! 4. Fields: where the rig makes synthesised motions, each of their harmonics on each axis, read back likewise: the
//!    plate's answer in amplitude and phase.
//! 5. Resonances: a multisine on each axis; natural frequency and damping ratio from the accelerometers' spectra, by FFT.
//! 6. Closing: the last pulses of the axes again, the same drives. A coil or a channel that changed in between shows.
//!
//! Nothing that is measured is believed: channels must agree with the plate's rigidity, coils with the rig's data sheet
//! and with each other, the end with the beginning. What does not is refused by name ([`CalibrationFault`]).

mod axes;
mod channels;
mod closing;
mod coils;
mod displacement;
mod fault;
mod fields;
mod resonance;
mod steering;
mod workbench;

use std::sync::atomic::AtomicBool;

use super::eyes::ExpectedPart;
use steering::Motion;
use upm_core::rig::{PartKind, Rig, RigModel};
use upm_library::{Entry, FieldResponse, Library};
use workbench::Workbench;

pub use axes::Axes;
pub use fault::{CalibrationFault, ChannelFault, CoilFault, Component};
pub use resonance::AxisResonance;

/// A rig this many times faster than the gentle speed needs gentle motions of their own.
const STRONG: f64 = 2.0;

/// What to measure.
#[derive(Clone, Debug, PartialEq)]
pub struct CalibrationParams {
    /// Rows and columns of the grid of centres over the plate.
    pub grid: usize,
    /// Half the grid's side as a part of half the plate's.
    pub grid_reach: f64,
    /// Radii of the rings of centres outside the plate, as parts of half the plate's side.
    pub rings: Vec<f64>,
    /// Centres on each ring.
    pub ring_centers: usize,
    /// Directions of translation.
    pub translations: usize,
    /// Plate speed amplitude of the gentle motions, m/s; they make the shortest steps.
    pub gentle_mps: f64,
    /// Rows and columns of the gentle motions' grid of centres.
    pub gentle_grid: usize,
    /// Directions of gentle translation.
    pub gentle_translations: usize,
    /// Part of the motors' limit that is used.
    pub effort: f64,
    /// Sustain of the pulses that are read through the accelerometers, s.
    pub read_sustain_s: f64,
    /// Longest displacement to be measured, m.
    pub longest_m: f64,
    /// Most sustains measured.
    pub sustains: usize,
    /// The kind of coin on the plate.
    pub kinds: Vec<PartKind>,
    /// The coins.
    pub coins: Vec<ExpectedPart>,
}

impl CalibrationParams {
    /// The full library with these coins on the plate.
    pub fn full(kinds: Vec<PartKind>, coins: Vec<ExpectedPart>) -> Self {
        Self {
            grid: 15,
            grid_reach: 1.05,
            rings: vec![1.6, 2.4, 4.0, 8.0],
            ring_centers: 16,
            translations: 48,
            gentle_mps: 0.04,
            gentle_grid: 7,
            gentle_translations: 24,
            effort: 0.97,
            read_sustain_s: 0.1,
            longest_m: 12e-3,
            sustains: 91,
            kinds,
            coins,
        }
    }
}

/// How far calibration has come.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CalibrationProgress {
    /// What is being measured.
    pub stage: &'static str,
    /// Measurements done in this stage.
    pub done: usize,
    /// Measurements in this stage.
    pub total: usize,
    /// Plate time so far, s.
    pub plate_time_s: f64,
}

/// Measures how the axes of `rig` answer, by its accelerometers alone. Motors are at zero when this returns.
pub fn measure_axes(
    rig: &mut dyn Rig,
    model: &RigModel,
    params: &CalibrationParams,
    stop: &AtomicBool,
    progress: &mut dyn FnMut(CalibrationProgress),
) -> Result<Axes, CalibrationFault> {
    Workbench::new(rig, model, stop, progress).work(|bench| axes::measure(bench, params))
}

/// What the accelerometers alone can measure of a library: the axes, then every motion as strong as the motors
/// allow. Motors are at zero when this returns.
pub fn steer(
    rig: &mut dyn Rig,
    model: &RigModel,
    params: &CalibrationParams,
    stop: &AtomicBool,
    progress: &mut dyn FnMut(CalibrationProgress),
) -> Result<(Axes, Vec<Entry>), CalibrationFault> {
    Workbench::new(rig, model, stop, progress).work(|bench| {
        let axes = axes::measure(bench, params)?;
        let entries = steering::measure(bench, &axes, params, &wanted(&axes, model, params))?;
        Ok((axes, entries))
    })
}

/// Measures how the plate answers to the synthesised motions of `rig`, by its accelerometers alone; `None` where it
/// makes none. Motors are at zero when this returns.
pub fn measure_fields(
    rig: &mut dyn Rig,
    model: &RigModel,
    params: &CalibrationParams,
    stop: &AtomicBool,
    progress: &mut dyn FnMut(CalibrationProgress),
) -> Result<Option<FieldResponse>, CalibrationFault> {
    Workbench::new(rig, model, stop, progress).work(|bench| {
        axes::measure(bench, params)?;
        fields::measure(bench)
    })
}

/// Measures the resonances of `rig`'s axes x, y and spin, by its accelerometers alone; `None` where its longest sustain
/// is too short to tell them. Motors are at zero when this returns.
pub fn measure_resonances(
    rig: &mut dyn Rig,
    model: &RigModel,
    params: &CalibrationParams,
    stop: &AtomicBool,
    progress: &mut dyn FnMut(CalibrationProgress),
) -> Result<Option<[AxisResonance; 3]>, CalibrationFault> {
    Workbench::new(rig, model, stop, progress).work(|bench| {
        axes::measure(bench, params)?;
        resonance::measure(bench)
    })
}

/// Measures `rig` and returns its library. Motors are at zero when this returns.
pub fn calibrate(
    rig: &mut dyn Rig,
    model: &RigModel,
    fingerprint: &str,
    params: &CalibrationParams,
    stop: &AtomicBool,
    progress: &mut dyn FnMut(CalibrationProgress),
) -> Result<Library, CalibrationFault> {
    Workbench::new(rig, model, stop, progress).work(|bench| measure(bench, fingerprint, params))
}

fn measure(
    bench: &mut Workbench<'_>,
    fingerprint: &str,
    params: &CalibrationParams,
) -> Result<Library, CalibrationFault> {
    let half_side_m = 0.5 * bench.model.plate_side_m;
    let axes = axes::measure(bench, params)?;
    let plate = resonance::measure(bench)?.as_ref().map(AxisResonance::plate_response);
    bench.plate = plate.unwrap_or_default();
    let mut library = Library {
        rig: bench.model.name.clone(),
        fingerprint: fingerprint.to_owned(),
        plate_side_m: bench.model.plate_side_m,
        base_radps: bench.model.base_radps,
        attack_s: bench.model.attack_s,
        rest_s: bench.model.rest_s,
        accelerometer_gain: axes.accelerometer_gain,
        shapes: axes.shapes,
        entries: steering::measure(bench, &axes, params, &displacement::motions(half_side_m, params.gentle_mps))?,
        displacement: Default::default(),
        fields: None,
        plate,
    };
    library.displacement = displacement::measure(bench, &library, params)?;
    library.entries = steering::measure(bench, &axes, params, &wanted(&axes, bench.model, params))?;
    library.fields = fields::measure(bench)?;
    closing::check(bench, &axes)?;
    Ok(library)
}

/// The motions of a library for a rig with these axes.
fn wanted(axes: &Axes, model: &RigModel, params: &CalibrationParams) -> Vec<Motion> {
    let half_side_m = 0.5 * model.plate_side_m;
    let too_strong = axes.top_speed_mps(model.count_limit) > STRONG * params.gentle_mps;
    let gentle = if too_strong { steering::gentle_motions(half_side_m, params) } else { Vec::new() };
    [steering::strong_motions(half_side_m, params), gentle].concat()
}
