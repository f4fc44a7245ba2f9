//! Accelerations measured at each accelerometer, and the perpendiculars that intersect in the centre of rotation (UPM
//! paper, Fig. 11).

use nalgebra::Complex;

use crate::LabRig;
use crate::pulses::mm;
use upm_chart::{Chart, Color, Layer, Mark};
use upm_core::geometry::Vec2;
use upm_core::units::mm_from_m;
use upm_perception::estimation::TwistFit;

/// Length of the longest arrow, as a fraction of the plate's half side.
const ARROW: f64 = 0.5;
/// Length of a perpendicular beyond the centre, as a fraction of the plate's half side.
const BEYOND: f64 = 0.25;

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

    /// Chart of the table's outline, the accelerometers, their vectors and perpendiculars, and the measured centre.
    pub fn chart(&self, lab: &LabRig, row: &str, center_m: Vec2) -> Chart {
        let half_side_m = 0.5 * lab.model.plate_side_m;
        let longest = self.accel_mps2[0].norm().max(self.accel_mps2[1].norm()).max(f64::MIN_POSITIVE);
        let vectors = self.accel_mps2.map(|accel| mm(accel * (ARROW * half_side_m / longest))).to_vec();
        let mut layers = vec![Layer::plate(mm_from_m(half_side_m))];
        for (i, (place_m, accel)) in self.places_m.into_iter().zip(self.accel_mps2).enumerate() {
            let along = accel.norm().max(f64::MIN_POSITIVE).recip() * Vec2::new(-accel.y, accel.x);
            let way_m = (center_m - place_m).dot(&along);
            let end_m = place_m + along * (way_m + (BEYOND * half_side_m).copysign(way_m));
            let label = if i == 0 { "perpendiculars" } else { "" };
            layers.push(Layer::new(label, Mark::Dashes, Color::Gray, [mm(place_m), mm(end_m)]));
        }
        layers.extend([
            Layer::new("accelerometers", Mark::Dots, Color::Purple, self.places_m.map(mm)),
            Layer::new("their accelerations", Mark::Arrows { vectors }, Color::Orange, self.places_m.map(mm)),
            Layer::new("centre of rotation, read", Mark::Crosses, Color::Blue, [mm(center_m)]),
        ]);
        Chart::plate_map(
            format!("cor-steering-{row}"),
            format!("Row {row}: accelerations and centre of rotation (Fig. 11)"),
            None,
            layers,
        )
    }
}

#[cfg(test)]
mod tests {
    use super::super::rows::{ROWS, TableRow, read_rows};
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
