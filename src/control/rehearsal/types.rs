use super::trail;
use crate::ending::Ending;
use upm_core::geometry::Vec2;
use upm_core::random::Streams;

/// Parameters of a rehearsal beside those of a run.
#[derive(Clone, Debug)]
pub struct RehearsalParams {
    /// Where each part starts, m.
    pub starts_m: Vec<Vec2>,
    /// Frames a second: time passes in whole frames.
    pub frame_hz: f64,
    /// Standard deviation of how far a part goes against the others, by its friction; 0.1 for a tenth.
    pub friction_spread: f64,
    /// Where friction and scatter are drawn from.
    pub streams: Streams,
    /// Which of several rehearsals of one job this is. In number 0 parts go as far as was measured; 1 and 2, 3 and 4 and so
    /// on are pairs of opposite friction.
    pub number: u64,
    /// Modelled computing time after which the rehearsal is left off, ms.
    pub most_work_ms: f64,
}

/// How a rehearsal went. Everything in it is predicted.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Rehearsal {
    /// How it ended and why.
    pub ending: Ending,
    /// True when it was left off, neither at the goal nor failed.
    pub left_off: bool,
    /// The goal's progress at the end, 0 to 1.
    pub progress: f64,
    /// Modelled computing time it took, ms: equal for equal jobs.
    pub work_ms: f64,
    /// Plate time it took, s. Of a job without an end that is left off this and the counts are those at its limit, at the
    /// pace so far.
    pub plate_time_s: f64,
    /// Cycles with pulses.
    pub cycles: u64,
    /// Pulses played.
    pub pulses: u64,
    /// For each part where it went, m: from its start to its end, thinned out to at most [`Rehearsal::MOST_POINTS`].
    pub trails_m: Vec<Vec<Vec2>>,
    /// For each part where it was to go when the rehearsal ended, m.
    pub targets_m: Vec<Vec2>,
    /// The least gap between two parts at any time; `None` with fewer than two.
    pub nearest: Option<Nearest>,
    /// Reasons for plans that were not made, in order of first appearance.
    pub limits_met: Vec<LimitMet>,
    /// How far parts ended from where pulses were forecast to bring them with what was learned, root mean square, m;
    /// `None` without a pulse.
    pub prediction_error_m: Option<f64>,
}

/// Two parts as near to each other as they came.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Nearest {
    /// Gap between their rims, m; negative where they would have touched.
    pub gap_m: f64,
    /// Indices of the parts.
    pub parts: [usize; 2],
    /// Plate time at the end of the pulse in which it was, s.
    pub at_s: f64,
}

/// A limit that made plans infeasible.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct LimitMet {
    /// Which, in words: `penny-1 and penny-2 would come too close to each other`.
    pub limit: String,
    /// How many plans.
    pub times: u64,
}

impl Rehearsal {
    /// Most points of one part's trail.
    pub const MOST_POINTS: usize = trail::MOST_POINTS;
}
