//! Guards: checks that compare measurements with what must hold. Depending on the [`Finding`] the run goes on, waits or
//! ends.

mod delay;
mod freshness;
mod limits;
mod motion;
mod steps;

use upm_core::job::Finding;

pub(super) use delay::{DelayGuard, PictureLag, PlateSwing, SwingVerdict};
pub(super) use freshness::{Freshness, StillnessGuard, UnusableFrame};
pub(super) use limits::Limits;
pub(super) use motion::{CoilResponses, MotionFinding, MotionGuard, Sight};
pub(super) use steps::{PulseOutcome, StepGuard, went};

/// Pulses in 1,000 h: three a second, the most that a shipped rig plays.
const PULSES_PER_1000_H: f64 = 3.0 * 3.6e6;
/// Guards that rest on chance and share the accepted false alarms: motion, late pictures, steps.
const BY_CHANCE: f64 = 3.0;

/// The active guards, and how certain they must be.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Guards {
    /// The finding that is not looked for: a test may disable one to prove that its absence is noticed.
    pub without: Option<Finding>,
    /// False alarms in 1,000 h of plate time of a healthy rig, all guards together.
    pub false_alarms_per_1000_h: f64,
}

impl Default for Guards {
    fn default() -> Self {
        Self { without: None, false_alarms_per_1000_h: 1.0 }
    }
}

impl Guards {
    /// True while `finding` is looked for.
    pub fn has(&self, finding: Finding) -> bool {
        self.without != Some(finding)
    }

    /// Limits of the guards that rest on chance, for this number of parts.
    pub(super) fn limits(&self, parts: usize) -> Limits {
        let pulses_per_alarm = PULSES_PER_1000_H * BY_CHANCE / self.false_alarms_per_1000_h;
        Limits::new(libm::log(pulses_per_alarm), parts)
    }
}
