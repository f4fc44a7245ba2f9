//! A disc at rest under one pulse of the pump wave about a centre of rotation, in the frame of its belt.
//!
//! ```text
//!   y ▲            x along the flow where the disc starts, y to its left, the origin where it starts
//!     │            plate under the disc: u = f(t) (a - ω y, ω x)
//!     └───► x      slip s = u - v,   dv/dt = μ g s / sqrt(|s|² + κ R² ω² f²)   while it slips, else v = u
//! ```
//!
//! a and ω are the amplitudes of the belt's speed and of the plate's spin, f = d/dt (env X) the displacement wave
//! `X' = sin wt + ½ cos 2wt` under the envelope: the UPM paper's pump (Eqs. 5 and 9) with flanks that leave the plate where
//! it was. The motors' low-pass delays the envelope against the wave, whose phase is compensated. κ is that of [`fields::course`](super::fields): friction of a disc that slides and turns. The disc's own turning
//! is left out. After the pulse the disc coasts for `v²/(2 μ g)`.

use std::f64::consts::TAU;

use wide::f64x8 as Lanes;

use upm_core::signal::Envelope;
use upm_core::units::GRAVITY_MPS2;
use upm_library::Library;

/// Discs that are moved side by side.
pub(crate) const LANES: usize = 8;
/// Steps in a period of the drive.
const STEPS: usize = 168;
/// Sustains of the table in a period.
const BETWEEN: usize = 12;
/// See the module: `1/sqrt(1 + κ) = 8/(3π)` (Farkas et al., Phys. Rev. Lett. 90, 248302).
const KAPPA: f64 = 0.388;

/// Up to eight discs on belts of their own.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Discs {
    /// a, m/s.
    pub speed_mps: [f64; LANES],
    /// ω, rad/s.
    pub spin_radps: [f64; LANES],
    /// μ.
    pub friction: [f64; LANES],
    /// R, m.
    pub radius_m: f64,
}

/// How far a pulse carries a disc.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct Travel {
    /// Along the flow where it started, m.
    pub along_m: f64,
    /// To the left of it for a counter-clockwise plate, m.
    pub across_m: f64,
    /// Time from the end of the pulse until it stands, s.
    pub coasts_s: f64,
}

/// Pulses of one base frequency and one attack, with sustains that are multiples of a sixth of a period.
#[derive(Clone, Debug)]
pub(crate) struct Pump {
    base_radps: f64,
    attack_s: f64,
    delay_s: f64,
    step_s: f64,
}

#[derive(Clone, Copy, Debug)]
struct State {
    x: Lanes,
    y: Lanes,
    u: Lanes,
    v: Lanes,
}

impl Pump {
    /// The pump of the rotations of `library`.
    pub fn of(library: &Library) -> Self {
        let Library { base_radps, attack_s, .. } = *library;
        Self { base_radps, attack_s, delay_s: library.envelope_delay_s(), step_s: TAU / base_radps / STEPS as f64 }
    }

    /// Time from one sustain to the next, s. The phase in which a pulse ends makes up to a tenth of the distance: a sixth
    /// of a period follows that.
    pub fn sustain_step_s(&self) -> f64 {
        self.step_s * (STEPS / BETWEEN) as f64
    }

    /// Where `discs` end after pulses of `count` sustains 0, 1, 2, … steps: `[sustain][disc]`.
    pub fn travels(&self, discs: &Discs, count: usize) -> Vec<[Travel; LANES]> {
        let attack = ((self.attack_s + self.delay_s) / self.step_s).ceil() as usize;
        let between = STEPS / BETWEEN;
        let mut at_full = vec![State { x: Lanes::ZERO, y: Lanes::ZERO, u: Lanes::ZERO, v: Lanes::ZERO }];
        let longest =
            Envelope { attack_s: self.attack_s, sustain_s: (count * between) as f64 * self.step_s, rest_s: 0.0 };
        let mut state = at_full.remove(0);
        let belts = Belts::of(discs, self.step_s);
        for k in 0..attack + count.saturating_sub(1) * between {
            if k >= attack && (k - attack).is_multiple_of(between) {
                at_full.push(state);
            }
            state = belts.step(state, self.shape((k as f64 + 0.5) * self.step_s, &longest));
        }
        at_full.push(state);
        let end = |(k, state): (usize, State)| {
            let sustain_s = (k * between) as f64 * self.step_s;
            let envelope = Envelope { sustain_s, ..longest };
            let from = attack + k * between;
            let state = (from..from + attack)
                .fold(state, |state, k| belts.step(state, self.shape((k as f64 + 0.5) * self.step_s, &envelope)));
            belts.rest(state)
        };
        at_full.into_iter().take(count).enumerate().map(end).collect()
    }

    /// f at `t_s`.
    fn shape(&self, t_s: f64, envelope: &Envelope) -> f64 {
        let (sin, cos) = (self.base_radps * t_s).sin_cos();
        let (sin_2, cos_2) = (2.0 * sin * cos, cos * cos - sin * sin);
        let velocity = sin + 0.5 * cos_2;
        let displacement = (0.25 * sin_2 - cos) / self.base_radps;
        let t_s = t_s - self.delay_s;
        envelope.at(t_s) * velocity + envelope.slope(t_s) * displacement
    }
}

/// Constants of one pulse.
struct Belts {
    speed: Lanes,
    spin: Lanes,
    turning: Lanes,
    pull: Lanes,
    friction_mps2: Lanes,
    dt: f64,
}

impl Belts {
    fn of(discs: &Discs, dt: f64) -> Self {
        let spin = Lanes::from(discs.spin_radps);
        let friction_mps2 = Lanes::from(discs.friction) * GRAVITY_MPS2;
        let turning = spin * spin * (KAPPA * discs.radius_m * discs.radius_m);
        Self { speed: Lanes::from(discs.speed_mps), spin, turning, pull: friction_mps2 * dt, friction_mps2, dt }
    }

    #[inline]
    fn step(&self, State { x, y, u, v }: State, f: f64) -> State {
        let spin = self.spin * f;
        let (slip_x, slip_y) = (self.speed * f - spin * y - u, spin * x - v);
        let slip = (slip_x * slip_x + slip_y * slip_y + self.turning * (f * f)).sqrt();
        let share = slip.simd_le(self.pull).select(Lanes::ONE, self.pull / slip.max(Lanes::splat(1e-12)));
        let (u, v) = (u + share * slip_x, v + share * slip_y);
        State { x: x + u * self.dt, y: y + v * self.dt, u, v }
    }

    fn rest(&self, State { x, y, u, v }: State) -> [Travel; LANES] {
        let coasts_s = (u * u + v * v).sqrt() / self.friction_mps2;
        let (along, across) = (x + u * coasts_s * 0.5, y + v * coasts_s * 0.5);
        let [along, across, coasts_s] = [along, across, coasts_s].map(Lanes::to_array);
        std::array::from_fn(|i| Travel { along_m: along[i], across_m: across[i], coasts_s: coasts_s[i] })
    }
}
