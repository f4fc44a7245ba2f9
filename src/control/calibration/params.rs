use crate::eyes::ExpectedPart;
use upm_core::rig::PartKind;

/// Settings of a calibration.
#[derive(Clone, Debug, PartialEq)]
pub struct CalibrationParams {
    /// Rows and columns of the grid of centres over the plate.
    pub grid: usize,
    /// Half the grid's side as a part of half the plate's.
    pub grid_reach: f64,
    /// Radii of the rings of centres outside the plate, as parts of half the plate's side.
    pub rings: Vec<f64>,
    /// Centres on each ring.
    pub ring_centers: usize,
    /// Directions of translation.
    pub translations: usize,
    /// Plate speed amplitude of the gentle motions, m/s; they make the shortest steps.
    pub gentle_mps: f64,
    /// Rows and columns of the gentle motions' grid of centres.
    pub gentle_grid: usize,
    /// Directions of gentle translation.
    pub gentle_translations: usize,
    /// Part of the motors' limit that is used.
    pub effort: f64,
    /// Sustain of the pulses that are read through the accelerometers, s.
    pub read_sustain_s: f64,
    /// Longest displacement to be measured, m.
    pub longest_m: f64,
    /// Most sustains measured.
    pub sustains: usize,
    /// The kind of coin on the plate.
    pub kinds: Vec<PartKind>,
    /// The coins.
    pub coins: Vec<ExpectedPart>,
}

impl CalibrationParams {
    /// The full library with these coins on the plate.
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

/// How far calibration has come.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CalibrationProgress {
    /// The measurement under way.
    pub stage: &'static str,
    /// Measurements done in this stage.
    pub done: usize,
    /// Measurements in this stage.
    pub total: usize,
    /// Plate time so far, s.
    pub plate_time_s: f64,
}
