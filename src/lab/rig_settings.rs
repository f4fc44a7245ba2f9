//! Parameters of the simulated plate that experiments on it can be made with.

use std::f64::consts::TAU;

use super::LabRig;
use super::settings::{Field, Setting};

/// Parameters of a rig.
pub const SETTINGS: &[Setting<LabRig>] = &[
    Setting {
        key: "friction",
        about: "Coulomb friction between penny and plate",
        range: [0.01, 2.0],
        field: Field::Number(|rig| &mut rig.penny.friction, 1.0),
    },
    Setting {
        key: "base_hz",
        about: "base frequency of the drive",
        range: [20.0, 200.0],
        field: Field::Number(|rig| &mut rig.model.base_radps, TAU),
    },
    Setting {
        key: "accelerometer_noise_mps2",
        about: "noise of a sample of the accelerometers",
        range: [0.0, 10.0],
        field: Field::Number(|rig| &mut rig.sim.accelerometers.noise_mps2, 1.0),
    },
];
