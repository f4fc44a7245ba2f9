//! Calibration of a rig: how its axes answer and how far its pulses carry parts (UPM paper, sections 3.2 and 4.1).
//!
//! 1. Axes: pulses along x, y and spin. The plate's rigidity gives the accelerometers' gains relative to each other;
//!    the response of both harmonics gives the pre-compensation of every axis and the gain matrix from motor amplitudes
//!    to the plate's twist.
//! 2. Resonances: a multisine on each axis; natural frequency and damping ratio from the accelerometers' spectra, by
//!    FFT. Every later pulse is computed with them.
//! 3. Displacement: a few motions, played as pulses of rising length; the camera measures how far the coins move. This
//!    step precedes the next one, whose many pulses carry the coins off the plate. Two looks at rest between two pulses
//!    give the camera's noise.
//! 4. Steering: centres of rotation on and around the plate and translations, each played in both directions as
//!    strongly as the motors allow and read back through the accelerometers.
//! 5. Fields, where the rig makes synthesised motions: each of their harmonics on each axis, read back likewise, gives
//!    the plate's response in amplitude and phase.
//! 6. Closing: the last pulses of the axes again, with the same drives, to detect a coil or channel that has changed.
//!
//! No measurement is accepted unchecked: channels must agree with the plate's rigidity, coils with the rig's data sheet
//! and with each other, and the closing pulses with the opening ones. A mismatch is refused with the component's name
//! ([`CalibrationError`]).

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

use upm_perception::estimation::OscillatorFit;
use upm_planning::cor_library::{Entry, FieldResponse, Library, PlateResponse};

pub use axes::Axes;
pub use fault::{CalibrationError, CoilError, MiswiredChannel, RigComponent};
pub use params::{CalibrationParams, CalibrationProgress};
pub use session::CalibrationSession;

impl CalibrationSession<'_> {
    /// Measures the response of the rig's axes with the accelerometers alone.
    ///
    /// # Errors
    /// [`CalibrationError::Rig`] when the rig refuses or fails, [`CalibrationError::Stopped`] once the session is
    /// stopped, and [`CalibrationError::Trace`] when a trace cannot be read. A channel, coil or axis that fails its
    /// check is [`CalibrationError::Channel`], [`CalibrationError::NotRigid`], [`CalibrationError::Coil`],
    /// [`CalibrationError::Coupled`], [`CalibrationError::Still`] or [`CalibrationError::Resonance`].
    pub fn axes(mut self) -> Result<Axes, CalibrationError> {
        axes::measure(&mut self)
    }

    /// The part of a library that needs accelerometers only: the axes, then every motion as strong as the motors allow.
    ///
    /// # Errors
    /// As [`Self::axes`]; [`CalibrationError::Singular`] when the axes do not move the plate independently.
    pub fn steer(mut self, params: &CalibrationParams) -> Result<(Axes, Vec<Entry>), CalibrationError> {
        let axes = axes::measure(&mut self)?;
        let motions = steering::wanted(&axes, self.model, params);
        let entries = steering::measure(&mut self, &axes, &motions)?;
        Ok((axes, entries))
    }

    /// Measures the plate's response to the synthesised motions of the rig with the accelerometers alone; `None` where
    /// the rig makes none.
    ///
    /// # Errors
    /// As [`Self::axes`].
    pub fn fields(mut self) -> Result<Option<FieldResponse>, CalibrationError> {
        axes::measure(&mut self)?;
        fields::measure(&mut self)
    }

    /// Measures the resonances of the rig's axes x, y and spin with the accelerometers alone; `None` where its longest
    /// sustain is too short to resolve them.
    ///
    /// # Errors
    /// As [`Self::axes`].
    pub fn resonances(mut self) -> Result<Option<[OscillatorFit; 3]>, CalibrationError> {
        axes::measure(&mut self)?;
        resonance::measure(&mut self)
    }

    /// Runs the full calibration of the rig and returns its library.
    ///
    /// # Errors
    /// As [`Self::steer`], and when table or coins are not found or are lost. [`CalibrationError::TooWeak`] when the
    /// strongest pulse moves no coin; [`CalibrationError::StepChanged`] or [`CalibrationError::Changed`] when the
    /// closing pulses differ from the opening ones.
    pub fn library(mut self, fingerprint: &str, params: &CalibrationParams) -> Result<Library, CalibrationError> {
        let (model, session) = (self.model, &mut self);
        let axes = axes::measure(session)?;
        let plate = resonance::measure(session)?.map(|axes| PlateResponse {
            natural_radps: axes.each_ref().map(|axis| axis.natural_radps),
            damping_ratio: axes.each_ref().map(|axis| axis.damping_ratio),
        });
        session.plate = plate.unwrap_or_default();
        let motions = displacement::motions(0.5 * model.plate_side_m);
        let mut library = Library {
            rig: model.name.clone(),
            fingerprint: fingerprint.to_owned(),
            motor_arrangement: model.motor_arrangement,
            plate_side_m: model.plate_side_m,
            base_radps: model.base_radps,
            attack_s: model.attack_s,
            rest_s: model.rest_s,
            accelerometer_gain: axes.accelerometer_gain,
            shapes: axes.shapes,
            entries: steering::measure(session, &axes, &motions)?,
            displacement: Default::default(),
            camera_noise: None,
            fields: None,
            plate,
        };
        let (displacement, noise) = displacement::measure(session, &library, params)?;
        (library.displacement, library.camera_noise) = (displacement, Some(noise));
        library.entries = steering::measure(session, &axes, &steering::wanted(&axes, model, params))?;
        library.fields = fields::measure(session)?;
        closing::check(session, &axes)?;
        Ok(library)
    }
}
