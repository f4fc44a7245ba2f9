//! Accelerometer gains from the rigidity of the plate (UPM paper, App. B).
//!
//! The accelerations of two points of a rigid plate differ at right angles to the line between them, except for the
//! centripetal acceleration, which does not change sign with the drive. For every motion half the difference of a pulse
//! and its reverse therefore has no component along that line: with `m_c = g_c a_c` read by channel c and `h_c = 1/g_c`
//!
//! ```text
//!   h_x1 m_x1 r_x + h_y1 m_y1 r_y - h_x2 m_x2 r_x - h_y2 m_y2 r_y = 0
//! ```
//!
//! for every coefficient of every motion. Motions along x, along y and about the centre fix the four gains up to
//! a common factor, which moves no centre of rotation.

use nalgebra::{Matrix4, Vector4};

use super::Coefficients;
use upm_core::geometry::Vec2;
use upm_core::signal::CHANNELS;

/// Expected deviation of gains from 1, and relative error of a coefficient against the largest: the weights of the
/// prior where the readings do not determine a gain.
const EXPECTED_ERROR: f64 = 0.02;
const READING_ERROR: f64 = 1e-3;

/// The four channels' gains from `readings`, each the acceleration coefficients of a motion, half the difference of a
/// pulse and its reverse, any unit. Gains that the readings do not determine stay as near to 1 as possible; the mean of
/// the inverse gains is 1.
pub fn relative_gains(readings: &[[Coefficients; CHANNELS]], accelerometer_in_plate_m: Vec2) -> [f64; CHANNELS] {
    let normal = normal_matrix(readings, accelerometer_in_plate_m);
    let gain = inverse_gains(&normal, readings.len()).map(f64::recip);
    if gain.iter().all(|g| g.is_finite() && *g > 0.0) { gain.into() } else { [1.0; CHANNELS] }
}

/// Diagnosis of the four channels from the same readings, without the assumption that they work.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ChannelCheck {
    /// Root mean square of each channel over that of the strongest channel: near 0 for a dead one.
    pub share: [f64; CHANNELS],
    /// Gain of each channel as a multiple of their median: negative for a channel with its sign reversed. Meaningless
    /// while a channel is dead.
    pub gain: [f64; CHANNELS],
    /// Residual that no gains explain, as a fraction of the readings: 0 on a rigid plate, large when a channel measures
    /// something else.
    pub misfit: f64,
}

/// Checks the channels with `readings` as for [`relative_gains`]. Motions along x, along y and about the centre are
/// required, whatever drives them.
pub fn check_channels(readings: &[[Coefficients; CHANNELS]], accelerometer_in_plate_m: Vec2) -> ChannelCheck {
    let shown =
        |channel: usize| readings.iter().flat_map(|reading| reading[channel]).map(|c| c * c).sum::<f64>().sqrt();
    let shown: [f64; CHANNELS] = std::array::from_fn(shown);
    let most = shown.iter().copied().fold(f64::MIN_POSITIVE, f64::max);
    let normal = normal_matrix(readings, accelerometer_in_plate_m);
    let inverse = inverse_gains(&normal, readings.len());
    let mut sorted: [f64; CHANNELS] = inverse.into();
    sorted.sort_unstable_by(f64::total_cmp);
    let median = 0.5 * (sorted[1] + sorted[2]);
    let all = inverse.component_mul(&inverse).dot(&normal.diagonal());
    let misfit = (inverse.dot(&(normal * inverse)) / all.max(f64::MIN_POSITIVE)).max(0.0).sqrt();
    ChannelCheck { share: shown.map(|rms| rms / most), gain: inverse.map(|h| median / h).into(), misfit }
}

/// Matrix of the sum of squared rigidity residuals as a quadratic form in the inverse gains.
fn normal_matrix(readings: &[[Coefficients; CHANNELS]], accelerometer_in_plate_m: Vec2) -> Matrix4<f64> {
    let r = accelerometer_in_plate_m;
    let arms = Vector4::new(r.x, r.y, -r.x, -r.y);
    let mut normal = Matrix4::zeros();
    let rows = readings
        .iter()
        .flat_map(|reading| (0..4).map(move |k| Vector4::from_fn(|channel, _| reading[channel][k] * arms[channel])));
    for row in rows {
        normal += row * row.transpose();
    }
    normal
}

/// Inverse gains of mean 1 that minimise the sum of squares; 1 without readings.
fn inverse_gains(normal: &Matrix4<f64>, readings: usize) -> Vector4<f64> {
    let prior = normal.trace() * (READING_ERROR / EXPECTED_ERROR).powi(2) / (readings.max(1) as f64);
    let ones = Vector4::from_element(1.0);
    // Noise in the readings favours small inverse gains; their mean is therefore held.
    let held = ones * ones.transpose() * normal.trace();
    (normal + held + Matrix4::identity() * prior)
        .cholesky()
        .map_or(ones, |factor| ones - factor.solve(&(normal * ones)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use upm_core::geometry::Twist;

    const R1_M: Vec2 = Vec2::new(-0.09, -0.08);

    /// Readings of four channels with these gains for the coefficients of each motion.
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
        fn gains_are_recovered_up_to_a_common_factor(errors in proptest::array::uniform4(-0.02..0.02f64)) {
            let gain = errors.map(|e| 1.0 + e);
            let found = relative_gains(&shown(&axis_motions(), &gain, R1_M), R1_M);
            let ratio: [f64; 4] = std::array::from_fn(|c| found[c] / gain[c]);
            let mean = ratio.iter().sum::<f64>() / 4.0;
            prop_assert!((found.map(f64::recip).iter().sum::<f64>() - 4.0).abs() < 1e-5, "{found:?}");
            prop_assert!(ratio.iter().all(|r| (r / mean - 1.0).abs() < 2e-4), "{ratio:?}");
        }
    }

    #[test]
    fn check_channels_finds_the_one_that_is_dead_reversed_or_off() {
        for channel in 0..CHANNELS {
            let check = |its: f64| {
                let gain: [f64; CHANNELS] = std::array::from_fn(|c| if c == channel { its } else { 1.0 });
                check_channels(&shown(&axis_motions(), &gain, R1_M), R1_M)
            };
            assert!(check(0.0).share[channel] < 1e-9);
            for its in [-1.0, 0.6, 1.5] {
                let found = check(its);
                assert!((found.gain[channel] / its - 1.0).abs() < 0.05, "{channel}, {its}: {found:?}");
                assert!(found.gain.iter().filter(|gain| (*gain - 1.0).abs() < 0.05).count() == 3, "{found:?}");
                assert!(found.misfit < 0.01 && found.share.iter().all(|share| *share > 0.2), "{found:?}");
            }
        }
    }
}
