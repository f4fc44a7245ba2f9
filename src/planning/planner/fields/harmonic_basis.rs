//! Motions that are searched: sums of harmonics on x, y and spin, sampled over one period.

use std::f64::consts::TAU;

pub(super) use wide::f64x8 as SimdF64;

use upm_core::geometry::{Twist, Vec2};
use upm_core::signal::{Follows, TwistHarmonic, TwistWave};

/// Steps in the period of the highest harmonic.
const STEPS: usize = 8;
/// Fewest steps of a base period.
const FEWEST: usize = 48;
/// Sampled phases from one step to the next. A period is not a whole number of steps: the next one is sampled at other
/// phases, so that over a pulse the reversals of slip are resolved as if sampled this much finer.
const STRIDE: usize = 4;

/// Harmonics of one base frequency, sampled over one period.
///
/// The coefficients of a motion, m/s, are for x, y and spin in turn cos and sin of harmonic 1, cos and sin of harmonic
/// 2, and so on. Spin counts as the speed it gives a point half a side from the centre.
#[derive(Clone, Debug)]
pub(super) struct HarmonicBasis {
    base_radps: f64,
    half_side_m: f64,
    /// The quantity that follows the envelope.
    pub follows: Follows,
    /// Number of harmonics.
    pub harmonics: usize,
    /// Phases of a period.
    pub samples: usize,
    /// Sampled phases from one step to the next.
    stride: usize,
    /// Slip below which friction is smoothed to zero, m/s: two thirds of the speed that friction changes in a step.
    pub smoothing_mps: f64,
    /// `table[sample * harmonics + k - 1]`: cos and sin of harmonic k, for the first half of a period.
    table: Vec<[f64; 2]>,
}

/// Velocity, offset and turn of the plate at one instant.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct PlateInstant {
    pub velocity_mps: Vec2,
    pub spin_radps: f64,
    /// Offset of its centre from the rest position, m.
    pub offset_m: Vec2,
    /// Turn from the rest position, rad.
    pub turn_rad: f64,
}

/// Slopes of one quantity of each of eight parts by the plate's velocity and by its displacement, along x, along y and
/// in spin, in every phase of a period. Those by displacement, 1 to 3 % of the whole, are left out where the velocity
/// follows the envelope.
#[derive(Clone, Debug)]
pub(super) struct PlateSlopes {
    pub by_velocity: [Vec<SimdF64>; 3],
    pub by_displacement: Option<[Vec<SimdF64>; 3]>,
}

impl PlateSlopes {
    pub fn new(basis: &HarmonicBasis) -> Self {
        let zeros = || [(); 3].map(|()| vec![SimdF64::ZERO; basis.samples]);
        Self { by_velocity: zeros(), by_displacement: (basis.follows == Follows::Displacement).then(zeros) }
    }
}

impl PlateInstant {
    /// The sum of both motions.
    pub fn plus(&self, other: &Self) -> Self {
        Self {
            velocity_mps: self.velocity_mps + other.velocity_mps,
            spin_radps: self.spin_radps + other.spin_radps,
            offset_m: self.offset_m + other.offset_m,
            turn_rad: self.turn_rad + other.turn_rad,
        }
    }

    /// Under an envelope of `height` and, where the displacement follows it, of `slope` (1/s):
    /// `d/dt (env x) = env v + env' x`.
    pub fn shaped(&self, height: f64, slope: f64) -> Self {
        Self {
            velocity_mps: self.velocity_mps * height + self.offset_m * slope,
            spin_radps: self.spin_radps * height + self.turn_rad * slope,
            offset_m: self.offset_m * height,
            turn_rad: self.turn_rad * height,
        }
    }
}

impl HarmonicBasis {
    pub fn new(base_radps: f64, harmonics: usize, half_side_m: f64) -> Self {
        Self::sampled(base_radps, harmonics, half_side_m, STEPS, true)
    }

    /// Motions that follow one another without a pause: a period is a whole number of steps, and the displacement
    /// follows the envelope.
    pub fn for_segments(base_radps: f64, harmonics: usize, half_side_m: f64) -> Self {
        Self { follows: Follows::Displacement, ..Self::sampled(base_radps, harmonics, half_side_m, STEPS, false) }
    }

