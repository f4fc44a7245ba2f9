use super::thinned_path;
use crate::run_end::RunEnd;
use upm_core::geometry::Vec2;
use upm_core::random::Streams;

/// Parameters of a dry run in addition to those of a run.
#[derive(Clone, Debug)]
pub struct DryRunParams {
    /// Starting position of each part, m.
    pub starts_m: Vec<Vec2>,
    /// Frames per second: time passes in whole frames.
    pub frame_hz: f64,
    /// Standard deviation of a part's displacement by its friction, relative to the others; 0.1 for a tenth.
    pub friction_spread: f64,
    /// Random streams of friction and scatter.
    pub streams: Streams,
    /// Number of this dry run among several of one job. In number 0 parts move as far as was measured; 1 and 2, 3 and
    /// 4 and so on are pairs of opposite friction.
    pub number: u64,
    /// Modelled computing time after which the dry run is broken off, ms.
    pub most_work_ms: f64,
}

/// Result of a dry run. All of it is predicted.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct DryRun {
    /// Outcome, cause and reason of its end.
    pub ending: RunEnd,
    /// True when it was broken off, neither at the goal nor failed.
    pub left_off: bool,
    /// The task's progress at the end, 0 to 1.
    pub progress: f64,
    /// Modelled computing time, ms: equal for equal jobs.
    pub work_ms: f64,
    /// Plate time, s. For a job without an end that is broken off, this and the counts are extrapolated to its limit at
    /// the pace so far.
    pub plate_time_s: f64,
    /// Number of cycles with pulses.
    pub cycles: u64,
    /// Number of pulses played.
    pub pulses: u64,
    /// Path of each part, m, from its start to its end, thinned out to at most [`DryRun::MOST_POINTS`].
    pub trails_m: Vec<Vec<Vec2>>,
    /// Target of each part when the dry run ended, m.
    pub targets_m: Vec<Vec2>,
    /// The least gap between two parts at any time; `None` with fewer than two.
    pub nearest: Option<ClosestApproach>,
    /// Reasons for infeasible plans, in order of first appearance.
    pub limits_met: Vec<LimitMet>,
    /// Root mean square distance, m, between the parts' positions after pulses and the forecasts with the learned
    /// gains; `None` without a pulse.
    pub prediction_error_m: Option<f64>,
}

/// The closest approach of two parts.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ClosestApproach {
    /// Gap between their rims, m; negative where they would have touched.
    pub gap_m: f64,
    /// Indices of the parts.
    pub parts: [usize; 2],
    /// Plate time at the end of the pulse with it, s.
    pub at_s: f64,
}

/// A limit that made plans infeasible.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct LimitMet {
    /// Its description: `penny-1 and penny-2 would come too close to each other`.
    pub limit: String,
    /// Number of plans it made infeasible.
    pub times: u64,
}

impl DryRun {
    /// Largest number of points of one part's trail.
    pub const MOST_POINTS: usize = thinned_path::MOST_POINTS;
}
