//! Dry friction under a disc that slides and spins at once.
//!
//! A disc of radius R, pressed uniformly on the plate by N, slides at v and spins at w against it.
//! Each patch of its face is pulled against its own slip with Coulomb's μ, so force and torque are integrals over
//! the face that depend on the slip ratio `e = v/(R w)` alone: `F = μ N f(e)`, `T = μ N R t(e)`.
//! Seen from the point about which the disc turns at this instant (at distance eR from its centre) slip is
//! perpendicular to the radius vector, the radial integral is elementary, and one over the angle remains
//! (`[f, t]` in `Ratio::integrals`). They are the complete elliptic integrals of Farkas, Bartels, Unger, Wolf,
//! Phys. Rev. Lett. 90, 248302 (2003):
//!
//! ```text
//! e ≤ 1:  f = 4/(3π e) [(1+e²) E(e) - (1-e²) K(e)]      t = 4/(9π) [(4-2e²) E(e) - (1-e²) K(e)]
//! e > 1:  f = 4/(3π) [(e²+1) E(1/e) - (e²-1) K(1/e)]    t = 4e/(9π) [(4-2e²) E(1/e) + (2e²-5+3/e²) K(1/e)]
//! ```
//!
//! Valid for flat contact with uniform pressure: the moment of inertia about the rim of a thin coin is neglected.

use std::f64::consts::{FRAC_PI_2, PI};
use std::sync::LazyLock;

/// Table cells on either side of e = 1.
const CELLS: usize = 256;
/// Points of the quadrature over a quarter turn: at e = 1, where it converges slowest, the error is below 1e-9.
const QUARTER_POINTS: usize = 256;
/// Slip, in steps of free deceleration, below which a step is solved implicitly.
const IMPLICIT_BELOW: f64 = 4.0;
/// Least value of `f² + (3t/2)²` on the limit curve: a demand inside this ellipse is met by sticking.
const INSIDE_LIMIT_CURVE: f64 = 0.87;

static SHARED: LazyLock<DiscFriction> = LazyLock::new(DiscFriction::new);

/// Friction force and torque of a disc, tabulated once.
///
/// With `s = v + R|w|` the table holds `f s/v` and `t s/(R|w|)`, which are finite and positive for every slip ratio,
/// over `± sqrt(|v - R|w|| / s)`: the root spreads out the logarithmic corner at e = 1, so that linear
/// interpolation is good to 2e-5 everywhere.
#[derive(Clone, Debug)]
pub struct DiscFriction {
    nodes: Box<[[f64; 2]; 2 * CELLS + 1]>,
}

impl DiscFriction {
    fn new() -> Self {
        let mut nodes = Box::new([[0.0; 2]; 2 * CELLS + 1]);
        for (i, node) in nodes.iter_mut().enumerate() {
            let root = i as f64 / CELLS as f64 - 1.0;
            let smaller_over_larger = (1.0 - root * root) / (1.0 + root * root);
            *node = if root < 0.0 {
                Ratio::Spinning(smaller_over_larger).reduced()
            } else {
                Ratio::Sliding(smaller_over_larger).reduced()
            };
        }
        Self { nodes }
    }