    /// The same motions, played and forecast more exactly: the displacement follows the envelope, and steps are half as
    /// long, since longer ones err to the side by a few hundredths of a part's step.
    pub fn for_paths(&self) -> Self {
        let fine = Self::sampled(self.base_radps, self.harmonics, self.half_side_m, 2 * STEPS, true);
        Self { follows: Follows::Displacement, ..fine }
    }

    fn sampled(base_radps: f64, harmonics: usize, half_side_m: f64, steps: usize, shifted: bool) -> Self {
        let stride = if shifted { STRIDE } else { 2 };
        let samples = (steps * harmonics).max(FEWEST) * stride + usize::from(shifted);
        let phase = |q: usize| TAU * q as f64 / samples as f64;
        let row = |q: usize| {
            (1..=harmonics).map(move |k| {
                let (sin, cos) = libm::sincos(k as f64 * phase(q));
                [cos, sin]
            })
        };
        let table = (0..=samples / 2).flat_map(row).collect();
        let smoothing_mps = if steps == STEPS { 1e-3 } else { 0.5e-3 };
        Self { base_radps, half_side_m, follows: Follows::Velocity, harmonics, samples, stride, smoothing_mps, table }
    }

    /// Coefficients of one axis.
    pub fn per_axis(&self) -> usize {
        2 * self.harmonics
    }

    /// Coefficients of a motion.
    pub fn len(&self) -> usize {
        3 * self.per_axis()
    }

    /// Length of a step, s.
    pub fn step_s(&self) -> f64 {
        TAU / self.base_radps * self.stride as f64 / self.samples as f64
    }

    /// Index of the phase at every step, from the first on.
    pub fn phases(&self) -> impl Iterator<Item = usize> {
        std::iter::successors(Some(self.stride / 2), |phase| Some((phase + self.stride) % self.samples))
    }

    /// The harmonic a coefficient belongs to, from 1.
    pub fn harmonic_of(&self, coefficient: usize) -> usize {
        coefficient % self.per_axis() / 2 + 1
    }

    /// The plate's velocity, offset and turn in every phase of a period.
    pub fn motion(&self, coefficients: &[f64]) -> Vec<PlateInstant> {
        let [x, y, spin] = self.axes(coefficients);
        let factors = |k: usize| {
            let [x, y, spin] = [x, y, spin].map(|axis| [axis[2 * k - 2], axis[2 * k - 1]]);
            let [along_x, along_y, turn] = [x, y, spin].map(|velocity| self.integral(velocity, k));
            [0, 1].map(|i| SimdF64::from([x[i], y[i], spin[i], along_x[i], along_y[i], turn[i], 0.0, 0.0]))
        };
        let factors: Vec<[SimdF64; 2]> = (1..=self.harmonics).map(factors).collect();
        let instant = |lanes: SimdF64| {
            let [x, y, spin, along_x, along_y, turn, ..] = lanes.to_array();
            PlateInstant {
                velocity_mps: Vec2::new(x, y),
                spin_radps: spin / self.half_side_m,
                offset_m: Vec2::new(along_x, along_y),
                turn_rad: turn / self.half_side_m,
            }
        };
        self.sums(&factors).into_iter().map(instant).collect()
    }

    /// Coefficients of the time integral of harmonic `k` with coefficients `cos` and `sin`.
    pub fn integral(&self, [cos, sin]: [f64; 2], k: usize) -> [f64; 2] {
        let radps = k as f64 * self.base_radps;
        [-sin / radps, cos / radps]
    }

    /// Eight sums of harmonics in every phase of a period: `factors[k - 1]` are the coefficients of cos and sin of
    /// harmonic k.
    pub fn sums(&self, factors: &[[SimdF64; 2]]) -> Vec<SimdF64> {
        let mut sums = vec![SimdF64::ZERO; self.samples];
        for (q, row) in self.table.chunks_exact(self.harmonics).enumerate() {
            let (mut even, mut odd) = (SimdF64::ZERO, SimdF64::ZERO);
            for ([by_cos, by_sin], [cos, sin]) in factors.iter().zip(row) {
                even += *by_cos * SimdF64::splat(*cos);
                odd += *by_sin * SimdF64::splat(*sin);
            }
            sums[q] = even + odd;
            sums[self.mirrored(q)] = even - odd;
        }
        sums
    }

