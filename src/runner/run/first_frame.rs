use super::bench::simulated_rig;
use crate::config::{Fault, JobSpec};
use upm_core::geometry::Vec2;
use upm_core::rig::{Rig, RigFault};
use upm_core::signal::Frame;

/// The first camera frame of a job and where everything truly is.
#[derive(Clone, Debug)]
pub struct FirstFrame {
    /// The frame.
    pub frame: Frame,
    /// The plate's corners, px, clockwise from top left.
    pub corners_px: [Vec2; 4],
    /// Every part in the order of the job.
    pub parts: Vec<TruePart>,
}

/// Where a part truly is.
#[derive(Clone, Debug)]
pub struct TruePart {
    /// Its name.
    pub id: String,
    /// Its kind.
    pub kind: String,
    /// Its centre on the table, m.
    pub position_m: Vec2,
    /// Where the camera sees that point of the plate, px.
    pub foot_px: Vec2,
}

/// Why there is no first frame.
#[derive(Debug, thiserror::Error)]
pub enum FirstFrameError {
    /// The parts find no places.
    #[error("{0}")]
    Job(Fault),
    /// The camera fails.
    #[error(transparent)]
    Rig(#[from] RigFault),
}

/// Places the parts of `job` and takes a picture.
pub fn first_frame(job: &JobSpec) -> Result<FirstFrame, FirstFrameError> {
    let (mut rig, placed) = simulated_rig(job).map_err(FirstFrameError::Job)?;
    let [width, height] = job.rig.model.frame_size_px;
    let mut frame = Frame::new(width, height);
    rig.capture(&mut frame)?;
    let seen_px = |p_m: Vec2| rig.camera().image_from_table(p_m, 0.0);
    let h = 0.5 * job.rig.model.plate_side_m;
    let corners_px = [[-h, h], [h, h], [h, -h], [-h, -h]].map(|[x, y]| seen_px(Vec2::new(x, y)));
    let truth = rig.probe().read();
    let parts = truth.parts.iter().zip(placed).map(|(part, placed)| TruePart {
        kind: job.kind(placed.kind).map(|spec| spec.kind.name.clone()).unwrap_or_default(),
        id: placed.id,
        position_m: part.part_in_table.position_m,
        foot_px: seen_px(part.part_in_table.position_m),
    });
    Ok(FirstFrame { corners_px, parts: parts.collect(), frame })
}
