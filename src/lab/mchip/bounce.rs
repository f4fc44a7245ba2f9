//! Closed forms for single bounces (equation sheet, section 3): every rim under the part hits it once a cycle, rising,
//! and slides under it throughout the impact.
//!
//! A rim rises at `a θ'` and moves forward at `z θ'`, `a` and `z` being its distances from the axis. A resonator is
//! light compared with the part, so an impact alone reverses it. Friction pushes the part forward while `z θ'` is above
//! the part's speed and backward after that, restitution included. It also acts on the resonator: with `m = μ z/a` the
//! normal impulse of restitution is `q = e √((1 + m)/(1 - m))` times that of compression.

use super::device::Device;
use super::part::PartShape;
use upm_core::units::GRAVITY_MPS2;

/// A part carried by single bounces.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Ride {
    /// Angular speed of a resonator when it hits, rad/s: `M g T a (1 + m)/((1 + q) N I)`.
    pub hit_radps: f64,
    /// Feed rate at which the tangential impulse of an impact is zero, m/s: `(1 - m)(1 - q)/2 z θ'`.
    pub rate_mps: f64,
    /// Opposing force that stops the part, N: `μ M g (1 - q)/(1 + q)`.
    pub stall_n: f64,
}

/// Single bounces of `part` on `ridges` rims at the height `height_m` above rest.
pub fn ride(device: &Device, part: &PartShape, ridges: f64, height_m: f64) -> Ride {
    let Device { restitution, friction, drive_hz, .. } = *device;
    let arm_m = -device.ridge_place_m;
    let above_m = device.rest_height_m() + height_m;
    let turn = friction * above_m / arm_m;
    let ratio = restitution * ((1.0 + turn) / (1.0 - turn)).sqrt();
    let weight_n = part.mass_kg * GRAVITY_MPS2;
    let hit_radps = weight_n * arm_m * (1.0 + turn) / (drive_hz * (1.0 + ratio) * ridges * device.inertia_kgm2());
    Ride {
        hit_radps,
        rate_mps: 0.5 * (1.0 - turn) * (1.0 - ratio) * above_m * hit_radps,
        stall_n: friction * weight_n * (1.0 - ratio) / (1.0 + ratio),
    }
}

#[cfg(test)]
mod tests {
    use super::super::drive::ResonatorDrive;
    use super::super::measures::{height_m, mean_rate_mps, samples_from};
    use super::super::run::{Run, Setup, Start};
    use super::*;

    #[test]
    fn stalling_force_stops_the_simulated_part() {
        let setup = Setup::published(ResonatorDrive { duty: 0.36, ..ResonatorDrive::plain() });
        let rate_mps = |force_n: f64| {
            let mut run = Run::new(setup.clone(), &Start::aligned());
            run.force_n.x = force_n;
            run.advance(0.15);
            (mean_rate_mps(samples_from(&run, 0.05)), height_m(&run, samples_from(&run, 0.05)).mean)
        };
        let (free_mps, height) = rate_mps(0.0);
        let stall_n = ride(&setup.device, &setup.part, 10.0, height).stall_n;
        assert!((stall_n / 0.0151e-5 - 1.0).abs() < 0.02, "{stall_n}");
        assert!(rate_mps(-stall_n).0.abs() < 0.1 * free_mps, "{:?} of {free_mps}", rate_mps(-stall_n));
    }
}
