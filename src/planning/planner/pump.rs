//! Model of a disc at rest under one pulse of the pump wave about a centre of rotation, in the frame of its belt.
//!
//! ```text
//!   y ▲            x along the flow where the disc starts, y to its left, the origin where it starts
//!     │            plate under the disc: u = f(t) (a - ω y, ω x), turning at f(t) ω
//!     └───► x      against it the disc slides at s and spins at r/R: d|s|/dt = -μ g F(s, r), dr/dt = -2 μ g T(s, r)
//! ```
//!
//! a and ω are the amplitudes of the belt's speed and of the plate's spin, f = d/dt (env X) the displacement wave
//! `X' = sin wt + ½ cos 2wt` under the envelope: the UPM paper's pump (Eqs. 5 and 9) with flanks that return the plate
//! to its rest position. The motors' low-pass delays the envelope against the wave, whose phase is compensated. F and T
//! are those of [`DiscFriction`], the disc's moment of inertia is m R²/2. About a near centre, where the plate turns
//! under the disc as fast as it slides, the disc soon turns with the plate and is then carried half as far again as one
//! that does not turn.

use std::f64::consts::TAU;

use wide::f64x8 as SimdF64;

use crate::cor_library::Library;
use upm_core::disc_friction::DiscFriction;
use upm_core::signal::Envelope;
use upm_core::units::GRAVITY_MPS2;

/// SIMD lanes: discs integrated side by side.
pub(crate) const LANES: usize = 8;
/// Steps in a period of the drive.
const STEPS: usize = 60;
/// Steps from one sustain of the table to the next.
const BETWEEN: usize = STEPS / 12;
/// Length of a coasting step in steps of the pulse, and the largest number of coasting steps.
const COASTING: f64 = 4.0;
const MOST_COASTING: usize = 400;

/// Up to eight discs, each with its belt.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Discs {
    /// Amplitude a of the belt's speed, m/s.
    pub speed_mps: [f64; LANES],
    /// Amplitude ω of the plate's spin, rad/s.
    pub spin_radps: [f64; LANES],
    /// Coefficient of friction μ.
    pub friction: [f64; LANES],
    /// Radius R of the discs, m.
    pub radius_m: f64,
}

/// Displacement of a disc by one pulse.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct Travel {
    /// Component along the flow at its start, m.
    pub along_m: f64,
    /// Component to the left of the flow for a counter-clockwise plate, m.
    pub across_m: f64,
    /// Time from the end of the pulse until it is at rest, s.
    pub coasts_s: f64,
}

/// Pulses of one base frequency and one attack, with sustains that are multiples of a twelfth of a period.
#[derive(Clone, Debug)]
pub(crate) struct Pump {
    base_radps: f64,
    attack_s: f64,
    delay_s: f64,
    step_s: f64,
}

/// Position and velocity, m and m/s, and speed of the rim about the disc's centre, m/s.
#[derive(Clone, Copy, Debug, Default)]
struct SlipState {
    x: SimdF64,
    y: SimdF64,
    u: SimdF64,
    v: SimdF64,
    rim: SimdF64,
}

impl Travel {
    /// The travel a fraction `part` of the way to `other`.
    #[inline]
    pub fn towards(&self, other: &Self, part: f64) -> Self {
        let mix = |a: f64, b: f64| a + part * (b - a);
        Self {
            along_m: mix(self.along_m, other.along_m),
            across_m: mix(self.across_m, other.across_m),
            coasts_s: mix(self.coasts_s, other.coasts_s),
        }
    }
}

impl Pump {
    /// The pump of the rotations of `library`.
    pub fn of(library: &Library) -> Self {
        let Library { base_radps, attack_s, .. } = *library;
        Self { base_radps, attack_s, delay_s: library.envelope_delay_s(), step_s: TAU / base_radps / STEPS as f64 }
    }

    /// Time from one sustain to the next, s. The phase in which a pulse ends changes the distance by up to a tenth; a
    /// twelfth of a period resolves that.
    pub fn sustain_step_s(&self) -> f64 {
        self.step_s * BETWEEN as f64
    }

    /// Displacements of each of `sets` by pulses with `count` sustains of 0, 1, 2, … steps: `[set][sustain][disc]`.
    pub fn travels(&self, sets: &[Discs], count: usize) -> Vec<Vec<[Travel; LANES]>> {
        let rise = self.shapes(0, self.flank() + count.saturating_sub(1) * BETWEEN, count * BETWEEN);
        let falls: Vec<Vec<f64>> = (0..count).map(|k| self.fall(k * BETWEEN)).collect();
        let ends = |discs: &Discs| {
            let belts = PulseConstants::of(discs, self.step_s);
            let (mut state, mut risen) = (SlipState::default(), 0);
            let end = |(k, fall): (usize, &Vec<f64>)| {
                let until = self.flank() + k * BETWEEN;
                state = belts.played(state, &rise[risen..=until]);
                risen = until;
                belts.rest(belts.played(state, fall))
            };
            falls.iter().enumerate().map(end).collect()
        };
        sets.iter().map(ends).collect()
    }

    /// Values of f until the end of a sustain of this many steps of the table, and from there to the end of the pulse.
    pub fn course(&self, sustain: usize) -> [Vec<f64>; 2] {
        let sustain = sustain * BETWEEN;
        [self.shapes(0, self.flank() + sustain, sustain), self.fall(sustain)]
    }

    /// Displacements of `discs` by a pulse of this course.
    pub fn travel(&self, discs: &Discs, [rise, fall]: &[Vec<f64>; 2]) -> [Travel; LANES] {
        let belts = PulseConstants::of(discs, self.step_s);
        belts.rest(belts.played(belts.played(SlipState::default(), rise), fall))
    }

