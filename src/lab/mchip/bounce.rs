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

/// Opposing force that stops a part at the height `height_m` above rest, N: `μ M g (1 - q)/(1 + q)`, for any number of
/// ridges under it.
pub fn stall_n(device: &Device, part: &PartShape, height_m: f64) -> f64 {
    let turn = device.friction * (device.rest_height_m() + height_m) / -device.ridge_place_m;
    let ratio = device.restitution * ((1.0 + turn) / (1.0 - turn)).sqrt();
    device.friction * part.mass_kg * GRAVITY_MPS2 * (1.0 - ratio) / (1.0 + ratio)
}

#[cfg(test)]
mod tests {
    use super::super::drive::ResonatorDrive;
    use super::super::measures::{Spread, mean_rate_mps, samples_from};
    use super::super::run::{Run, Setup, Start};
    use super::*;

    #[test]
    fn stalling_force_stops_the_simulated_part() {
        let setup = Setup::published(ResonatorDrive { duty: 0.36, ..ResonatorDrive::plain() });
        let rate_mps = |force_n: f64| {
            let mut run = Run::new(setup, &Start::aligned());
            run.force_n.x = force_n;
            run.advance(0.15);
            let samples = samples_from(&run, 0.05);
            (mean_rate_mps(samples), Spread::of(samples.iter().map(|sample| run.height_m(&sample.state))).mean)
        };
        let (free_mps, height) = rate_mps(0.0);
        let stall_n = stall_n(&setup.device, &setup.part, height);
        assert!((stall_n / 0.0151e-5 - 1.0).abs() < 0.02, "{stall_n}");
        assert!(rate_mps(-stall_n).0.abs() < 0.1 * free_mps, "{:?} of {free_mps}", rate_mps(-stall_n));
    }
}
