//! Guards: checks that compare measurements with what must hold. Depending on the [`Finding`] the run goes on, waits or
//! ends.

mod delay;
mod freshness;
mod motion;
mod steps;

use upm_core::job::{Evidence, Finding};

pub(super) use delay::{DelayGuard, NEVER, PlateSwing, corner_px};
pub(super) use freshness::{Freshness, Unusable};
pub(super) use motion::{MotionFinding, MotionGuard, Sight};
pub(super) use steps::{PulseOutcome, StepGuard, went};

/// Pulses from rest to rest in a second, the most that a shipped rig plays, and segments of a motion without pauses.
const PULSES_HZ: f64 = 3.0;
const SEGMENTS_HZ: f64 = 15.0;
const SECONDS_IN_1000_H: f64 = 3.6e6;
/// Guards that rest on chance and share the accepted false alarms: motion, late pictures, steps.
const BY_CHANCE: f64 = 3.0;

/// Evidence of healthy pulses has an exponential tail: `once + per_nat n` is exceeded in one pulse of `e^n`. These are
/// of pulses from rest to rest and of segments, by `tools/faults.py evidence`: deviations of a motion from its plan, in
/// tolerances (`--first 20000 --seeds 360`; 292 runs without pauses from 440000 on), and logarithms of a likelihood
/// ratio that pictures are late, or the plate elsewhere (`--first 710000 --seeds 160`). Errors of the model that repeat
/// make those up to 1.9 times as wide as chance would.
const MOTION: [(f64, f64); 2] = [(0.143, 0.0644), (0.078, 0.0347)];
const LATE: [(f64, f64); 2] = [(-9.2, 1.92), (-6.4, 1.48)];
/// Largest share of steps in which a part hardly moves: at most four did of those compared there and with `--first
/// 80000 --seeds 150`, 9.15 is its bound at 95 %.
const MISSED: f64 = 9.15 / 115_898.0;
/// Least number of missed steps in a row: one wrong observation spoils two.
const LEAST_IN_A_ROW: u32 = 3;

/// Share by which a swing or a step may be off its forecast and agrees with it, and from which on it is another one.
const SLIGHT: f64 = 0.2;
const GROSS: f64 = 0.5;

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

    /// Limits of the guards that rest on chance, for this number of parts and kind of motion, before there is evidence.
    pub(super) fn limits(&self, parts: usize, has_pauses: bool) -> Evidence {
        let kind = usize::from(!has_pauses);
        let pulses = SECONDS_IN_1000_H * [PULSES_HZ, SEGMENTS_HZ][kind];
        let nats = libm::log(pulses * BY_CHANCE / self.false_alarms_per_1000_h);
        let steps = (nats + libm::log(parts.max(1) as f64)) / -libm::log(MISSED);
        let [motion_limit, late_limit] = [MOTION, LATE].map(|of| of[kind].0 + of[kind].1 * nats);
        let steps_limit = (steps.ceil() as u32).max(LEAST_IN_A_ROW);
        Evidence { motion_limit, late_limit, steps_limit, ..Evidence::default() }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn more_false_alarms_give_lower_limits() {
        let limits = |rate| Guards { false_alarms_per_1000_h: rate, without: None }.limits(8, true);
        let [often, once, hardly] = [1000.0, 1.0, 0.001].map(limits);
        assert!(
            often.motion_limit < once.motion_limit && once.motion_limit < hardly.motion_limit,
            "{often:?} {once:?} {hardly:?}"
        );
        assert!((once.late_limit - often.late_limit - LATE[0].1 * 1000f64.ln()).abs() < 1e-9, "{often:?} {once:?}");
        let segments = SECONDS_IN_1000_H * SEGMENTS_HZ * BY_CHANCE;
        let moving = Guards::default().limits(8, false);
        assert!((moving.late_limit - LATE[1].0 - LATE[1].1 * segments.ln()).abs() < 1e-9, "{moving:?}");
        let steps = [1e7, 1.0, 1e-10].map(|rate| limits(rate).steps_limit);
        assert!(steps[0] == LEAST_IN_A_ROW && steps.is_sorted() && steps[2] > LEAST_IN_A_ROW, "{steps:?}");
    }
}
