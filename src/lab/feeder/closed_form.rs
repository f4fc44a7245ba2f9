//! Closed forms of the feed rate (Impulse paper, Eqs. 3 to 7): a point part under Coulomb friction on a plate that
//! moves as [`PlateCycle`], with an external force or without. It slides all the time, or rides along for the end of
//! the plateau.

use super::part::Sliding;
use super::plate::PlateCycle;
use upm_core::units::GRAVITY_MPS2;

/// Duty from which the quasi-static part keeps the plate's largest speed: 5/8.
pub const SATURATION: f64 = 0.625;

/// Quasi-static feed rate (Eq. 3 and below it), m/s.
pub fn quasi_static_mps(plate: &PlateCycle) -> f64 {
    if plate.duty <= SATURATION { unsaturated_mps(plate) } else { plate.peak_mps() }
}

impl Sliding {
    /// Duty from which the part catches up with the plate within its plateau (Eq. 5): with the force `x = F/(μ m g)`,
    /// `½ + ⅛ ((1 - x)(1 - (1 + x) μ g/a))²`.
    pub fn saturation(&self, accel_mps2: f64) -> f64 {
        let share = self.push_mps2 / self.drag_mps2;
        let top = (1.0 - share) * (1.0 - (1.0 + share) * self.drag_mps2 / accel_mps2);
        0.5 + 0.125 * top * top
    }

    /// Least acceleration of the plate for the closed forms, m/s²: below it the part rides along on a flank.
    pub fn least_accel_mps2(&self) -> f64 {
        self.drag_mps2 + self.push_mps2.abs()
    }

    /// Feed rate, m/s: the mean of the speeds at which the part and the plate cross (Eqs. 3 and 4), and beyond
    /// saturation the way that the part falls behind the plate's largest speed (Eq. 7, here with a force). `None` where
    /// the part rides along on a flank.
    pub fn rate_mps(&self, plate: &PlateCycle) -> Option<f64> {
        let (a, drag, push) = (plate.accel_mps2, self.drag_mps2, self.push_mps2);
        let rate_mps = if plate.duty <= self.saturation(a) {
            unsaturated_mps(plate) + 0.25 * a * plate.period_s * push / drag
        } else {
            let behind = (drag - push) / (drag + push) / (a + drag - push).powi(2);
            plate.peak_mps() * (1.0 - 4.0 * a * drag * behind)
        };
        (a > self.least_accel_mps2()).then_some(rate_mps)
    }
}

/// `(a T/4)(2 d - 1)` (Eq. 3), m/s.
fn unsaturated_mps(plate: &PlateCycle) -> f64 {
    0.25 * plate.accel_mps2 * plate.period_s * (2.0 * plate.duty - 1.0)
}

/// Viscosity `K = 4 μ m g/(a T)` (Eq. 4), N s/m: the decrease of the mean friction with the part's speed.
pub fn viscosity_nspm(plate: &PlateCycle, friction: f64, mass_kg: f64) -> f64 {
    4.0 * friction * mass_kg * GRAVITY_MPS2 / (plate.accel_mps2 * plate.period_s)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Eq. 6 is Eq. 5 solved for the acceleration; both branches of the rate meet there.
    #[test]
    fn branches_meet_where_the_part_saturates() {
        for accel_mps2 in [100.0, 150.0, 200.0] {
            let part = Sliding { drag_mps2: GRAVITY_MPS2, push_mps2: 0.0 };
            let duty = part.saturation(accel_mps2);
            let ratio = (1.0 + 2.0 * (2.0 * duty - 1.0).sqrt()) / (5.0 - 8.0 * duty);
            assert!((ratio - accel_mps2 / GRAVITY_MPS2).abs() < 1e-9, "Eq. 6: {ratio}");
            let rate = |duty: f64| part.rate_mps(&PlateCycle { accel_mps2, period_s: 0.02, duty }).unwrap();
            assert!((rate(duty + 1e-9) / rate(duty - 1e-9) - 1.0).abs() < 1e-6);
        }
    }
}