    /// The transpose of [`Self::sums`]: for eight series over a period, the sums of products with cos and sin of each
    /// harmonic. A series is zero in every phase that no step has.
    pub fn projections(&self, series: &[SimdF64]) -> Vec<[SimdF64; 2]> {
        let folded = |q: usize| {
            let (there, back) = (series[q], series[self.mirrored(q)]);
            if q == 0 { [there, SimdF64::ZERO] } else { [there + back, there - back] }
        };
        let repeats = self.samples.is_multiple_of(self.stride);
        let (first, every) = if repeats { (self.stride / 2, self.stride) } else { (0, 1) };
        let folded: Vec<[SimdF64; 2]> = (first..=self.samples / 2).step_by(every).map(folded).collect();
        let projection = |k: usize| {
            let column = self.table[first * self.harmonics..].iter().skip(k).step_by(every * self.harmonics);
            let sum = |[cos_sum, sin_sum]: [SimdF64; 2], ([even, odd], [cos, sin]): (&[SimdF64; 2], &[f64; 2])| {
                [cos_sum + *even * SimdF64::splat(*cos), sin_sum + *odd * SimdF64::splat(*sin)]
            };
            folded.iter().zip(column).fold([SimdF64::ZERO; 2], sum)
        };
        (0..self.harmonics).map(projection).collect()
    }

    /// Slopes, by the coefficients, of one quantity of each of eight parts, from its slopes by the plate's motion.
    pub fn slopes(&self, by_plate: &PlateSlopes) -> impl Iterator<Item = SimdF64> {
        let scales = [1.0, 1.0, 1.0 / self.half_side_m];
        let of_axis = move |axis: usize| {
            let mut slopes = self.projections(&by_plate.by_velocity[axis]);
            let by_displacement = by_plate.by_displacement.as_ref().map(|series| self.projections(&series[axis]));
            for (k, ([cos, sin], by_integral)) in (1..).zip(slopes.iter_mut().zip(by_displacement.iter().flatten())) {
                // the integrals of cos and of sin, see `Self::integral`
                let [of_cos, of_sin] = by_integral.map(|slope| slope / (f64::from(k) * self.base_radps));
                (*cos, *sin) = (*cos + of_sin, *sin - of_cos);
            }
            slopes.into_iter().flatten().map(move |slope| slope * SimdF64::splat(scales[axis]))
        };
        [0, 1, 2].into_iter().flat_map(of_axis)
    }

    /// Index of the phase in which cosines equal those of phase `q` and sines are opposite.
    fn mirrored(&self, q: usize) -> usize {
        (self.samples - q) % self.samples
    }

    /// The motion as a [`TwistWave`].
    pub fn wave(&self, coefficients: &[f64]) -> TwistWave {
        let [x, y, spin] = self.axes(coefficients);
        let twist = |j: usize| Twist::new(x[j], y[j], spin[j] / self.half_side_m);
        let harmonics = (0..self.harmonics).map(|k| TwistHarmonic { cos: twist(2 * k), sin: twist(2 * k + 1) });
        TwistWave { base_radps: self.base_radps, harmonics: harmonics.collect() }
    }

    /// The coefficients of `wave`; harmonics beyond those searched are left out.
    pub fn coefficients(&self, wave: &TwistWave) -> Vec<f64> {
        let n = self.per_axis();
        let mut coefficients = vec![0.0; self.len()];
        for (k, harmonic) in wave.harmonics.iter().take(self.harmonics).enumerate() {
            for (j, twist) in [(2 * k, harmonic.cos), (2 * k + 1, harmonic.sin)] {
                coefficients[j] = twist.velocity_mps.x;
                coefficients[n + j] = twist.velocity_mps.y;
                coefficients[2 * n + j] = twist.spin_radps * self.half_side_m;
            }
        }
        coefficients
    }

    /// Steps that make up a period, rounded down.
    pub fn steps_a_period(&self) -> usize {
        self.samples / self.stride
    }

    fn axes<'a>(&self, coefficients: &'a [f64]) -> [&'a [f64]; 3] {
        let (x, rest) = coefficients.split_at(self.per_axis());
        let (y, spin) = rest.split_at(self.per_axis());
        [x, y, spin]
    }
}
