use upm_core::coded_enum;

coded_enum! {
    /// Task of an episode.
    pub enum EpisodeTask {
        /// Every part goes to its target.
        Arrange = "arrange",
        /// Every part goes into its kind's bin.
        Sort = "sort",
        /// Every part goes to its target, and gets a new one there, until the time limit.
        Stream = "stream",
    }
}

coded_enum! {
    /// Meaning of an action. Zeros let the plate rest until the next frame.
    pub enum ActionKind {
        /// Shares, -1 to 1, of the spans of a synthesised motion's coefficients (x, y, spin; for each in turn cos and
        /// sin of every harmonic), then its sustain from -1 for none to 1 for the longest. A motion beyond the motors'
        /// limit is scaled down to it.
        Motion = "motion",
        /// The number of a rotation, and its signed distance on the rotation's typical belt, mm; one beyond the
        /// rotation's longest is that.
        Pulse = "pulse",
        /// Wanted step of every part, x and y, mm; the planner of synthesised fields takes as much of it as one pulse
        /// can, and learns how far each part goes.
        Steps = "steps",
    }
}

/// Outcome of one step.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct StepOutcome {
    /// Decrease of the parts' mean distance from their targets in this step, in halves of the plate's side, plus 1 for
    /// success, in a stream for every part that arrived. -1 for a part that fell off the plate.
    pub reward: f64,
    /// True at the end by success or by a part that fell off the plate.
    pub terminated: bool,
    /// True at the end by the time limit.
    pub truncated: bool,
    /// True once every part is at its target or in its bin; in a stream, in a step in which a part has arrived.
    pub is_success: bool,
    /// Contacts between parts that began in this step.
    pub collisions: u64,
    /// Parts that arrived in this step and got new places, in a stream.
    pub arrived: usize,
    /// Mean distance of the parts from their targets after the step, m.
    pub mean_distance_m: f64,
    /// Plate time since the episode began, s.
    pub plate_time_s: f64,
    /// True before the first step. [`Episodes`](super::Episodes) have it for the step after an end, which ignores its
    /// action.
    pub was_reset: bool,
}

impl StepOutcome {
    /// True if the episode ends with this step.
    pub fn is_last(&self) -> bool {
        self.terminated || self.truncated
    }
}
