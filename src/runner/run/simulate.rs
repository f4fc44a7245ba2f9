use crate::config::{self, PulseSpec, SimulateSpec};
use upm_core::geometry::Pose;
use upm_sim::{self as sim, OpenLoopError, OpenPulse, PlateMode, Trajectories};

/// Plays the pulses of an experiment on its parts, open loop.
pub fn simulate(spec: &SimulateSpec) -> Result<Trajectories, OpenLoopError> {
    let at_rest = |position_m| Pose { position_m, heading_rad: 0.0 };
    let parts: Vec<_> = spec.parts.iter().map(|part| (part.params, at_rest(part.position_m))).collect();
    sim::simulate(&spec.rig.sim, mode(spec), &parts, &pulses(spec), spec.base_radps, spec.sample_hz)
}

/// Refuses what [`simulate`] would refuse, without playing it.
pub fn check_simulate(spec: &SimulateSpec) -> Result<(), OpenLoopError> {
    sim::check_pulses(&spec.rig.sim, mode(spec), &pulses(spec), spec.base_radps)
}

fn pulses(spec: &SimulateSpec) -> Vec<OpenPulse> {
    let open = |pulse: &PulseSpec| OpenPulse { harmonics: pulse.harmonics.clone(), envelope: pulse.envelope };
    spec.pulses.iter().map(open).collect()
}

fn mode(spec: &SimulateSpec) -> PlateMode {
    match spec.plate {
        config::PlateMode::Dynamic => PlateMode::Dynamic,
        config::PlateMode::Kinematic => PlateMode::Kinematic,
    }
}
