//! The rows of the UPM paper's Table 1, and their readings by the accelerometers of a rig.

use super::vectors::Vectors;
use crate::shaken::BarePlate;
use crate::{LabFault, LabRig};
use upm_control::calibration::Axes;
use upm_core::geometry::Vec2;
use upm_core::signal::Envelope;
use upm_core::units::INCH_M;
use upm_perception::estimation::{AccelerometerPair, fit_twist};
use upm_planning::cor_library::AxisShape;

/// One row of the paper's Table 1.
pub struct TableRow {
    pub name: &'static str,
    /// Amplitudes X1, X2, Y1, Y2 in units of 128 as sent.
    pub amplitudes: [i32; 4],
    /// Centre of rotation measured in the paper, in; its columns correspond to y and x of Eq. 15. It prints magnitudes:
    /// these signs are the ones that give its table's steps, except row e's along y: 0.04 where it prints 0.02.
    pub read_in: [f64; 2],
}

/// The rows of Table 1.
pub const ROWS: [TableRow; 6] = [
    TableRow { name: "a", amplitudes: [-1, -1, 1, 1], read_in: [0.22, 0.02] },
    TableRow { name: "b", amplitudes: [-2, 0, 1, 1], read_in: [-2.92, 0.04] },
    TableRow { name: "c", amplitudes: [-2, 0, 0, 2], read_in: [-2.72, 2.52] },
    TableRow { name: "d", amplitudes: [-1, -1, 0, 2], read_in: [0.18, 2.66] },
    TableRow { name: "e", amplitudes: [-1, -1, -1, 3], read_in: [0.14, 5.34] },
    TableRow { name: "f", amplitudes: [0, -2, -1, 3], read_in: [3.25, 5.54] },
];
/// Amplitude of one unit in the paper, counts.
const UNIT: i32 = 128;
/// Fraction of the motors' limit that the strongest row may use.
const EFFORT: f64 = 0.97;
/// `κ = I/(M r)` of the paper's plate, in, and largest deviation of a rig's for a comparison of the readings.
const PAPER_KAPPA_IN: f64 = 5.33;
const SAME_KAPPA: f64 = 0.02;
/// Sustain of each pulse, s.
const SUSTAIN_S: f64 = 0.25;

/// Measurement of one row.
#[derive(Clone, Copy, Debug)]
pub struct ReadRow {
    pub center_m: Vec2,
    pub vectors: Vectors,
}

/// Measurements of all rows.
pub struct Reads {
    /// Amplitude of one unit, counts.
    pub unit: i32,
    /// With the waveforms from calibration.
    pub compensated: Vec<ReadRow>,
    /// With the waveforms of Eq. 8.
    pub plain: Vec<ReadRow>,
}

/// Plays every row with both waveforms.
pub fn read_rows(lab: &LabRig) -> Result<Reads, LabFault> {
    let mut plate = BarePlate::new(lab);
    let axes = plate.axes()?;
    let sensors = AccelerometerPair { position_m: lab.model.accelerometer_in_plate_m, gain: axes.accelerometer_gain };
    let unit = unit_within_limits(lab, &axes);
    if unit < 1 {
        return Err(LabFault::Rig(format!("{}: its motors' limit leaves no amplitude for Table 1", lab.model.name)));
    }
    let mut read = |shapes: &[AxisShape; 3]| -> Result<Vec<ReadRow>, LabFault> {
        ROWS.iter()
            .map(|row| {
                let drive = lab.drive_around(row.amplitudes.map(|a| a * unit), shapes, envelope(lab));
                let trace = plate.play(&drive)?;
                let what = || format!("row {}", row.name);
                let fit = fit_twist(&trace, &drive.envelope, drive.base_radps, &sensors)
                    .map_err(|fault| LabFault::Trace { what: what(), fault })?;
                let center_m =
                    fit.pump.center_of_rotation().ok_or_else(|| LabFault::Rig(format!("{}: no spin", what())))?;
                Ok(ReadRow { center_m, vectors: Vectors::of(&fit, sensors.position_m) })
            })
            .collect()
    };
    let (compensated, plain) = (read(&axes.shapes)?, read(&[AxisShape::FREE_MASS; 3])?);
    Ok(Reads { unit, compensated, plain })
}

fn envelope(lab: &LabRig) -> Envelope {
    let sustain_s = SUSTAIN_S.min(lab.model.max_sustain_s);
    Envelope { attack_s: lab.model.attack_s, sustain_s, rest_s: lab.model.rest_s }
}

/// The paper's unit, or the largest with which every row stays within the motors' limit, with both waveforms.
fn unit_within_limits(lab: &LabRig, axes: &Axes) -> i32 {
    let peak = |row: &TableRow, shapes: &[AxisShape; 3]| {
        lab.drive_around(row.amplitudes.map(|a| a * UNIT), shapes, envelope(lab)).peak_counts()
    };
    let peaks = ROWS.iter().flat_map(|row| [peak(row, &axes.shapes), peak(row, &[AxisShape::FREE_MASS; 3])]);
    let room = EFFORT * lab.model.count_limit / peaks.fold(f64::MIN_POSITIVE, f64::max);
    (f64::from(UNIT) * room.min(1.0)) as i32
}

/// `κ = I/(M r)`, m.
pub fn kappa_m(lab: &LabRig) -> f64 {
    lab.model.plate_inertia_kgm2 / (lab.model.plate_mass_kg * lab.model.lever_arm_m)
}

/// True where Eq. 15 predicts the same for this rig as for the paper's.
pub fn compares_with_paper(lab: &LabRig) -> bool {
    (kappa_m(lab) / INCH_M / PAPER_KAPPA_IN - 1.0).abs() <= SAME_KAPPA
}

/// `C = κ (Y2 - Y1, X1 - X2)/S` (Eq. 15), m.
pub fn eq_15(lab: &LabRig, row: &TableRow) -> Vec2 {
    let [x1, x2, y1, y2] = row.amplitudes.map(f64::from);
    Vec2::new(y2 - y1, x1 - x2) * (kappa_m(lab) / ((y1 + y2) - (x1 + x2)))
}
