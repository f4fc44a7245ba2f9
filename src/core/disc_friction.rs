//! Dry friction under a disc that slides and spins at once.
//!
//! A disc of radius R, pressed uniformly on the plate by N, slides at v and spins at w against it.
//! Each patch of its face is pulled against its own slip with Coulomb's μ, so force and torque are integrals over
//! the face that depend on the slip ratio `e = v/(R w)` alone: `F = μ N f(e)`, `T = μ N R t(e)`.
//! Seen from the point about which the disc turns at this instant (at distance eR from its centre) slip is
//! perpendicular to the radius vector, the radial integral is elementary, and one over the angle remains
//! (`Ratio::reduced`). They are the complete elliptic integrals of Farkas, Bartels, Unger, Wolf,
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

mod slip_step;

/// Table cells on either side of e = 1.
const CELLS: usize = 256;
/// Points of the quadrature over a quarter turn: at e = 1, where it converges slowest, the error is below 1e-9.
const QUARTER_POINTS: usize = 256;

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
        let [[force, torque]] = self.reduced_of([slide_mps], [rim_mps], [1.0 / total]);
        [force * slide_mps / total, torque * rim_mps / total]
    }

    /// [`Self::force_and_torque`] at `x = v/(v + R|w|)`.
    #[inline(always)]
    fn at_share_of_sliding(&self, x: f64) -> [f64; 2] {
        let [[force, torque]] = self.reduced_of([x], [1.0 - x], [1.0]);
        [force * x, torque * (1.0 - x)]
    }

    /// `[f s/v, t s/(R|w|)]` of several discs: a loop each for what SIMD does side by side and for the table.
    #[inline(always)]
    fn reduced_of<const N: usize>(&self, slide: [f64; N], rim: [f64; N], inverse_total: [f64; N]) -> [[f64; 2]; N] {
        let (mut place, mut reduced) = ([0.0; N], [[0.0; 2]; N]);
        for i in 0..N {
            let difference = slide[i] - rim[i];
            let root = (difference.abs() * inverse_total[i]).sqrt().copysign(difference);
            place[i] = (root + 1.0) * CELLS as f64;
        }
        for i in 0..N {
            let cell = (place[i] as u32 as usize).min(2 * CELLS - 1);
            let along = place[i] - cell as f64;
            let ([f0, t0], [f1, t1]) = (self.nodes[cell], self.nodes[cell + 1]);
            reduced[i] = [f0 + along * (f1 - f0), t0 + along * (t1 - t0)];
        }
        reduced
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
    /// `[f s/v, t s/(R w)]`, `s = v + R w`.
    fn reduced(self) -> [f64; 2] {
        let (Self::Spinning(smaller) | Self::Sliding(smaller)) = self;
        // `[f/e, t]` for e ≤ 1, `[f, e t]` for e ≥ 1
        let integrals = match self {
            Self::Spinning(e) => quarter_turn(|sin2, cos2| {
                let chord2 = 1.0 - e * e * cos2;
                [4.0 / PI * sin2 * chord2.sqrt(), 4.0 / (3.0 * PI) * libm::pow(chord2, 1.5)]
            }),
            Self::Sliding(k) => quarter_turn(|sin2, cos2| {
                let chord = (1.0 - k * k * sin2).sqrt();
                let torque = if chord > 0.0 { cos2 * cos2 / chord } else { 0.0 };
                [4.0 / PI * cos2 * chord, 4.0 / (3.0 * PI) * torque]
            }),
        };
        integrals.map(|integral| integral * (1.0 + smaller))
    }
}

/// Integral over 0..π/2 of a function of sin² and cos²: the trapezoidal rule, which converges faster than any power
/// for smooth periodic functions.
fn quarter_turn(integrand: impl Fn(f64, f64) -> [f64; 2]) -> [f64; 2] {
    let step = FRAC_PI_2 / QUARTER_POINTS as f64;
    let mut sum = [0.0; 2];
    for i in 0..=QUARTER_POINTS {
        let (sin, cos) = libm::sincos(step * i as f64);
        let weight = if i == 0 || i == QUARTER_POINTS { 0.5 * step } else { step };
        let value = integrand(sin * sin, cos * cos);
        sum = [sum[0] + weight * value[0], sum[1] + weight * value[1]];
    }
    sum
}
