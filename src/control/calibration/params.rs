use crate::perception::ExpectedPart;
use upm_core::rig::PartKind;

/// Settings of a calibration.
#[derive(Clone, Debug, PartialEq)]
pub struct CalibrationParams {
    /// Rows and columns of the grid of centres on the plate.
    pub grid: usize,
    /// Radii of the rings of centres outside the plate, as multiples of half the plate's side.
    pub rings: Vec<f64>,
    /// Number of centres on each ring.
    pub ring_centers: usize,
    /// Number of directions of translation.
    pub translations: usize,
    /// Longest displacement to be measured, m.
    pub longest_m: f64,
    /// Largest number of sustains measured.
    pub sustains: usize,
    /// The kind of coin used for the measurement.
    pub kinds: Vec<PartKind>,
    /// The coins on the plate.
    pub coins: Vec<ExpectedPart>,
}

impl CalibrationParams {
    /// Settings for the full library, measured with these coins on the plate.
    pub fn full(kinds: Vec<PartKind>, coins: Vec<ExpectedPart>) -> Self {
        Self {
            grid: 15,
            rings: vec![1.6, 2.4, 4.0, 8.0],
            ring_centers: 16,
            translations: 48,
            longest_m: 12e-3,
            sustains: 91,
            kinds,
            coins,
        }
    }
}

/// Current stage of a calibration and its finished measurements.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CalibrationProgress {
    /// Name of the current measurement.
    pub stage: &'static str,
    /// Number of finished measurements in this stage.
    pub done: usize,
    /// Number of measurements in this stage.
    pub total: usize,
    /// Plate time so far, s.
    pub plate_time_s: f64,
}
