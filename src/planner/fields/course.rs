//! Where parts go under a motion, and how that changes with the motion.
//!
//! ```text
//!   slip  s = u(p, t) - v        u: the plate's velocity under the part, v: the part's
//!   dv/dt = μ g s / sqrt(|s|² + κ R² ω² + ε²)      dp/dt = v
//! ```
//!
//! This is Coulomb friction of a disc of radius R that slides and turns at ω against the plate: with κ it passes through
//! the closed form of Farkas et al. (Phys. Rev. Lett. 90, 248302) at equal sliding and rim speed, and differs from it
//! by 4 % at most for slower turning. The disc's own turning is left out: it is slow beside the plate's. The ε keeps
//! the slope finite. When the motors are silent a part coasts on for `v²/(2 μ g)`.
//!
//! The slopes of all ends by all coefficients come from the same equations run backwards (the adjoint), at about twice
//! the work of one course; how the plate's offset from its place changes with them is left out, 1 to 3 % of a slope.

use crate::geometry::Vec2;
use crate::signal::Envelope;
use crate::units::GRAVITY_MPS2;

use super::waves::Waves;

/// See the module: `f(1) = 1/sqrt(1 + κ) = 8/(3π)`.
const KAPPA: f64 = 0.388;
/// Slip at which friction is told from none, m/s.
const EPSILON_MPS: f64 = 1e-3;

/// A part that lies at rest.
#[derive(Clone, Copy, Debug)]
pub(super) struct Disc {
    pub position_m: Vec2,
    pub radius_m: f64,
    /// Coulomb friction against the plate.
    pub friction: f64,
}

/// What became of every part in a pulse; the steps are kept for the way back.
#[derive(Clone, Debug, Default)]
pub(super) struct Course {
    parts: usize,
    heights: Vec<f64>,
    /// The plate's velocity in every phase of a period.
    motion: Vec<[f64; 3]>,
    /// `[step * parts + part]`.
    states: Vec<State>,
    /// Velocities when the motors fall silent, m/s.
    last_mps: Vec<Vec2>,
    /// Where the parts come to rest, m.
    pub ends_m: Vec<Vec2>,
}

#[derive(Clone, Copy, Debug, Default)]
struct State {
    position_m: Vec2,
    /// From the plate's centre.
    arm_m: Vec2,
    slip_mps: Vec2,
    /// `1 / sqrt(|s|² + κ R² ω² + ε²)`, s/m.
    inverse: f64,
}

impl Course {
    /// Plays `coefficients` of `waves` under `envelope` on `discs`.
    pub fn run(&mut self, waves: &Waves, coefficients: &[f64], envelope: &Envelope, discs: &[Disc]) {
        self.motion = waves.motion(coefficients);
        let offsets_m = waves.offsets_m(coefficients);
        let dt = waves.step_s();
        let steps = (envelope.sounding_s() / dt).round() as usize;
        self.parts = discs.len();
        self.heights.clear();
        self.heights.extend((0..steps).map(|k| envelope.at((k as f64 + 0.5) * dt)));
        self.states.clear();
        self.states.reserve(steps * discs.len());
        let mut moving: Vec<(Vec2, Vec2)> = discs.iter().map(|disc| (disc.position_m, Vec2::zeros())).collect();
        for (k, &height) in self.heights.iter().enumerate() {
            let phase = waves.phase(k);
            let [x, y, spin] = self.motion[phase].map(|v| v * height);
            let center_m = offsets_m[phase] * height;
            for (disc, (p, v)) in discs.iter().zip(&mut moving) {
                let arm = *p - center_m;
                let slip = Vec2::new(x - spin * arm.y - v.x, y + spin * arm.x - v.y);
                let inverse = 1.0 / (slip.norm_squared() + turning(disc, spin)).sqrt();
                self.states.push(State { position_m: *p, arm_m: arm, slip_mps: slip, inverse });
                *v += slip * (disc.friction * GRAVITY_MPS2 * dt * inverse);
                *p += *v * dt;
            }
        }
        self.last_mps.clear();
        self.last_mps.extend(moving.iter().map(|(_, v)| *v));
        self.ends_m.clear();
        let coasted = |(disc, (p, v)): (&Disc, &(Vec2, Vec2))| p + v * (v.norm() * coasting(disc));
        self.ends_m.extend(discs.iter().zip(&moving).map(coasted));
    }

    /// Places of all parts through the course, every `every` steps, and at its end.
    pub fn places_m(&self, every: usize) -> impl Iterator<Item = Vec<Vec2>> + '_ {
        let through = self.states.chunks_exact(self.parts.max(1)).step_by(every.max(1));
        through.map(|states| states.iter().map(|s| s.position_m).collect()).chain(std::iter::once(self.ends_m.clone()))
    }

    /// Slopes of one part's end along x (first) and y by every coefficient, m per m/s.
    pub fn slopes(
        &self,
        waves: &Waves,
        discs: &[Disc],
        part: usize,
        slopes: [&mut [f64]; 2],
        scratch: &mut Vec<[f64; 3]>,
    ) {
        let (Some(disc), Some(&last_mps)) = (discs.get(part), self.last_mps.get(part)) else { return };
        let dt = waves.step_s();
        let pull = disc.friction * GRAVITY_MPS2 * dt;
        let turning_slope = KAPPA * disc.radius_m * disc.radius_m;
        for (axis, slope) in slopes.into_iter().enumerate() {
            let mut by_place = Vec2::zeros();
            by_place[axis] = 1.0;
            let mut by_speed = coasting_slope(disc, last_mps, by_place);
            scratch.clear();
            scratch.resize(waves.samples, [0.0; 3]);
            for (k, &height) in self.heights.iter().enumerate().rev() {
                let q = waves.phase(k);
                let state = &self.states[k * self.parts + part];
                let spin = height * self.motion[q][2];
                by_speed += by_place * dt;
                let along = state.slip_mps * state.inverse;
                let across = (by_speed - along * along.dot(&by_speed)) * (pull * state.inverse);
                let by_turning = -pull * turning_slope * spin * state.inverse * state.inverse * along.dot(&by_speed);
                let sum = &mut scratch[q];
                sum[0] += height * across.x;
                sum[1] += height * across.y;
                sum[2] += height * (across.y * state.arm_m.x - across.x * state.arm_m.y + by_turning);
                by_speed -= across;
                by_place += Vec2::new(across.y, -across.x) * spin;
            }
            waves.slope(scratch, slope);
        }
    }
}

/// `κ R² ω² + ε²`.
fn turning(disc: &Disc, spin_radps: f64) -> f64 {
    KAPPA * (disc.radius_m * spin_radps).powi(2) + EPSILON_MPS * EPSILON_MPS
}

/// `1/(2 μ g)`, s²/m.
fn coasting(disc: &Disc) -> f64 {
    0.5 / (disc.friction * GRAVITY_MPS2)
}

/// Slope by the velocity of `along · v |v| / (2 μ g)`.
fn coasting_slope(disc: &Disc, v: Vec2, along: Vec2) -> Vec2 {
    let speed = v.norm();
    if speed == 0.0 { Vec2::zeros() } else { (along * speed + v * (v.dot(&along) / speed)) * coasting(disc) }
}
