//! The papers' experiments, on the simulated plate and on the other machines of the same papers: each measures figures
//! and compares them with a closed form or with the paper's. Not used by runs.

#![allow(clippy::disallowed_methods, reason = "its figures may differ in the last bit")]

mod cli;
mod cor_map;
mod cor_steering;
mod coulomb_pump;
mod disc_friction;
mod experiment;
mod feeder;
mod field_span;
mod force_curve;
mod force_sign;
mod general_wave;
mod mchip;
mod numerics;
mod outcome;
mod pulse_law;
mod pulses;
mod pumped;
mod race_track;
mod recorded;
mod reference;
mod rock;
mod settings;
mod shaken;
mod sweep;
mod table;
#[cfg(test)]
mod testing;
mod texts;
mod topple;
mod two_parts;
mod vision;
mod waveform_fit;

pub use cli::main;

use outcome::{DataSheet, ExperimentResult, Figure};

use upm_core::rig::RigModel;
use upm_core::signal::{Drive, Envelope};
use upm_planning::cor_library::{AxisShape, PlateResponse, drive_for};
use upm_sim::{PartParams, SimParams};

/// The rig on which an experiment runs.
#[derive(Clone, Debug, PartialEq)]
pub struct LabRig {
    /// Model of the rig available to control.
    pub model: RigModel,
    /// Parameters of the simulated rig, including those unknown to control.
    pub sim: SimParams,
    /// The coin on the plate.
    pub penny: PartParams,
    /// Seed of noise and sensor errors.
    pub seed: u64,
}

impl LabRig {
    /// The drive of amplitudes (counts) that the papers give for motors around the plate (Fig. 4a).
    fn drive_around(&self, amplitudes: [i32; 4], shapes: &[AxisShape; 3], envelope: Envelope) -> Drive {
        let (arrangement, base_radps) = (self.model.motor_arrangement, self.model.base_radps);
        // the resonances from the rig's file: those that calibration would find
        let response = PlateResponse {
            natural_radps: self.sim.plate.resonance_hz.map(|hz| std::f64::consts::TAU * hz),
            damping_ratio: self.sim.plate.damping_ratio,
        };
        drive_for(arrangement, arrangement.turned(amplitudes), shapes, &response, base_radps, envelope)
    }
}

/// Reasons why an experiment gives no result.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum LabError {
    /// This rig cannot carry out the experiment, or its trace cannot be read.
    #[error("{0}")]
    Rig(String),
    /// A parameter that is not allowed, or for which the model does not hold.
    #[error("{0}")]
    Setting(String),
}
