use upm_core::geometry::Vec2;
use upm_core::ground_truth::GroundTruth;
use upm_core::time::PlateTime;
use upm_perception::vision::Track;

/// Consecutive observations, thinned out. Every list but `at` has `parts` values per observation.
#[derive(Clone, Debug, Default)]
pub(super) struct Samples {
    pub(super) parts: usize,
    pub(super) at: Vec<PlateTime>,
    pub(super) measured_m: Vec<Vec2>,
    pub(super) image_px: Vec<Vec2>,
    /// True positions, m; empty on a rig without ground truth.
    pub(super) true_m: Vec<Vec2>,
    /// Number of frames tracked, and the total time of tracking, µs.
    pub(super) tracked: (u32, f64),
}

impl Samples {
    pub(super) fn new(parts: usize) -> Self {
        Self { parts, ..Self::default() }
    }

    pub(super) fn is_empty(&self) -> bool {
        self.at.is_empty()
    }

    /// Adds one observation; one with another number of parts is ignored.
    pub(super) fn push(&mut self, at: PlateTime, tracks: &[Track], truth: Option<&GroundTruth>) {
        if tracks.len() != self.parts || truth.is_some_and(|truth| truth.parts.len() != self.parts) {
            return;
        }
        self.at.push(at);
        self.measured_m.extend(tracks.iter().map(|track| track.seen.position_m));
        self.image_px.extend(tracks.iter().map(|track| track.seen.center_px));
        self.true_m.extend(truth.into_iter().flat_map(|t| &t.parts).map(|part| part.part_in_table.position_m));
    }
}
