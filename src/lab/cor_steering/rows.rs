//! The rows of the UPM paper's Table 1, and their readings by the accelerometers of a rig.

use nalgebra::Complex;

use crate::pulses::envelope;
use crate::shaken::BarePlate;
use crate::{LabError, LabRig};
use upm_control::calibration::Axes;
use upm_core::geometry::Vec2;
use upm_core::signal::Drive;
use upm_core::units::INCH_M;
use upm_perception::estimation::{AccelerometerPair, TwistFit};
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
pub fn read_rows(lab: &LabRig) -> Result<Reads, LabError> {
    let mut plate = BarePlate::new(lab);
    let axes = plate.axes()?;
    let sensors = AccelerometerPair { position_m: lab.model.accelerometer_in_plate_m, gain: axes.accelerometer_gain };
    let unit = unit_within_limits(lab, &axes);
    if unit < 1 {
        return Err(LabError::Rig(format!("{}: its motors' limit leaves no amplitude for Table 1", lab.model.name)));
    }
    let mut read = |row: &TableRow, shapes: &[AxisShape; 3]| {
        let (what, drive) = (format!("row {}", row.name), drive(lab, row, unit, shapes));
        let fit = plate.read(&what, &drive, &sensors)?;
        let center_m = fit.pump.center_of_rotation().ok_or_else(|| LabError::Rig(format!("{what}: no spin")))?;
        Ok(ReadRow { center_m, vectors: Vectors::of(&fit, sensors.position_m) })
    };
    let compensated = ROWS.iter().map(|row| read(row, &axes.shapes)).collect::<Result<_, LabError>>()?;
    let plain = ROWS.iter().map(|row| read(row, &[AxisShape::FREE_MASS; 3])).collect::<Result<_, LabError>>()?;
    Ok(Reads { unit, compensated, plain })
}

fn drive(lab: &LabRig, row: &TableRow, unit: i32, shapes: &[AxisShape; 3]) -> Drive {
    let envelope = envelope(lab, SUSTAIN_S.min(lab.model.max_sustain_s));
    lab.drive_around(row.amplitudes.map(|a| a * unit), shapes, envelope)
}

/// The paper's unit, or the largest with which every row stays within the motors' limit, with both waveforms.
fn unit_within_limits(lab: &LabRig, axes: &Axes) -> i32 {
    let peaks = ROWS.iter().flat_map(|row| {
        [axes.shapes, [AxisShape::FREE_MASS; 3]].map(|shapes| drive(lab, row, UNIT, &shapes).peak_counts())
    });
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

/// First harmonic of the acceleration at each of two accelerometers, m/s², with the signs of one common instant.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Vectors {
    /// Positions of the accelerometers, m.
    pub places_m: [Vec2; 2],
    pub accel_mps2: [Vec2; 2],
}

impl Vectors {
    /// Vectors of a fit; `place_m` is the first accelerometer's position, the second is opposite.
    pub fn of(fit: &TwistFit, place_m: Vec2) -> Self {
        let phasors = fit.accel_mps2.map(|[c1, s1, ..]| Complex::new(c1, -s1));
        // a rigid plate's channels oscillate in phase or in antiphase: squares add up whatever their signs
        let common = phasors.iter().map(|phasor| phasor * phasor).sum::<Complex<f64>>().sqrt();
        let turn = common.conj() / common.norm().max(f64::MIN_POSITIVE);
        let [x1, y1, x2, y2] = phasors.map(|phasor| (phasor * turn).re);
        Self { places_m: [place_m, -place_m], accel_mps2: [Vec2::new(x1, y1), Vec2::new(x2, y2)] }
    }

    /// Largest distance of `center_m` from the two perpendiculars, m.
    pub fn off_m(&self, center_m: Vec2) -> f64 {
        let off = |i: usize| {
            let accel = self.accel_mps2[i];
            (center_m - self.places_m[i]).dot(&accel).abs() / accel.norm().max(f64::MIN_POSITIVE)
        };
        off(0).max(off(1))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::lab_rig;
    use upm_core::geometry::cross;

    #[test]
    fn vectors_are_perpendicular_to_the_way_from_the_centre_and_turn_the_same_way() {
        let lab = lab_rig("upm-1");
        let reads = read_rows(&lab).unwrap();
        for (TableRow { name, .. }, read) in ROWS.iter().zip(&reads.compensated) {
            let off_m = read.vectors.off_m(read.center_m);
            assert!(off_m < 2e-3, "row {name}: {off_m}");
            let turn = |i: usize| cross(read.vectors.places_m[i] - read.center_m, read.vectors.accel_mps2[i]);
            assert!(turn(0) * turn(1) > 0.0, "row {name}: {read:?}");
        }
    }
}
