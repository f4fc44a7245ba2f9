use std::sync::{Arc, Mutex, PoisonError};

use crate::geometry::{Pose, Vec2};
use crate::time::PlateTime;

/// Where one part truly is.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PartTruth {
    /// Its pose on the table, x right, y up.
    pub part_in_table: Pose,
    /// Its velocity, m/s.
    pub velocity_mps: Vec2,
    /// False once its centre has left the plate.
    pub on_plate: bool,
}

/// The whole truth at the middle of an exposure.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Truth {
    /// When.
    pub at: PlateTime,
    /// Every part, in the order of the job.
    pub parts: Vec<PartTruth>,
    /// The vibrating plate against its place at rest.
    pub plate_in_table: Pose,
    /// Touches between parts so far, each counted once when it begins.
    pub collisions: u64,
}

/// A window on a simulated rig's truth, for recordings and reports. Control never holds one.
#[derive(Clone, Debug, Default)]
pub struct TruthProbe(Arc<Mutex<Truth>>);

impl TruthProbe {
    /// The truth as of the last captured frame.
    pub fn read(&self) -> Truth {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).clone()
    }

    /// Runs `change` on the shared truth.
    pub(super) fn update(&self, change: impl FnOnce(&mut Truth)) {
        change(&mut self.0.lock().unwrap_or_else(PoisonError::into_inner));
    }
}
