use upm_core::geometry::Vec2;
use upm_core::signal::Frame;
use upm_core::time::PlateTime;
use upm_perception::vision::Track;

/// The parts as seen in one frame.
pub(super) struct Observation {
    pub(super) at: PlateTime,
    pub(super) tracks: Vec<Track>,
    /// True positions, m; empty on a rig without ground truth.
    pub(super) true_m: Vec<Vec2>,
    /// Frames tracked since the last observation, and the total time of tracking, µs.
    pub(super) tracked: (u32, f64),
    /// The frame, at the start of a cycle.
    pub(super) frame: Option<Frame>,
}

impl Observation {
    /// Measured positions, m.
    pub(super) fn measured_m(&self) -> Vec<Vec2> {
        self.tracks.iter().map(|track| track.seen.position_m).collect()
    }
}
