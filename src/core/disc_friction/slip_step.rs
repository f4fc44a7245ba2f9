//! One step of friction on a sliding and spinning disc; see [`DiscFriction`].

use super::DiscFriction;

/// Slip, in steps of free deceleration, below which a step is solved implicitly.
const IMPLICIT_BELOW: f64 = 4.0;
/// Least value of `f² + (3t/2)²` on the limit curve: a demand inside this ellipse is met by sticking.
const INSIDE_LIMIT_CURVE: f64 = 0.87;

impl DiscFriction {
    /// Shares of sliding and spinning that remain after one step with friction, each in 0..=1, for a disc of moment of
    /// inertia mR²/2. The arguments are the slip at the end of the step without friction; `reach_mps = μ g h` is the
    /// speed that friction can remove in one step.
    ///
    /// Small slip is solved implicitly: the slip at the end of the step is the one whose own friction explains it, and
    /// zero (the disc sticks) when friction can remove all of it, force and torque together.
    #[inline]
    pub fn remaining_slip_fractions(&self, slide_mps: f64, rim_mps: f64, reach_mps: f64) -> [f64; 2] {
        self.explicit_slip_fractions(slide_mps, rim_mps, reach_mps)
            .unwrap_or_else(|| self.remaining_small_slip(slide_mps / reach_mps, rim_mps / reach_mps))
    }

    /// [`Self::remaining_slip_fractions`] of `N` discs, the same numbers to the last bit: their implicit steps are
    /// solved side by side, so that the processor works on one while it waits for another.
    pub fn remaining_slip_fractions_of_each<const N: usize>(
        &self,
        slide_mps: [f64; N],
        rim_mps: [f64; N],
        reach_mps: [f64; N],
    ) -> [[f64; 2]; N] {
        let mut fractions = [[0.0; 2]; N];
        let mut searches = [(0, SlipSearch::default()); N];
        let mut active = 0;
        for i in 0..N {
            if let Some(explicit) = self.explicit_slip_fractions(slide_mps[i], rim_mps[i], reach_mps[i]) {
                fractions[i] = explicit;
            } else if let Some(search) = SlipSearch::new(slide_mps[i] / reach_mps[i], rim_mps[i] / reach_mps[i]) {
                searches[active] = (i, search);
                active += 1;
            }
        }
        for _ in 0..SlipSearch::MOST_STEPS {
            searches[..active].iter_mut().for_each(|(_, search)| search.step(self));
            for k in (0..active).rev() {
                let (i, search) = searches[k];
                if search.has_ended() {
                    fractions[i] = search.fractions();
                    active -= 1;
                    searches[k] = searches[active];
                }
            }
            if active == 0 {
                break;
            }
        }
        for (i, search) in &mut searches[..active] {
            fractions[*i] = search.fractions_midway(self);
        }
        fractions
    }

    /// [`Self::remaining_slip_fractions`] where friction can be taken as constant over the step, or there is no slip.
    #[inline]
    fn explicit_slip_fractions(&self, slide_mps: f64, rim_mps: f64, reach_mps: f64) -> Option<[f64; 2]> {
        let total = slide_mps + rim_mps;
        if total > IMPLICIT_BELOW * reach_mps {
            let inverse = 1.0 / total;
            let [force, torque] = self.reduced(slide_mps, rim_mps, inverse);
            let pull = reach_mps * inverse;
            Some([1.0 - pull * force, 1.0 - 2.0 * pull * torque])
        } else if total > 0.0 {
            None
        } else {
            Some([0.0; 2])
        }
    }

    /// [`Self::remaining_slip_fractions`] for slips in units of the reach.
    #[cold]
    fn remaining_small_slip(&self, slide: f64, rim: f64) -> [f64; 2] {
        let Some(mut search) = SlipSearch::new(slide, rim) else { return [0.0; 2] };
        for _ in 0..SlipSearch::MOST_STEPS {
            search.step(self);
            if search.has_ended() {
                return search.fractions();
            }
        }
        search.fractions_midway(self)
    }
}

