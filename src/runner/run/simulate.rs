//! The simulated rig without control: pulses played open loop, and the first frame of a job.

use super::RunError;
use super::setup::simulated_rig;
use crate::config::{JobSpec, SimulateSpec};
use upm_core::geometry::{Pose, Vec2};
use upm_core::rig::Rig;
use upm_core::signal::Frame;
use upm_sim::{self as sim, OpenLoopTrajectories};

/// Plays the pulses of an experiment on its parts, open loop.
pub fn simulate(spec: &SimulateSpec) -> Result<OpenLoopTrajectories, String> {
    let parts: Vec<_> = spec.parts.iter().map(|part| (part.params, Pose::at(part.position_m))).collect();
    sim::simulate(&spec.rig.sim, spec.plate, &parts, &spec.pulses, spec.base_radps, spec.sample_hz)
}

/// Returns the error that [`simulate`] would return, without playing anything.
pub fn check_simulate(spec: &SimulateSpec) -> Result<(), String> {
    sim::check_pulses(&spec.rig.sim, spec.plate, &spec.pulses, spec.base_radps)
}

/// First camera frame of a job with the ground truth.
#[derive(Clone, Debug)]
pub struct FirstFrame {
    /// The camera frame.
    pub frame: Frame,
    /// The plate's corners, px, clockwise from top left.
    pub corners_px: [Vec2; 4],
    /// Every part in the order of the job.
    pub parts: Vec<TruePart>,
}

/// True position of a part.
#[derive(Clone, Debug)]
pub struct TruePart {
    /// Id, kind and number within it.
    pub id: String,
    /// Name of its kind.
    pub kind: String,
    /// Its centre on the table, m.
    pub position_m: Vec2,
    /// Image position of that point of the plate, px.
    pub foot_px: Vec2,
}

/// Places the parts of `job` and takes a picture.
pub fn first_frame(job: &JobSpec) -> Result<FirstFrame, RunError> {
    let (mut rig, placed) = simulated_rig(job)?;
    let [width, height] = job.rig.model.frame_size_px;
    let mut frame = Frame::new(width, height);
    rig.capture(&mut frame)?;
    let seen_px = |p_m: Vec2| rig.image_from_table(p_m, 0.0);
    let h = 0.5 * job.rig.model.plate_side_m;
    let corners_px = [[-h, h], [h, h], [h, -h], [-h, -h]].map(|[x, y]| seen_px(Vec2::new(x, y)));
    let truth = rig.probe().read();
    let parts = truth.parts.iter().zip(placed).map(|(part, placed)| TruePart {
        kind: job.rig.kinds.get(placed.kind).map(|spec| spec.kind.name.clone()).unwrap_or_default(),
        id: placed.id,
        position_m: part.part_in_table.position_m,
        foot_px: seen_px(part.part_in_table.position_m),
    });
    Ok(FirstFrame { corners_px, parts: parts.collect(), frame })
}
