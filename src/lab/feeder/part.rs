//! A point part on the feeder's plate, simulated from event to event, exact to rounding; and in closed form (Impulse
//! paper, Eqs. 3 to 7), where it slides all the time, or rides along for the end of the plateau.

use super::plate::PlateCycle;
use crate::LabError;
use upm_core::units::GRAVITY_MPS2;

/// Cycles after which a part that has not settled is assumed never to settle.
const MOST_CYCLES: usize = 200_000;
/// Change of speed over a cycle, in units of a T, below which a part has settled.
const SETTLED: f64 = 1e-13;
/// Slip, in units of a T, below which it is rounding.
const NO_SLIP: f64 = 1e-15;

/// Accelerations of a part while it slides.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sliding {
    /// Acceleration by friction `μ g`, m/s².
    pub drag_mps2: f64,
    /// Acceleration by an external force, m/s².
    pub push_mps2: f64,
}

/// A part after one cycle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FeederCycle {
    pub speed_mps: f64,
    pub way_m: f64,
}

impl Sliding {
    /// One cycle of `plate`, starting at `speed_mps`.
    pub fn cycle(&self, plate: &PlateCycle, speed_mps: f64) -> FeederCycle {
        let no_slip_mps = NO_SLIP * plate.accel_mps2 * plate.period_s;
        let mut now = FeederCycle { speed_mps, way_m: 0.0 };
        let mut plate_mps = 0.0;
        for [accel_mps2, length_s] in plate.stretches() {
            let mut left_s = length_s;
            // at most: slide, catch up, slide on or ride along
            while left_s > 0.0 {
                let slip_mps = plate_mps - now.speed_mps;
                let accel = self.accel_mps2(slip_mps, no_slip_mps, accel_mps2);
                let closing_mps2 = accel_mps2 - accel;
                let rides = slip_mps.abs() <= no_slip_mps;
                let until_s = if rides || slip_mps * closing_mps2 >= 0.0 { left_s } else { -slip_mps / closing_mps2 };
                let step_s = until_s.min(left_s);
                now.way_m += (now.speed_mps + 0.5 * accel * step_s) * step_s;
                now.speed_mps += accel * step_s;
                plate_mps += accel_mps2 * step_s;
                if until_s < left_s {
                    now.speed_mps = plate_mps;
                }
                left_s -= step_s;
            }
        }
        now
    }

    /// The part's acceleration at a slip of the plate against it; a part at rest on the plate follows it if friction
    /// suffices.
    fn accel_mps2(&self, slip_mps: f64, no_slip_mps: f64, plate_mps2: f64) -> f64 {
        let needed = plate_mps2 - self.push_mps2;
        if slip_mps.abs() > no_slip_mps {
            self.push_mps2 + self.drag_mps2.copysign(slip_mps)
        } else if needed.abs() <= self.drag_mps2 {
            plate_mps2
        } else {
            self.push_mps2 + self.drag_mps2.copysign(needed)
        }
    }

    /// The periodic steady cycle.
    ///
    /// # Errors
    ///
    /// A part that the external force carries away.
    pub fn settled(&self, plate: &PlateCycle) -> Result<FeederCycle, LabError> {
        let scale_mps = plate.accel_mps2 * plate.period_s;
        let mut speed_mps = 0.0;
        for _ in 0..MOST_CYCLES {
            let cycle = self.cycle(plate, speed_mps);
            if (cycle.speed_mps - speed_mps).abs() <= SETTLED * scale_mps {
                return Ok(cycle);
            }
            if cycle.speed_mps.abs() > scale_mps {
                break;
            }
            speed_mps = cycle.speed_mps;
        }
        Err(LabError::Setting("the force carries the part away: its mean friction cannot balance it".into()))
    }

    /// Mean speed from rest over `cycles` cycles after `settling` others, m/s.
    pub fn mean_mps(&self, plate: &PlateCycle, settling: usize, cycles: usize) -> f64 {
        let (mut speed_mps, mut way_m) = (0.0, 0.0);
        for i in 0..settling + cycles {
            let cycle = self.cycle(plate, speed_mps);
            speed_mps = cycle.speed_mps;
            way_m += if i < settling { 0.0 } else { cycle.way_m };
        }
        way_m / (cycles as f64 * plate.period_s)
    }

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

/// Duty from which the quasi-static part keeps the plate's largest speed: 5/8.
pub const SATURATION: f64 = 0.625;

/// Quasi-static feed rate (Eq. 3 and below it), m/s.
pub fn quasi_static_mps(plate: &PlateCycle) -> f64 {
    if plate.duty <= SATURATION { unsaturated_mps(plate) } else { plate.peak_mps() }
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
    use proptest::prelude::*;
    use upm_core::units::GRAVITY_MPS2;

    proptest! {
        /// Holds before and beyond saturation, whatever friction and force are against the plate's acceleration.
        #[test]
        fn rate_is_that_of_the_closed_form(
            duty in 0.5..0.999f64, share in 0.01..0.9f64, force in -0.95..0.95f64, period_s in 1e-3..0.1f64,
        ) {
            let plate = PlateCycle { accel_mps2: 150.0, period_s, duty };
            let drag_mps2 = share * plate.accel_mps2;
            let part = Sliding { drag_mps2, push_mps2: force * drag_mps2 };
            let rate_mps = part.settled(&plate).unwrap().way_m / period_s;
            let Some(exact_mps) = part.rate_mps(&plate) else {
                prop_assert!(part.least_accel_mps2() >= plate.accel_mps2);
                return Ok(());
            };
            let off = (rate_mps - exact_mps).abs() / (plate.accel_mps2 * period_s / 16.0);
            prop_assert!(off < 1e-8, "duty {duty}, share {share}, force {force}: {off}");
        }
    }

    #[test]
    fn force_beyond_friction_carries_the_part_away() {
        let plate = PlateCycle { accel_mps2: 100.0, period_s: 0.01, duty: 0.548 };
        let part = Sliding { drag_mps2: 0.5 * GRAVITY_MPS2, push_mps2: 6.0 };
        assert!(part.settled(&plate).unwrap_err().to_string().contains("carries the part away"));
    }
}

#[cfg(test)]
mod closed_form_tests {
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
