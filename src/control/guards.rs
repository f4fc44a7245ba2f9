//! Guards: checks that compare measurements with what must hold. Each finding is a [`Condition`](super::Condition) with
//! a code; depending on it the run goes on, waits or ends.

mod delay;
mod freshness;
mod motion;
mod steps;

use super::condition::Condition;

pub(super) use delay::{DelayGuard, PictureLag, PlateSwing, SwingVerdict};
pub(super) use freshness::{Freshness, StaleReason, StillnessGuard};
pub(super) use motion::{CoilResponses, MotionFinding, MotionGuard, PulseReading};
pub(super) use steps::{PulseOutcome, StepDeviation, StepGuard, went};

/// The active guards: all except one that a test may disable to prove that its absence is noticed.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Guards {
    asleep: Option<String>,
}

impl Guards {
    /// The codes of all guards that can be disabled.
    pub const CODES: [&str; 27] = [
        "camera_frozen",
        "camera_stale",
        "camera_dark",
        "camera_moved",
        "camera_late",
        "table_missing",
        "view_hidden",
        "foreign_part",
        "parts_jumped",
        "table_shape",
        "probe",
        "camera_still",
        "silence",
        "stale_plan",
        "two_looks",
        "part_count",
        "part_lost",
        "coil_fault",
        "accelerometer_fault",
        "motion_off",
        "part_stuck",
        "part_astray",
        "no_progress",
        "endless_progress",
        "time_limit",
        "edge_limit",
        "separation",
    ];

    /// All guards except the one with this code.
    pub fn without(code: &str) -> Self {
        Self { asleep: Some(code.to_owned()) }
    }

    /// True while the guard for `condition` is active.
    pub fn has(&self, condition: Condition) -> bool {
        self.has_code(condition.code())
    }

    /// The same for a guard whose code is not a condition's: `two_looks`, `probe`.
    pub fn has_code(&self, code: &str) -> bool {
        self.asleep.as_deref() != Some(code)
    }
}
