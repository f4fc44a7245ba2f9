//! One step of friction on a sliding and spinning disc; see [`DiscFriction`].

use super::DiscFriction;

/// Slip, in steps of free deceleration, below which a step is solved implicitly.
const IMPLICIT_BELOW: f64 = 4.0;
/// Least value of `f² + (3t/2)²` on the limit curve: a demand inside this ellipse is met by sticking.
const INSIDE_LIMIT_CURVE: f64 = 0.87;
/// Steps of the search for a small slip after which the middle of its ends is taken.
const MOST_STEPS: usize = 40;
/// Value of its function that counts as zero.
const TOLERANCE: f64 = 1e-7;

impl DiscFriction {
    /// Shares of sliding and spinning that remain after one step with friction, each in 0..=1, for a disc of moment of
    /// inertia mR²/2. The arguments are the slip at the end of the step without friction; `reach_mps = μ g h` is the
    /// speed that friction can remove in one step.
    ///
    /// Small slip is solved implicitly: the slip at the end of the step is the one whose own friction explains it, and
    /// zero (the disc sticks) when friction can remove all of it, force and torque together.
    #[inline]
    pub fn remaining_slip_fractions(&self, slide_mps: f64, rim_mps: f64, reach_mps: f64) -> [f64; 2] {
        self.remaining_slip_fractions_of([slide_mps], [rim_mps], [reach_mps])[0]
    }

