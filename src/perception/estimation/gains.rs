//! The accelerometers' gains, found from the plate's being rigid (UPM paper, App. B).
//!
//! The accelerations of two points of a rigid plate differ at right angles to the line between them, but for the pull
//! towards the centre, which does not turn round with the drive. So whatever the motion, half the difference of a
//! pulse and its reverse has nothing along that line: with channel c showing `m_c = g_c a_c` and `h_c = 1/g_c`
//!
//! ```text
//!   h_x1 m_x1 r_x + h_y1 m_y1 r_y - h_x2 m_x2 r_x - h_y2 m_y2 r_y = 0
//! ```
//!
//! for every coefficient of every motion. Motions along x, along y and about the centre fix the four gains up to
//! a common factor, which moves no centre of rotation.

use nalgebra::{Matrix4, Vector4};

use super::harmonics::Coefficients;
use upm_core::geometry::Vec2;
use upm_core::signal::CHANNELS;

/// How far gains are expected to be from 1, and how exactly a coefficient is read against the largest: they weigh
/// what the readings do not tell.
const EXPECTED_ERROR: f64 = 0.02;
const READING_ERROR: f64 = 1e-3;

/// The four channels' gains from `readings`, each the acceleration coefficients of a motion, half the difference of a
/// pulse and its reverse, any unit. What the readings leave open stays as near to 1 as it can; the inverse gains' mean
/// is 1.
pub fn relative_gains(readings: &[[Coefficients; CHANNELS]], accelerometer_in_plate_m: Vec2) -> [f64; CHANNELS] {
    let r = accelerometer_in_plate_m;
    let arms = Vector4::new(r.x, r.y, -r.x, -r.y);
    let mut normal = Matrix4::zeros();
    let rows = readings
        .iter()
        .flat_map(|reading| (0..4).map(move |k| Vector4::from_fn(|channel, _| reading[channel][k] * arms[channel])));
    for row in rows {
        normal += row * row.transpose();
    }
    let prior = normal.trace() * (READING_ERROR / EXPECTED_ERROR).powi(2) / (readings.len().max(1) as f64);
    let ones = Vector4::from_element(1.0);
    // Noise in the readings favours small inverse gains; their mean is therefore held.
    let held = ones * ones.transpose() * normal.trace();
    let inverse_gain = (normal + held + Matrix4::identity() * prior)
        .cholesky()
        .map_or(ones, |factor| ones - factor.solve(&(normal * ones)));
    let gain = inverse_gain.map(f64::recip);
    if gain.iter().all(|g| g.is_finite() && *g > 0.0) { gain.into() } else { [1.0; CHANNELS] }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use upm_core::geometry::Twist;

    const R1_M: Vec2 = Vec2::new(-0.09, -0.08);

    /// What four channels of these gains show of a motion's coefficients.
    fn shown(motions: &[[Twist; 4]], gain: &[f64; CHANNELS], r1_m: Vec2) -> Vec<[Coefficients; CHANNELS]> {
        let reading = |motion: &[Twist; 4]| {
            let at = |r: Vec2| motion.map(|twist| twist.velocity_at(r));
            let (one, two) = (at(r1_m), at(-r1_m));
            let channels = [one.map(|v| v.x), one.map(|v| v.y), two.map(|v| v.x), two.map(|v| v.y)];
            std::array::from_fn(|c| channels[c].map(|a| a * gain[c]))
        };
        motions.iter().map(reading).collect()
    }

    fn axis_motions() -> Vec<[Twist; 4]> {
        let [x, y, spin] = [Twist::new(9.0, 0.3, 0.0), Twist::new(0.2, 11.0, 1.0), Twist::new(0.1, -0.2, 120.0)];
        [x, y, spin].map(|t| [t * 0.1, t, t * -0.9, t * 0.2]).to_vec()
    }

    proptest! {
        #[test]
        fn gains_come_back_but_for_a_common_factor(errors in proptest::array::uniform4(-0.02..0.02f64)) {
            let gain = errors.map(|e| 1.0 + e);
            let found = relative_gains(&shown(&axis_motions(), &gain, R1_M), R1_M);
            let ratio: [f64; 4] = std::array::from_fn(|c| found[c] / gain[c]);
            let mean = ratio.iter().sum::<f64>() / 4.0;
            prop_assert!((found.map(f64::recip).iter().sum::<f64>() - 4.0).abs() < 1e-5, "{found:?}");
            prop_assert!(ratio.iter().all(|r| (r / mean - 1.0).abs() < 2e-4), "{ratio:?}");
        }

        #[test]
        fn what_the_readings_leave_open_stays_one(errors in proptest::array::uniform4(-0.02..0.02f64)) {
            // Along x alone: the x channels show their ratio, the y channels nothing; to the second order in the errors
            // they stay, since the mean is held.
            let gain = errors.map(|e| 1.0 + e);
            let motions = [[Twist::new(9.0, 0.0, 0.0); 4]];
            let found = relative_gains(&shown(&motions, &gain, R1_M), R1_M);
            prop_assert!((found[1] - 1.0).abs() < 4e-4 && (found[1] - found[3]).abs() < 1e-9);
            prop_assert!((found[0] / found[2] * gain[2] / gain[0] - 1.0).abs() < 2e-4);
        }
    }

    #[test]
    fn no_readings_no_correction() {
        assert_eq!(relative_gains(&[], R1_M), [1.0; CHANNELS]);
        assert_eq!(relative_gains(&[[[f64::NAN; 4]; CHANNELS]], R1_M), [1.0; CHANNELS]);
        assert_eq!(relative_gains(&[[[0.0; 4]; CHANNELS]], R1_M), [1.0; CHANNELS]);
    }
}
