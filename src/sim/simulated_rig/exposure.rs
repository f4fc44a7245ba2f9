use crate::CameraParams;
use upm_core::time::PlateTime;

/// Snapshots of a moving scene within one exposure; odd, so that one is at its middle.
pub(super) const EXPOSURE_SNAPSHOTS: usize = 5;
pub(super) const MIDDLE: usize = EXPOSURE_SNAPSHOTS / 2;

/// Largest exposure time, as a share of a frame.
const LONGEST: f64 = 0.9;

/// Instants at which the shutter opens and closes around the middle of frame `index`.
#[derive(Clone, Copy, Debug)]
pub(super) struct Exposure {
    pub(super) index: u64,
    pub(super) opens: PlateTime,
    pub(super) middle: PlateTime,
    length_s: f64,
}

impl Exposure {
    /// The first exposure after frame `last` that opens at `now` or later; it lasts `factor` times the configured time,
    /// at most nearly a frame.
    pub(super) fn next(params: &CameraParams, factor: f64, now: PlateTime, last: u64) -> Self {
        let longest_s = params.exposure_s.max(LONGEST / params.frame_hz);
        let length_s = (params.exposure_s * factor).clamp(0.0, longest_s);
        let index_now = ((now.secs() + 0.5 * length_s) * params.frame_hz).floor().max(0.0) as u64;
        let mut index = index_now.max(last + 1);
        loop {
            let middle = PlateTime::from_secs(index as f64 / params.frame_hz);
            let opens = PlateTime::from_nanos(middle.nanos().saturating_sub((0.5e9 * length_s).round() as u64));
            if opens >= now {
                return Self { index, opens, middle, length_s };
            }
            index += 1;
        }
    }

    /// Instant of snapshot `i`, the middle of its share of the exposure.
    pub(super) fn instant(&self, i: usize) -> PlateTime {
        self.opens + self.length_s * (i as f64 + 0.5) / EXPOSURE_SNAPSHOTS as f64
    }

    pub(super) fn closes(&self) -> PlateTime {
        self.opens + self.length_s
    }
}