    /// [`Self::remaining_slip_fractions`] of several discs, bit for bit. A search waits most of its time for its own
    /// last step: side by side they take as long as the longest of them.
    ///
    /// Small slip, in units of the reach, solves `s₁ + f(e₁) = slide`, `r₁ + 2 t(e₁) = rim` for `e₁ = s₁/r₁`. At the
    /// solution `s₁ + r₁` is positive exactly when `(slide, rim/2)` lies outside the limit curve. The unknown is
    /// `x = s₁/(s₁+r₁)`, the root of a function that runs from `slide` at 0 to `-rim` at 1, found by regula falsi in
    /// which the value of the retained end is halved at every step (a variant of the Illinois method).
    #[inline(always)]
    pub fn remaining_slip_fractions_of<const N: usize>(
        &self,
        slide_mps: [f64; N],
        rim_mps: [f64; N],
        reach_mps: [f64; N],
    ) -> [[f64; 2]; N] {
        let (mut total, mut inverse, mut fractions) = ([0.0; N], [0.0; N], [[0.0; 2]; N]);
        for i in 0..N {
            total[i] = slide_mps[i] + rim_mps[i];
            inverse[i] = 1.0 / total[i];
        }
        let reduced = self.reduced_of(slide_mps, rim_mps, inverse);
        let (mut slide, mut rim, mut is_small) = ([0.0_f64; N], [0.0_f64; N], [false; N]);
        for i in 0..N {
            if total[i] > IMPLICIT_BELOW * reach_mps[i] {
                let ([force, torque], pull) = (reduced[i], reach_mps[i] * inverse[i]);
                fractions[i] = [1.0 - pull * force, 1.0 - 2.0 * pull * torque];
            } else if total[i] > 0.0 {
                (slide[i], rim[i]) = (slide_mps[i] / reach_mps[i], rim_mps[i] / reach_mps[i]);
                is_small[i] = slide[i] * slide[i] + (0.75 * rim[i]).powi(2) > INSIDE_LIMIT_CURVE;
            }
        }
        let mut is_open = is_small;
        // ends of the search with the values of its function, and where it came to its end
        let (mut low_x, mut high_x) = ([0.0_f64; N], [1.0_f64; N]);
        let (mut low, mut high) = (slide, rim.map(|rim| -rim));
        let (mut found_x, mut found_force, mut found_torque) = ([0.0_f64; N], [0.0_f64; N], [0.0_f64; N]);
        for _ in 0..MOST_STEPS {
            if !is_open.contains(&true) {
                break;
            }
            // discs that have been solved go along: a branch would cost more
            for i in 0..N {
                let x = (low_x[i] * high[i] - high_x[i] * low[i]) / (high[i] - low[i]);
                let [force, torque] = self.at_share_of_sliding(x);
                let value = (1.0 - x) * (slide[i] - force) - x * (rim[i] - 2.0 * torque);
                let (is_found, is_low) = (value.abs() <= TOLERANCE, value > 0.0);
                found_x[i] = if is_open[i] { x } else { found_x[i] };
                found_force[i] = if is_open[i] { force } else { found_force[i] };
                found_torque[i] = if is_open[i] { torque } else { found_torque[i] };
                is_open[i] &= !is_found;
                (low_x[i], high_x[i]) = if is_low { (x, high_x[i]) } else { (low_x[i], x) };
                (low[i], high[i]) = if is_low { (value, 0.5 * high[i]) } else { (0.5 * low[i], value) };
            }
        }
        for i in (0..N).filter(|&i| is_small[i]) {
            let middle = 0.5 * (low_x[i] + high_x[i]);
            let (x, [force, torque]) = match is_open[i] {
                true => (middle, self.at_share_of_sliding(middle)),
                false => (found_x[i], [found_force[i], found_torque[i]]),
            };
            let left = slide[i] - force + rim[i] - 2.0 * torque;
            let share = |part: f64, whole: f64| if whole > 0.0 { (part * left / whole).min(1.0) } else { 0.0 };
            fractions[i] = if left <= 0.0 { [0.0; 2] } else { [share(x, slide[i]), share(1.0 - x, rim[i])] };
        }
        fractions
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    /// 200 slip ratios from 1e-4 to 1e4, e = 1 and its near neighbours among them.
    fn slip_ratios() -> impl Iterator<Item = f64> {
        let spread = (0..190).map(|i| 10f64.powf(-4.0 + 8.0 * f64::from(i) / 189.0));
        let corner = [0.9, 0.99, 0.999, 0.9999, 1.0, 1.0001, 1.001, 1.01, 1.1, 1.2];
        spread.chain(corner)
    }

    #[test]
    fn quick_sticking_test_is_inside_the_limit_curve() {
        let smallest = slip_ratios()
            .map(|e| DiscFriction::shared().force_and_torque(e, 1.0))
            .map(|[force, torque]| force * force + (1.5 * torque).powi(2))
            .fold(f64::INFINITY, f64::min);
        assert!(smallest > INSIDE_LIMIT_CURVE, "{smallest}");
    }

    proptest! {
        /// A step never reverses slip, sticks exactly inside the limit curve, and meets the implicit equations.
        #[test]
        fn small_slips_are_solved_implicitly(slide in 0.0..3.0f64, rim in 0.0..3.0f64) {
            prop_assume!(slide + rim < IMPLICIT_BELOW);
            let friction = DiscFriction::shared();
            let [keep_slide, keep_rim] = friction.remaining_slip_fractions(slide, rim, 1.0);
            prop_assert!((0.0..=1.0).contains(&keep_slide) && (0.0..=1.0).contains(&keep_rim));
            let (slide_after, rim_after) = (keep_slide * slide, keep_rim * rim);
            if slide_after + rim_after > 1e-6 {
                let [force, torque] = friction.force_and_torque(slide_after, rim_after);
                prop_assert!((slide_after + force - slide).abs() < 1e-5 && (rim_after + 2.0 * torque - rim).abs() < 1e-5);
            } else {
                // Support of the limit set in every direction (v, u): F v + T u <= f v + t u.
                for e in slip_ratios() {
                    let [force, torque] = friction.force_and_torque(e, 1.0);
                    prop_assert!((slide * e + 0.5 * rim) / (force * e + torque) < 1.0 + 1e-5);
                }
            }
        }

        #[test]
        fn discs_side_by_side_are_solved_as_alone(discs in proptest::array::uniform4((0.0..6.0f64, 0.0..3.0f64))) {
            let friction = DiscFriction::shared();
            let alone = discs.map(|(slide, rim)| friction.remaining_slip_fractions(slide, rim, 1.0));
            let [slide, rim] = [discs.map(|disc| disc.0), discs.map(|disc| disc.1)];
            prop_assert_eq!(friction.remaining_slip_fractions_of(slide, rim, [1.0; 4]), alone);
        }

        #[test]
        fn large_slips_are_reduced_by_coulomb_friction(slide in 0.0..3.0f64, rim in 0.0..3.0f64) {
            prop_assume!(slide + rim > 0.1);
            let friction = DiscFriction::shared();
            let (reach, [force, torque]) = (1e-3, friction.force_and_torque(slide, rim));
            let [keep_slide, keep_rim] = friction.remaining_slip_fractions(slide, rim, reach);
            prop_assert!((slide * (1.0 - keep_slide) - reach * force).abs() < 1e-12);
            prop_assert!((rim * (1.0 - keep_rim) - 2.0 * reach * torque).abs() < 1e-12);
        }
    }
}
