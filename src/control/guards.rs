//! Guards: what is measured is held against what must be so. Each finding is a [`Condition`](super::Condition) with a code;
//! a run goes on, waits or ends as it deserves.

mod delay;
mod freshness;
mod motion;
mod steps;

use super::condition::Condition;

pub(super) use delay::{DelayGuard, Late, Swing, SwingSeen};
pub(super) use freshness::{Freshness, Stale, StillnessGuard};
pub(super) use motion::{CoilResponses, Finding, MotionGuard, PulseReading};
pub(super) use steps::{StepGuard, Unlike, Went, went};

/// Which guards are awake: all, but for the one that a test of the tests puts to sleep.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Guards {
    asleep: Option<String>,
}

impl Guards {
    /// The codes of all guards that can sleep.
    pub const CODES: [&str; 26] = [
        "camera_frozen",
        "camera_stale",
        "camera_dark",
        "camera_moved",
        "camera_late",
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

    /// All guards but the one with this code: to see that its absence is noticed.
    pub fn without(code: &str) -> Self {
        Self { asleep: Some(code.to_owned()) }
    }

    /// True while the guard for `condition` is awake.
    pub fn has(&self, condition: Condition) -> bool {
        self.has_code(condition.code())
    }

    /// The same for one that is no condition: `two_looks`, `probe`.
    pub fn has_code(&self, code: &str) -> bool {
        self.asleep.as_deref() != Some(code)
    }
}