    /// Steps of a flank, the envelope's delay included.
    fn flank(&self) -> usize {
        ((self.attack_s + self.delay_s) / self.step_s).ceil() as usize
    }

    /// Values of f from the end of the sustain to the end of the pulse.
    fn fall(&self, sustain: usize) -> Vec<f64> {
        let from = self.flank() + sustain;
        self.shapes(from, from + self.flank(), sustain)
    }

    /// f before, between and after steps `from` to `to` of a pulse with a sustain of `sustain` steps.
    fn shapes(&self, from: usize, to: usize, sustain: usize) -> Vec<f64> {
        let sustain_s = sustain as f64 * self.step_s;
        let envelope = Envelope { attack_s: self.attack_s, sustain_s, rest_s: 0.0 };
        (from..=to).map(|k| self.shape(k as f64 * self.step_s, &envelope)).collect()
    }

    /// f at `t_s`.
    fn shape(&self, t_s: f64, envelope: &Envelope) -> f64 {
        let (sin, cos) = libm::sincos(self.base_radps * t_s);
        let (sin_2, cos_2) = (2.0 * sin * cos, cos * cos - sin * sin);
        let velocity = sin + 0.5 * cos_2;
        let displacement = (0.25 * sin_2 - cos) / self.base_radps;
        let t_s = t_s - self.delay_s;
        envelope.at(t_s) * velocity + envelope.slope(t_s) * displacement
    }
}

/// Constants of one pulse.
struct PulseConstants {
    speed: SimdF64,
    spin: SimdF64,
    /// Amplitude of the rim speed due to the plate's spin, m/s.
    rim: SimdF64,
    /// Deceleration by friction, m/s².
    friction_mps2: [f64; LANES],
    dt: f64,
    friction: &'static DiscFriction,
}

impl PulseConstants {
    fn of(discs: &Discs, dt: f64) -> Self {
        let spin = SimdF64::from(discs.spin_radps);
        Self {
            speed: SimdF64::from(discs.speed_mps),
            spin,
            rim: spin * discs.radius_m,
            friction_mps2: discs.friction.map(|friction| friction * GRAVITY_MPS2),
            dt,
            friction: DiscFriction::shared(),
        }
    }

    /// State after one step for each pair of neighbouring values of f.
    fn played(&self, state: SlipState, shapes: &[f64]) -> SlipState {
        shapes.windows(2).fold(state, |state, f| self.step(state, [f[0], f[1]]))
    }

    #[inline]
    fn step(&self, state: SlipState, f: [f64; 2]) -> SlipState {
        let plates = f.map(|f| {
            let spin = self.spin * f;
            (self.speed * f - spin * state.y, spin * state.x, self.rim * f)
        });
        let SlipState { x, y, u, v, rim } = self.dragged(state, plates, self.dt);
        SlipState { x: x + u * self.dt, y: y + v * self.dt, u, v, rim }
    }

    /// State after `dt` of friction, for the plate's velocity under the disc before and after it.
    ///
    /// Second order in `dt`: friction points along the mean slip and is scaled by the mean of the two slip speeds, so
    /// that it averages out where the slip reverses within the step.
    #[inline]
    fn dragged(&self, state: SlipState, plates: [(SimdF64, SimdF64, SimdF64); 2], dt: f64) -> SlipState {
        let slips = plates.map(|(u, v, rim)| (u - state.u, v - state.v, rim - state.rim));
        let [before, after] = slips.map(|(u, v, rim)| ((u * u + v * v).sqrt(), rim.abs()));
        let slide = ((before.0 + after.0) * 0.5).to_array();
        let turn = ((before.1 + after.1) * 0.5).to_array();
        let reach_mps = self.friction_mps2.map(|friction| friction * dt);
        let remaining = self.friction.remaining_slip_fractions_of(slide, turn, reach_mps);
        let taken = SimdF64::from(remaining.map(|[slide, _]| 1.0 - slide)) * 0.5;
        let taken_rim = SimdF64::from(remaining.map(|[_, rim]| 1.0 - rim)) * 0.5;
        let [before, after] = slips;
        SlipState {
            u: state.u + taken * (before.0 + after.0),
            v: state.v + taken * (before.1 + after.1),
            rim: state.rim + taken_rim * (before.2 + after.2),
            ..state
        }
    }

    /// Displacements once the discs have come to rest on the resting plate.
    fn rest(&self, mut state: SlipState) -> [Travel; LANES] {
        let dt = COASTING * self.dt;
        let mut coasts_s = SimdF64::ZERO;
        for _ in 0..MOST_COASTING {
            let speed = (state.u * state.u + state.v * state.v).sqrt();
            let moves = speed.simd_gt(SimdF64::ZERO);
            if moves.none() {
                break;
            }
            let next = self.dragged(state, [(SimdF64::ZERO, SimdF64::ZERO, SimdF64::ZERO); 2], dt);
            // in the step in which it comes to rest, it does so after a fraction of the step
            let stops = (next.u * next.u + next.v * next.v).simd_le(SimdF64::ZERO);
            let needed = speed / SimdF64::from(self.friction_mps2);
            let time = moves.select(stops.select(needed.min(SimdF64::splat(dt)), SimdF64::splat(dt)), SimdF64::ZERO);
            let half = time * 0.5;
            state =
                SlipState { x: state.x + (state.u + next.u) * half, y: state.y + (state.v + next.v) * half, ..next };
            coasts_s += time;
        }
        let [along, across, coasts_s] = [state.x, state.y, coasts_s].map(SimdF64::to_array);
        std::array::from_fn(|i| Travel { along_m: along[i], across_m: across[i], coasts_s: coasts_s[i] })
    }
}
