//! The Coulomb pump in closed form (UPM paper, Appendix A): a part that always slides on a plate of velocity
//! `A (cos wt - ½ cos 2wt)`, in the limit of fast vibration, where its own speed hardly changes within a cycle.
//!
//! Speeds are in units of A, forces in units of μ m g and times in units of A/(μ g), so that nothing depends on the
//! rig: `du/dτ = f(u)`, and the plate as a belt runs at u = 1/2.

use std::f64::consts::PI;

use super::numerics::runge_kutta;

/// Acceleration `A w` of the plate, in units of μ g, from which the pump carries a part forwards. Between the sticking
/// threshold, 0.57, and this value a part that sticks for some of the cycle creeps backwards. Found by simulation and
/// checked by a test.
pub(super) const CARRIED_FROM: f64 = 1.27;

/// Speed of the belt, in units of A.
pub(super) const BELT: f64 = 0.5;

/// Mean force over a cycle at a speed of 0 or more: `2 t₊/T - 1`, `t₊` from the roots of `cos a - ½ cos 2a = u`, of
/// which there is a second pair above the belt's speed and none above 3/4.
pub(super) fn mean_force(speed: f64) -> f64 {
    let root = (3.0 - 4.0 * speed).max(0.0).sqrt();
    let [far, near] = [1.0 - root, 1.0 + root].map(|twice_cos| (0.5 * twice_cos).min(1.0).acos());
    2.0 / PI * (far - near) - 1.0
}

/// Time in which a part gains `speed` from rest: the integral of `du/f(u)`, by Simpson's rule.
pub(super) fn time_to(speed: f64) -> f64 {
    const PAIRS: u32 = 500;
    let h = speed / f64::from(2 * PAIRS);
    let slowness = |i: u32| 1.0 / mean_force(h * f64::from(i));
    let inner = |k: u32| slowness(2 * k) + 4.0 * slowness(2 * k + 1) + slowness(2 * k + 2);
    (0..PAIRS).map(inner).sum::<f64>() * h / 3.0
}

/// Speeds of a part that starts from rest, at `count` instants `step` apart, the first at zero: Runge-Kutta's fourth
/// order.
pub(super) fn speeds(step: f64, count: usize) -> Vec<f64> {
    let next = |u: &f64| Some(runge_kutta([*u], step, |[u], _| [mean_force(u)])[0]);
    std::iter::successors(Some(0.0), next).take(count).collect()
}

/// Largest acceleration of the plate, in units of A w: the maximum of `|sin 2a - sin a|`, where `4 cos² a - cos a = 2`.
/// A part sticks as long as the plate's acceleration never exceeds μ g, hence up to `A w = μ g` over this.
pub(super) fn peak_acceleration() -> f64 {
    let cos = (1.0 - 33f64.sqrt()) / 8.0;
    ((1.0 - cos * cos).sqrt() * (2.0 * cos - 1.0)).abs()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ends_of_the_curve_are_the_papers() {
        assert!((mean_force(0.0) - 0.2386).abs() < 5e-5);
        assert!(mean_force(BELT).abs() < 1e-12);
    }

    #[test]
    fn force_is_the_share_of_the_cycle_in_which_the_plate_is_faster() {
        const POINTS: u32 = 200_000;
        for speed in [0.0, 0.1, 0.25, 0.4, 0.49, 0.6, 0.74, 0.76, 2.0] {
            let faster = (0..POINTS)
                .map(|i| 2.0 * PI * (f64::from(i) + 0.5) / f64::from(POINTS))
                .filter(|a| a.cos() - 0.5 * (2.0 * a).cos() > speed)
                .count();
            let force = 2.0 * faster as f64 / f64::from(POINTS) - 1.0;
            assert!((force - mean_force(speed)).abs() < 5e-5, "{speed}: {force}");
        }
    }
}
