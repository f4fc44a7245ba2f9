//! Closed forms of the feed rate (Impulse paper, Eqs. 3 to 7): a point part under Coulomb friction on a plate that
//! moves as [`PlateCycle`]. It slides all the time, or rides along for the end of the plateau.

use super::plate::PlateCycle;
use upm_core::units::GRAVITY_MPS2;

/// Duty from which the quasi-static part keeps the plate's largest speed: 5/8.
pub const SATURATION: f64 = 0.625;

/// Quasi-static feed rate (Eq. 3 and below it), m/s.
pub fn quasi_static_mps(plate: &PlateCycle) -> f64 {
    if plate.duty <= SATURATION { unsaturated_mps(plate) } else { plate.peak_mps() }
}

/// Feed rate without the quasi-static assumption (Eqs. 3 and 7), m/s.
pub fn feed_rate_mps(plate: &PlateCycle, friction: f64) -> f64 {
    if plate.duty <= saturation(plate.accel_mps2, friction) {
        return unsaturated_mps(plate);
    }
    let (a, drag) = (plate.accel_mps2, friction * GRAVITY_MPS2);
    plate.peak_mps() * ((a - drag) / (a + drag)).powi(2)
}

/// `(a T/4)(2 d - 1)` (Eq. 3), m/s.
fn unsaturated_mps(plate: &PlateCycle) -> f64 {
    0.25 * plate.accel_mps2 * plate.period_s * (2.0 * plate.duty - 1.0)
}

/// Duty from which the part catches up with the plate within its plateau (Eq. 5).
pub fn saturation(accel_mps2: f64, friction: f64) -> f64 {
    let (a, drag) = (accel_mps2, friction * GRAVITY_MPS2);
    (5.0 * a * a + drag * (drag - 2.0 * a)) / (8.0 * a * a)
}

/// Viscosity `K = 4 μ m g/(a T)` (Eq. 4), N s/m: the decrease of the mean friction with the part's speed.
pub fn viscosity_nspm(plate: &PlateCycle, friction: f64, mass_kg: f64) -> f64 {
    4.0 * friction * mass_kg * GRAVITY_MPS2 / (plate.accel_mps2 * plate.period_s)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn plate(duty: f64) -> PlateCycle {
        PlateCycle { accel_mps2: 150.0, period_s: 0.02, duty }
    }

    #[test]
    fn quasi_static_rate_peaks_at_five_eighths() {
        let peak = quasi_static_mps(&plate(SATURATION));
        assert!((peak - 150.0 * 0.02 / 16.0).abs() < 1e-12);
        assert!(quasi_static_mps(&plate(0.62)) < peak && quasi_static_mps(&plate(0.63)) < peak);
        assert_eq!((quasi_static_mps(&plate(0.5)), quasi_static_mps(&plate(1.0))), (0.0, 0.0));
    }

    /// Eq. 6 is Eq. 5 solved for the acceleration; both branches of the rate meet there.
    #[test]
    fn branches_meet_where_the_part_saturates() {
        for accel_mps2 in [100.0, 150.0, 200.0] {
            let duty = saturation(accel_mps2, 1.0);
            let ratio = (1.0 + 2.0 * (2.0 * duty - 1.0).sqrt()) / (5.0 - 8.0 * duty);
            assert!((ratio - accel_mps2 / GRAVITY_MPS2).abs() < 1e-9, "Eq. 6: {ratio}");
            let rate = |duty: f64| feed_rate_mps(&PlateCycle { accel_mps2, period_s: 0.02, duty }, 1.0);
            assert!((rate(duty + 1e-9) / rate(duty - 1e-9) - 1.0).abs() < 1e-6);
        }
    }

    #[test]
    fn optimal_duty_feeds_at_half_of_the_plates_largest_speed() {
        let plate = plate(2.0 - 2f64.sqrt());
        assert!((quasi_static_mps(&plate) / plate.peak_mps() - 0.5).abs() < 1e-12);
    }
}
