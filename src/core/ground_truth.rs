//! Ground truth: the true state of all bodies, as plain data. Only the simulator writes it; recordings and reports read
//! it. Control and everything it imports never name this module.

use std::sync::Arc;

use parking_lot::Mutex;

use crate::geometry::{Pose, Vec2};
use crate::time::PlateTime;

/// True state of one part.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PartTruth {
    /// Pose on the table, x right, y up.
    pub part_in_table: Pose,
    /// Velocity, m/s.
    pub velocity_mps: Vec2,
    /// False once its centre has left the plate.
    pub on_plate: bool,
}

/// True state of the scene at the middle of an exposure.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct GroundTruth {
    /// Time of the exposure's middle.
    pub at: PlateTime,
    /// Every part, in the order of the job.
    pub parts: Vec<PartTruth>,
    /// Pose of the vibrating plate relative to its place at rest.
    pub plate_in_table: Pose,
    /// Contacts between parts so far, each counted once when it begins.
    pub collisions: u64,
}

/// Shared access to the truth of a simulated rig, for recordings and reports.
#[derive(Clone, Debug, Default)]
pub struct GroundTruthHandle(Arc<Mutex<TruthCell>>);

#[derive(Debug, Default)]
struct TruthCell {
    truth: GroundTruth,
    /// Maps each place of the list that is read to the rig's own index; the rig's order while empty.
    order: Vec<usize>,
}

impl GroundTruthHandle {
    /// The truth as of the last captured frame.
    pub fn read(&self) -> GroundTruth {
        let shared = self.0.lock();
        let mut truth = shared.truth.clone();
        if shared.order.len() == truth.parts.len() {
            truth.parts = shared.order.iter().filter_map(|&part| shared.truth.parts.get(part).copied()).collect();
        }
        truth
    }

    /// Reorders the parts to match `seen_m`: each next to the place where it was seen, m. Equal parts cannot be told
    /// apart on a plate, so the vision system that finds them names them.
    pub fn order_by(&self, seen_m: &[Vec2]) {
        let mut shared = self.0.lock();
        let mut left: Vec<usize> = (0..shared.truth.parts.len()).collect();
        let mut order = Vec::with_capacity(left.len());
        for place in seen_m {
            let away = |part: usize| (shared.truth.parts[part].part_in_table.position_m - place).norm_squared();
            let nearest = left.iter().enumerate().min_by(|(_, a), (_, b)| away(**a).total_cmp(&away(**b)));
            let Some((at, _)) = nearest else { break };
            order.push(left.remove(at));
        }
        order.append(&mut left);
        shared.order = order;
    }

    /// Changes the shared truth, with parts in the rig's own order. For the simulator, which owns it.
    pub fn update(&self, change: impl FnOnce(&mut GroundTruth)) {
        change(&mut self.0.lock().truth);
    }
}
