use std::f64::consts::TAU;

use proptest::prelude::*;

use super::*;
use crate::cor_library::Library;

/// Fraction of the motors' limit that a motion fills.
const EFFORT: f64 = 0.99;

fn limit_counts() -> f64 {
    upm_2().fields.as_ref().unwrap().limit_counts
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(48))]

    /// For any initial scale and any flanks, the strongest sample of the drive equals the motion's share of the limit.
    #[test]
    fn a_filled_motion_plays_up_to_its_share_of_the_limit(
        coefficients in motion(8), before in -3.0..3.0f64, periods in 0.5..3.0f64, on_path: bool,
    ) {
        let basis = if on_path { upm_2_basis().for_paths() } else { upm_2_basis() };
        let mut library = Library::clone(&upm_2());
        let fields = library.fields.as_mut().unwrap();
        fields.attack_s = periods * TAU / fields.base_radps;
        let effort = MotorEffort::new(&basis, &library, HALF_SIDE_M).unwrap();
        let mut filled: Vec<f64> = coefficients.iter().map(|c| c * 10f64.powf(before)).collect();
        effort.scale(&basis, &mut filled, f64::INFINITY);
        let ratio = filled[0] / coefficients[0];
        prop_assert!(ratio > 0.0, "the motion is made larger or smaller, not another");
        prop_assert!(filled.iter().zip(&coefficients).all(|(f, c)| (f - c * ratio).abs() < 1e-9 * ratio));
        let drive = library.field_drive(&basis.wave(&filled), basis.follows, 0.1).unwrap();
        let share = drive.peak_counts() / limit_counts();
        prop_assert!(share > 0.999 * EFFORT && share < 1.006 * EFFORT, "{share}");
    }

}