    /// The table, built at the first call.
    pub fn shared() -> &'static Self {
        &SHARED
    }

    /// `[f, t]`: friction force over `μ N` and torque over `μ N R` at sliding speed `slide_mps` ≥ 0 and
    /// rim speed `rim_mps = R|w|` ≥ 0; zero at rest.
    pub fn force_and_torque(&self, slide_mps: f64, rim_mps: f64) -> [f64; 2] {
        let total = slide_mps + rim_mps;
        if total <= 0.0 {
            return [0.0; 2];
        }
        let [force, torque] = self.reduced(slide_mps, rim_mps, 1.0 / total);
        [force * slide_mps / total, torque * rim_mps / total]
    }

    /// Shares of sliding and spinning that remain after one step with friction, each in 0..=1, for a disc of moment of
    /// inertia mR²/2. The arguments are the slip at the end of the step without friction; `reach_mps = μ g h` is the
    /// speed that friction can remove in one step.
    ///
    /// Small slip is solved implicitly: the slip at the end of the step is the one whose own friction explains it, and
    /// zero (the disc sticks) when friction can remove all of it, force and torque together.
    #[inline]
    pub fn remaining_slip_fractions(&self, slide_mps: f64, rim_mps: f64, reach_mps: f64) -> [f64; 2] {
        let total = slide_mps + rim_mps;
        if total > IMPLICIT_BELOW * reach_mps {
            let inverse = 1.0 / total;
            let [force, torque] = self.reduced(slide_mps, rim_mps, inverse);
            let pull = reach_mps * inverse;
            [1.0 - pull * force, 1.0 - 2.0 * pull * torque]
        } else if total > 0.0 {
            self.remaining_small_slip(slide_mps / reach_mps, rim_mps / reach_mps)
        } else {
            [0.0; 2]
        }
    }

    /// [`Self::remaining_slip_fractions`] for slips in units of the reach: solves `s₁ + f(e₁) = slide`,
    /// `r₁ + 2 t(e₁) = rim` for `e₁ = s₁/r₁`. At the solution `s₁ + r₁` is positive exactly when `(slide, rim/2)` lies
    /// outside the limit curve.
    #[cold]
    fn remaining_small_slip(&self, slide: f64, rim: f64) -> [f64; 2] {
        if slide * slide + (0.75 * rim).powi(2) <= INSIDE_LIMIT_CURVE {
            return [0.0; 2];
        }
        let (x, [force, torque]) = self.remaining_slip_fraction(slide, rim);
        let left = slide - force + rim - 2.0 * torque;
        if left <= 0.0 {
            return [0.0; 2];
        }
        let share = |part: f64, whole: f64| if whole > 0.0 { (part * left / whole).min(1.0) } else { 0.0 };
        [share(x, slide), share(1.0 - x, rim)]
    }

    /// `x = s₁/(s₁+r₁)`: root of a function that runs from `slide` at 0 to `-rim` at 1, by regula falsi in which the
    /// retained end is weighted by half (Illinois). Also returns force and torque there.
    fn remaining_slip_fraction(&self, slide: f64, rim: f64) -> (f64, [f64; 2]) {
        const TOLERANCE: f64 = 1e-7;
        let pull_at = |x: f64| (x, self.at_share_of_sliding(x));
        if slide == 0.0 || rim == 0.0 {
            return pull_at(if rim == 0.0 { 1.0 } else { 0.0 });
        }
        let (mut low, mut high) = ((0.0, slide), (1.0, -rim));
        for _ in 0..40 {
            let (x, [force, torque]) = pull_at((low.0 * high.1 - high.0 * low.1) / (high.1 - low.1));
            let here = (x, (1.0 - x) * (slide - force) - x * (rim - 2.0 * torque));
            if here.1.abs() <= TOLERANCE {
                return (x, [force, torque]);
            } else if here.1 > 0.0 {
                (low, high.1) = (here, 0.5 * high.1);
            } else {
                (high, low.1) = (here, 0.5 * low.1);
            }
        }
        pull_at(0.5 * (low.0 + high.0))
    }

    /// [`Self::force_and_torque`] at `x = v/(v + R|w|)`.
    #[inline]
    fn at_share_of_sliding(&self, x: f64) -> [f64; 2] {
        let [force, torque] = self.reduced(x, 1.0 - x, 1.0);
        [force * x, torque * (1.0 - x)]
    }

    #[inline]
    fn reduced(&self, slide: f64, rim: f64, inverse_total: f64) -> [f64; 2] {
        let difference = slide - rim;
        let root = (difference.abs() * inverse_total).sqrt().copysign(difference);
        let place = (root + 1.0) * CELLS as f64;
        let cell = (place as usize).min(2 * CELLS - 1);
        let along = place - cell as f64;
        let ([f0, t0], [f1, t1]) = (self.nodes[cell], self.nodes[cell + 1]);
        [f0 + along * (f1 - f0), t0 + along * (t1 - t0)]
    }
}

