use crate::config::{self, SimulateSpec};
use crate::geometry::Pose;
use crate::sim::{self, OpenLoopError, OpenPulse, Trajectories};

/// Plays the pulses of an experiment on its parts, open loop.
pub fn simulate(spec: &SimulateSpec) -> Result<Trajectories, OpenLoopError> {
    let at_rest = |position_m| Pose { position_m, heading_rad: 0.0 };
    let parts: Vec<_> = spec.parts.iter().map(|part| (part.params, at_rest(part.position_m))).collect();
    let pulses: Vec<_> =
        spec.pulses.iter().map(|pulse| OpenPulse { amplitude: pulse.pump, envelope: pulse.envelope }).collect();
    let mode = match spec.plate {
        config::PlateMode::Dynamic => sim::PlateMode::Dynamic,
        config::PlateMode::Kinematic => sim::PlateMode::Kinematic,
    };
    sim::simulate(&spec.rig.sim, mode, &parts, &pulses, spec.rig.model.base_radps, spec.sample_hz)
}
