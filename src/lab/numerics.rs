//! Numerical methods that several experiments share.

use std::f64::consts::PI;

/// Intercept and slope of the least-squares line through `points`; NaN where all have one x.
pub(super) fn line_through(points: &[[f64; 2]]) -> [f64; 2] {
    let count = points.len() as f64;
    let mean = |axis: usize| points.iter().map(|at| at[axis]).sum::<f64>() / count;
    let (x, y) = (mean(0), mean(1));
    let slope = points.iter().map(|at| (at[0] - x) * (at[1] - y)).sum::<f64>()
        / points.iter().map(|at| (at[0] - x).powi(2)).sum::<f64>();
    [y - slope * x, slope]
}

/// Root mean square; NaN for no values.
pub(super) fn rms(values: &[f64]) -> f64 {
    (values.iter().map(|value| value * value).sum::<f64>() / values.len() as f64).sqrt()
}

/// Bisects the interval from `low` to `high` `halvings` times, keeping the half in which `is_high` becomes true.
pub(super) fn bisect([mut low, mut high]: [f64; 2], halvings: usize, mut is_high: impl FnMut(f64) -> bool) -> [f64; 2] {
    for _ in 0..halvings {
        let middle = 0.5 * (low + high);
        *(if is_high(middle) { &mut high } else { &mut low }) = middle;
    }
    [low, high]
}

/// Complete elliptic integrals of the first and second kind of the parameter `m`, from 0 to below 1, by the
/// arithmetic-geometric mean (Abramowitz and Stegun, 17.6.3 and 17.6.4); NaN for another parameter.
pub(super) fn complete_elliptic(m: f64) -> [f64; 2] {
    if !(0.0..1.0).contains(&m) {
        return [f64::NAN; 2];
    }
    let (mut a, mut b, mut weight, mut sum) = (1.0, (1.0 - m).sqrt(), 0.5, 0.5 * m);
    while a - b > f64::EPSILON * a {
        let c = 0.5 * (a - b);
        (a, b, weight) = (0.5 * (a + b), (a * b).sqrt(), 2.0 * weight);
        sum += weight * c * c;
    }
    let first_kind = 0.5 * PI / a;
    [first_kind, first_kind * (1.0 - sum)]
}

/// Elliptic integral of the first kind up to `amplitude_rad` of the parameter `m`, from 0 to below 1, by the
/// arithmetic-geometric mean (Abramowitz and Stegun, 17.6.8 and 17.6.9); NaN for another parameter.
pub(super) fn elliptic_f(amplitude_rad: f64, m: f64) -> f64 {
    if !(0.0..1.0).contains(&m) {
        return f64::NAN;
    }
    let (mut a, mut b, mut angle_rad, mut scale) = (1.0, (1.0 - m).sqrt(), amplitude_rad, 1.0);
    while a - b > f64::EPSILON * a {
        let tan = angle_rad.tan();
        let half_turns = ((angle_rad - tan.atan()) / PI).round();
        angle_rad += (b / a * tan).atan() + PI * half_turns;
        (a, b, scale) = (0.5 * (a + b), (a * b).sqrt(), 2.0 * scale);
    }
    angle_rad / (scale * a)
}

/// `state` after `step` by the fourth-order Runge-Kutta method; `slope` has the state and the time since the beginning.
pub(super) fn runge_kutta<const N: usize>(
    state: [f64; N],
    step: f64,
    slope: impl Fn([f64; N], f64) -> [f64; N],
) -> [f64; N] {
    let along = |slope: [f64; N], time: f64| std::array::from_fn(|i| state[i] + slope[i] * time);
    let k1 = slope(state, 0.0);
    let k2 = slope(along(k1, 0.5 * step), 0.5 * step);
    let k3 = slope(along(k2, 0.5 * step), 0.5 * step);
    let k4 = slope(along(k3, step), step);
    along(std::array::from_fn(|i| (k1[i] + 2.0 * (k2[i] + k3[i]) + k4[i]) / 6.0), step)
}

/// Non-maximum suppression: each of `sorted`, best first, that is `apart` from every better one that remains.
pub(super) fn suppress_neighbours<T>(sorted: impl IntoIterator<Item = T>, apart: impl Fn(&T, &T) -> bool) -> Vec<T> {
    let mut kept: Vec<T> = Vec::new();
    for one in sorted {
        if kept.iter().all(|other| apart(other, &one)) {
            kept.push(one);
        }
    }
    kept
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The integral of `1 / sqrt(1 - m sin²)`, or of its inverse for the second kind, by the midpoint rule.
    fn integrated(amplitude_rad: f64, m: f64, power: f64) -> f64 {
        const POINTS: i32 = 20_000;
        let step = amplitude_rad / f64::from(POINTS);
        let at = |i: i32| (1.0 - m * ((f64::from(i) + 0.5) * step).sin().powi(2)).powf(power);
        (0..POINTS).map(|i| step * at(i)).sum()
    }

    #[test]
    fn elliptic_integrals_are_the_integrals() {
        for m in [0.0, 0.3, 0.5, 0.9, 0.999] {
            let [first_kind, second_kind] = complete_elliptic(m);
            assert!((first_kind / integrated(PI / 2.0, m, -0.5) - 1.0).abs() < 1e-7, "K({m})");
            assert!((second_kind / integrated(PI / 2.0, m, 0.5) - 1.0).abs() < 1e-7, "E({m})");
            for amplitude_rad in [-1.0, 0.2, 1.5, PI / 2.0, 2.0, 4.0] {
                let off = elliptic_f(amplitude_rad, m) / integrated(amplitude_rad, m, -0.5) - 1.0;
                assert!(off.abs() < 1e-6, "F({amplitude_rad}, {m})");
            }
        }
        assert!([-0.1, 1.0, f64::NAN].iter().all(|&m| elliptic_f(1.0, m).is_nan() && complete_elliptic(m)[0].is_nan()));
    }
}