/// A slip ratio, stored so that the number is in 0..=1.
#[derive(Clone, Copy)]
enum Ratio {
    /// e ≤ 1: e itself.
    Spinning(f64),
    /// e ≥ 1: its inverse.
    Sliding(f64),
}

impl Ratio {
    /// `[f/e, t]` for e ≤ 1, `[f, e t]` for e ≥ 1.
    fn integrals(self) -> [f64; 2] {
        match self {
            Self::Spinning(e) => quarter_turn(|sin2, cos2| {
                let chord2 = 1.0 - e * e * cos2;
                [4.0 / PI * sin2 * chord2.sqrt(), 4.0 / (3.0 * PI) * chord2.powf(1.5)]
            }),
            Self::Sliding(k) => quarter_turn(|sin2, cos2| {
                let chord = (1.0 - k * k * sin2).sqrt();
                let torque = if chord > 0.0 { cos2 * cos2 / chord } else { 0.0 };
                [4.0 / PI * cos2 * chord, 4.0 / (3.0 * PI) * torque]
            }),
        }
    }

    /// `[f s/v, t s/(R w)]`, `s = v + R w`.
    fn reduced(self) -> [f64; 2] {
        let (Self::Spinning(smaller) | Self::Sliding(smaller)) = self;
        self.integrals().map(|integral| integral * (1.0 + smaller))
    }
}

/// Integral over 0..π/2 of a function of sin² and cos²: the trapezoidal rule, which converges faster than any power
/// for smooth periodic functions.
fn quarter_turn(integrand: impl Fn(f64, f64) -> [f64; 2]) -> [f64; 2] {
    let step = FRAC_PI_2 / QUARTER_POINTS as f64;
    let mut sum = [0.0; 2];
    for i in 0..=QUARTER_POINTS {
        let (sin, cos) = (step * i as f64).sin_cos();
        let weight = if i == 0 || i == QUARTER_POINTS { 0.5 * step } else { step };
        let value = integrand(sin * sin, cos * cos);
        sum = [sum[0] + weight * value[0], sum[1] + weight * value[1]];
    }
    sum
}

#[cfg(test)]
mod tests {
    use super::*;
    use ellip::{ellipe, ellipk};
    use proptest::prelude::*;

    /// 200 slip ratios from 1e-4 to 1e4, e = 1 and its near neighbours among them.
    fn slip_ratios() -> impl Iterator<Item = f64> {
        let spread = (0..190).map(|i| 10f64.powf(-4.0 + 8.0 * f64::from(i) / 189.0));
        let corner = [0.9, 0.99, 0.999, 0.9999, 1.0, 1.0001, 1.001, 1.01, 1.1, 1.2];
        spread.chain(corner)
    }

    fn closed_form(e: f64) -> [f64; 2] {
        let k = e.min(1.0 / e);
        let (big_e, big_k) = (ellipe(k * k).unwrap(), if k < 1.0 { ellipk(k * k).unwrap() } else { 0.0 });
        let (e2, scale) = (e * e, 4.0 / (9.0 * PI));
        if e <= 1.0 {
            let force = 3.0 / e * ((1.0 + e2) * big_e - (1.0 - e2) * big_k);
            [scale * force, scale * ((4.0 - 2.0 * e2) * big_e - (1.0 - e2) * big_k)]
        } else {
            let force = 3.0 * ((e2 + 1.0) * big_e - (e2 - 1.0) * big_k);
            let torque = e * ((4.0 - 2.0 * e2) * big_e + (2.0 * e2 - 5.0 + 3.0 / e2) * big_k);
            [scale * force, scale * torque]
        }
    }