/// Implicit step of small slip, in units of the reach: solves `s₁ + f(e₁) = slide`, `r₁ + 2 t(e₁) = rim` for
/// `e₁ = s₁/r₁`. At the solution `s₁ + r₁` is positive exactly when `(slide, rim/2)` lies outside the limit curve.
///
/// The unknown is `x = s₁/(s₁+r₁)`, the root of a function that runs from `slide` at 0 to `-rim` at 1, found by regula
/// falsi in which the value of the retained end is halved at every step (a variant of the Illinois method).
#[derive(Clone, Copy, Default)]
struct SlipSearch {
    slide: f64,
    rim: f64,
    /// Place and value of the ends.
    low: (f64, f64),
    high: (f64, f64),
    /// Place and value last tried, with force and torque there.
    tried: (f64, f64),
    pull: [f64; 2],
}

impl SlipSearch {
    /// Steps after which the middle of the ends is taken.
    const MOST_STEPS: usize = 40;
    /// Value that counts as zero.
    const TOLERANCE: f64 = 1e-7;

    /// `None` where the disc sticks.
    #[inline]
    fn new(slide: f64, rim: f64) -> Option<Self> {
        let moves = slide * slide + (0.75 * rim).powi(2) > INSIDE_LIMIT_CURVE;
        moves.then_some(Self { slide, rim, low: (0.0, slide), high: (1.0, -rim), tried: (0.0, 0.0), pull: [0.0; 2] })
    }

    #[inline]
    fn step(&mut self, friction: &DiscFriction) {
        let Self { slide, rim, low, high, .. } = *self;
        let x = (low.0 * high.1 - high.0 * low.1) / (high.1 - low.1);
        self.pull = friction.at_share_of_sliding(x);
        let value = (1.0 - x) * (slide - self.pull[0]) - x * (rim - 2.0 * self.pull[1]);
        self.tried = (x, value);
        let is_low = value > 0.0;
        self.low = if is_low { self.tried } else { (low.0, 0.5 * low.1) };
        self.high = if is_low { (high.0, 0.5 * high.1) } else { self.tried };
    }

    #[inline]
    fn has_ended(&self) -> bool {
        self.tried.1.abs() <= Self::TOLERANCE
    }

    /// Remaining fractions at the place last tried.
    #[inline]
    fn fractions(&self) -> [f64; 2] {
        let Self { slide, rim, tried: (x, _), pull: [force, torque], .. } = *self;
        let left = slide - force + rim - 2.0 * torque;
        if left <= 0.0 {
            return [0.0; 2];
        }
        let share = |part: f64, whole: f64| if whole > 0.0 { (part * left / whole).min(1.0) } else { 0.0 };
        [share(x, slide), share(1.0 - x, rim)]
    }

    #[cold]
    fn fractions_midway(&mut self, friction: &DiscFriction) -> [f64; 2] {
        self.tried.0 = 0.5 * (self.low.0 + self.high.0);
        self.pull = friction.at_share_of_sliding(self.tried.0);
        self.fractions()
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::super::tests::slip_ratios;
    use super::*;

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
        fn large_slips_are_reduced_by_coulomb_friction(slide in 0.0..3.0f64, rim in 0.0..3.0f64) {
            prop_assume!(slide + rim > 0.1);
            let friction = DiscFriction::shared();
            let (reach, [force, torque]) = (1e-3, friction.force_and_torque(slide, rim));
            let [keep_slide, keep_rim] = friction.remaining_slip_fractions(slide, rim, reach);
            prop_assert!((slide * (1.0 - keep_slide) - reach * force).abs() < 1e-12);
            prop_assert!((rim * (1.0 - keep_rim) - 2.0 * reach * torque).abs() < 1e-12);
        }
    }

    proptest! {
        #[test]
        fn discs_side_by_side_have_the_bits_of_one_alone(
            slips in prop::collection::vec((0.0..3.0f64, 0.0..3.0f64, 1e-3..2.0f64), 8), still in 0..4usize,
        ) {
            let friction = DiscFriction::shared();
            let at = |i: usize| if i < still { [(0.0, 1.0, 0.3), (1.0, 0.0, 0.3), (0.0, 0.0, 1.0), (0.1, 0.1, 1.0)][i] } else { slips[i] };
            let all: [(f64, f64, f64); 8] = std::array::from_fn(at);
            let found = friction.remaining_slip_fractions_of_each(all.map(|s| s.0), all.map(|s| s.1), all.map(|s| s.2));
            let alone = all.map(|(slide, rim, reach)| friction.remaining_slip_fractions(slide, rim, reach));
            prop_assert_eq!(found.map(|pair| pair.map(f64::to_bits)), alone.map(|pair| pair.map(f64::to_bits)));
        }
    }
}
