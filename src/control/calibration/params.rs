use crate::perception::ExpectedPart;
use upm_core::rig::PartKind;

/// Settings of a calibration.
#[derive(Clone, Debug, PartialEq)]
pub struct CalibrationParams {
    /// Rows and columns of the grid of centres on the plate.
    pub grid: usize,
    /// Half the grid's side as a share of half the plate's side.
    pub grid_reach: f64,
    /// Radii of the rings of centres outside the plate, as multiples of half the plate's side.
    pub rings: Vec<f64>,
    /// Number of centres on each ring.
    pub ring_centers: usize,
    /// Number of directions of translation.
    pub translations: usize,
    /// Plate speed amplitude of the gentle motions, m/s; these make the shortest steps.
    pub gentle_mps: f64,
    /// Rows and columns of the gentle motions' grid of centres.
    pub gentle_grid: usize,
    /// Number of directions of gentle translation.
    pub gentle_translations: usize,
    /// Share of the motors' limit that is used.
    pub effort: f64,
    /// Sustain of steering pulses, s; axis pulses last at least 0.25 s.
    pub read_sustain_s: f64,
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
            grid_reach: 1.05,
            rings: vec![1.6, 2.4, 4.0, 8.0],
            ring_centers: 16,
            translations: 48,
            gentle_mps: 0.04,
            gentle_grid: 7,
            gentle_translations: 24,
            effort: 0.97,
            read_sustain_s: 0.1,
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