    /// Coulomb's law summed over the face at polar midpoints about the disc's centre, without further assumptions.
    fn face_sum(e: f64) -> [f64; 2] {
        const RINGS: usize = 300;
        const SPOKES: usize = 600;
        let mut sum = [0.0; 2];
        for ring in 0..RINGS {
            let r = (ring as f64 + 0.5) / RINGS as f64;
            for spoke in 0..SPOKES {
                let (sin, cos) = (2.0 * PI * (spoke as f64 + 0.5) / SPOKES as f64).sin_cos();
                let (x, y) = (r * cos, r * sin);
                let (ux, uy) = (e - y, x);
                let weight = r / ux.hypot(uy);
                sum = [sum[0] + weight * ux, sum[1] + weight * (x * uy - y * ux)];
            }
        }
        sum.map(|s| s * 2.0 / (RINGS * SPOKES) as f64)
    }

    fn relative(value: f64, reference: f64) -> f64 {
        (value / reference - 1.0).abs()
    }

    #[test]
    fn table_agrees_with_the_elliptic_integrals() {
        let (mut worst, mut count) = (0.0f64, 0);
        for e in slip_ratios() {
            let table = DiscFriction::shared().force_and_torque(e, 1.0);
            // Cancellation leaves the closed form few digits at the ends, so the series replace it there.
            let exact = match e {
                e if e < 0.01 => [e - e.powi(3) / 8.0, 2.0 / 3.0 - e * e / 2.0],
                e if e > 100.0 => [1.0 - 1.0 / (8.0 * e * e), 1.0 / (4.0 * e) + 1.0 / (48.0 * e.powi(3))],
                e => closed_form(e),
            };
            worst = worst.max(relative(table[0], exact[0])).max(relative(table[1], exact[1]));
            count += 1;
        }
        assert_eq!(count, 200);
        assert!(worst < 2e-5, "{worst}");
    }

    #[test]
    fn table_agrees_with_the_sum_over_the_face() {
        let mut worst = 0.0f64;
        for e in slip_ratios() {
            let (table, sum) = (DiscFriction::shared().force_and_torque(e, 1.0), face_sum(e));
            worst = worst.max((table[0] - sum[0]).abs()).max((table[1] - sum[1]).abs());
            assert!(relative(table[0], sum[0]) < 5e-3 && relative(table[1], sum[1]) < 5e-3, "e {e}: {table:?} {sum:?}");
        }
        assert!(worst < 1e-4, "{worst}");
    }

    #[test]
    fn known_values() {
        let friction = DiscFriction::shared();
        let [force, torque] = friction.force_and_torque(1.0, 0.0);
        assert!((force - 1.0).abs() < 1e-14 && torque == 0.0);
        let [force, torque] = friction.force_and_torque(0.0, 1.0);
        assert!(force == 0.0 && (torque - 2.0 / 3.0).abs() < 1e-12);
        let [force, torque] = friction.force_and_torque(1.0, 1.0);
        assert!((force - 8.0 / (3.0 * PI)).abs() < 1e-9 && (torque - 8.0 / (9.0 * PI)).abs() < 1e-9);
        assert_eq!(friction.force_and_torque(0.0, 0.0), [0.0, 0.0]);
        // A disc that comes to rest slides and spins at the stationary ratio, f/(2t) = e: 0.653 (Farkas et al.).
        let [force, torque] = friction.force_and_torque(0.653, 1.0);
        assert!((force / (2.0 * torque) - 0.653).abs() < 2e-4);
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
        fn large_slips_are_reduced_by_coulomb_friction(slide in 0.0..3.0f64, rim in 0.0..3.0f64) {
            prop_assume!(slide + rim > 0.1);
            let friction = DiscFriction::shared();
            let (reach, [force, torque]) = (1e-3, friction.force_and_torque(slide, rim));
            let [keep_slide, keep_rim] = friction.remaining_slip_fractions(slide, rim, reach);
            prop_assert!((slide * (1.0 - keep_slide) - reach * force).abs() < 1e-12);
            prop_assert!((rim * (1.0 - keep_rim) - 2.0 * reach * torque).abs() < 1e-12);
        }
    }

    #[test]
    fn without_friction_nothing_changes() {
        assert_eq!(DiscFriction::shared().remaining_slip_fractions(0.3, 0.2, 0.0), [1.0, 1.0]);
        assert_eq!(DiscFriction::shared().remaining_slip_fractions(0.0, 0.0, 0.0), [0.0, 0.0]);
    }
}
