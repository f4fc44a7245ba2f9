//! Guards: checks that compare measurements with what must hold. Depending on the [`Finding`] the run goes on, waits or
//! ends.

mod delay;
mod freshness;
mod motion;
mod steps;

use upm_core::job::Finding;

pub(super) use delay::{DelayGuard, PictureLag, PlateSwing, SwingVerdict};
pub(super) use freshness::{Freshness, StillnessGuard, UnusableFrame};
pub(super) use motion::{CoilResponses, MotionFinding, MotionGuard, PulseReading};
pub(super) use steps::{PulseOutcome, StepGuard, went};

/// The active guards: all except one that a test may disable to prove that its absence is noticed.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Guards {
    /// The finding that is not looked for.
    pub without: Option<Finding>,
}

impl Guards {
    /// True while `finding` is looked for.
    pub fn has(&self, finding: Finding) -> bool {
        self.without != Some(finding)
    }
}
