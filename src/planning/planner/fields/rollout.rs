//! Paths of the parts under a motion, and their slopes by the motion.
//!
//! ```text
//!   slip  s = u(p, t) - v        u: the plate's velocity under the part, v: the part's
//!   dv/dt = μ g s / sqrt(|s|² + κ R² ω² + ε²)      dp/dt = v
//! ```
//!
//! This is Coulomb friction of a disc of radius R that slides and turns at ω against the plate: with κ it passes
//! through the closed form of Farkas et al. (Phys. Rev. Lett. 90, 248302) at equal sliding and rim speed. For slower
//! turning it is at most 2 % below it; for faster turning it is too strong, up to 1.6 times. The disc's own turning is
//! left out: it is slow beside the plate's. The ε keeps the slope finite. When the motors are silent a part coasts on
//! for `v²/(2 μ g)`.
//!
//! The slopes of all ends by all coefficients come from the same equations run backwards (the adjoint), at about twice
//! the cost of one rollout; see [`PlateSlopes`] for what they leave out.

use std::ops::Range;

use nalgebra::DMatrix;

use super::harmonic_basis::{HarmonicBasis, PlateInstant, PlateSlopes, SimdF64};
use upm_core::geometry::Vec2;
use upm_core::signal::{Envelope, Follows};
use upm_core::units::GRAVITY_MPS2;

/// κ, see the module: `f(1) = 1/sqrt(1 + κ) = 8/(3π)`.
const KAPPA: f64 = 0.388;
/// Least distance of a centre from the edge of the plate at rest that shares are taken of, m.
const EDGE_M: f64 = 1e-3;
/// SIMD lanes: parts integrated side by side.
const LANES: usize = 8;

/// A part before the motion.
#[derive(Clone, Copy, Debug)]
pub(super) struct RolloutDisc {
    pub position_m: Vec2,
    /// Zero for a part at rest.
    pub velocity_mps: Vec2,
    pub radius_m: f64,
    /// Coefficient of Coulomb friction against the plate.
    pub friction: f64,
}

/// Trajectories of all parts in a pulse; the steps are kept for the adjoint.
#[derive(Clone, Debug, Default)]
pub(super) struct Rollout {
    steps: Vec<PlateStep>,
    groups: Vec<Group>,
    /// Positions where the parts come to rest, m.
    pub ends_m: Vec<Vec2>,
}

/// Motion of the plate during one time step.
#[derive(Clone, Copy, Debug)]
struct PlateStep {
    phase: usize,
    /// Height of the envelope and, where the displacement follows it, its slope, 1/s.
    height: f64,
    slope: f64,
    plate: PlateInstant,
}

/// State of up to eight parts, one per lane; vectors are stored as x and y.
#[derive(Clone, Debug, Default)]
struct Group {
    /// Change of speed by full friction in a step, `μ g dt`, m/s.
    pull_mps: SimdF64,
    /// `κ R²`, m².
    turning_m2: SimdF64,
    /// `1/(2 μ g)`, s²/m.
    coasting: SimdF64,
    /// State before every step.
    states: Vec<RolloutState>,
    /// Position and velocity after the last step, m and m/s.
    last_m: [SimdF64; 2],
    last_mps: [SimdF64; 2],
}

#[derive(Clone, Copy, Debug)]
struct RolloutState {
    /// Position from the plate's centre, m.
    arm_m: [SimdF64; 2],
    /// Fraction of full friction, a vector: `s / sqrt(|s|² + κ R² ω² + ε²)`.
    pull: [SimdF64; 2],
    /// `1 / sqrt(|s|² + κ R² ω² + ε²)`, s/m.
    inverse: SimdF64,
}

impl Rollout {
    /// Computes the rollout of `discs` under the motion `coefficients` of `basis` and `envelope`.
    pub fn run(&mut self, basis: &HarmonicBasis, coefficients: &[f64], envelope: &Envelope, discs: &[RolloutDisc]) {
        let motion = basis.motion(coefficients);
        let dt = basis.step_s();
        let count = (envelope.driven_s() / dt).round() as usize;
        self.steps.clear();
        self.steps.extend(basis.phases().take(count).enumerate().map(|(k, phase)| {
            let t_s = (k as f64 + 0.5) * dt;
            let height = envelope.at(t_s);
            let slope = if basis.follows == Follows::Displacement { envelope.slope(t_s) } else { 0.0 };
            PlateStep { phase, height, slope, plate: motion[phase].shaped(height, slope) }
        }));
        self.play(basis, discs);
    }

    /// Computes the rollout of `discs` while the motion `to` replaces `from` over the attack of `envelope`: the plate's
    /// displacement is `(1 - env) from + env to`. Only the steps `range` from the beginning of the attack are played.
    pub fn run_faded(
        &mut self,
        basis: &HarmonicBasis,
        [from, to]: [&[PlateInstant]; 2],
        (envelope, range): (&Envelope, Range<usize>),
        discs: &[RolloutDisc],
    ) {
        let dt = basis.step_s();
        self.steps.clear();
        self.steps.extend(basis.phases().enumerate().take(range.end).skip(range.start).map(|(k, phase)| {
            let t_s = (k as f64 + 0.5) * dt;
            let (height, slope) = (envelope.at(t_s), envelope.slope(t_s));
            let mut plate = to[phase].shaped(height, slope);
            if t_s < envelope.attack_s {
                plate = plate.plus(&from[phase].shaped(1.0 - height, -slope));
            }
            PlateStep { phase, height, slope, plate }
        }));
        self.play(basis, discs);
    }

    fn play(&mut self, basis: &HarmonicBasis, discs: &[RolloutDisc]) {
        let dt = basis.step_s();
        self.groups.resize_with(discs.len().div_ceil(LANES), Group::default);
        self.ends_m.clear();
        for (group, discs) in self.groups.iter_mut().zip(discs.chunks(LANES)) {
            let [x, y] = group.play(&self.steps, (dt, basis.smoothing_mps), discs).map(SimdF64::to_array);
            self.ends_m.extend(discs.iter().zip(x).zip(y).map(|((_, x), y)| Vec2::new(x, y)));
        }
    }

    /// Number of time steps.
    pub fn steps(&self) -> usize {
        self.steps.len()
    }

    /// Positions of all parts before time step `step`, m.
    pub fn places_at(&self, step: usize) -> Vec<Vec2> {
        let offset_m = self.steps[step].plate.offset_m;
        let places = self.groups.iter().flat_map(move |group| {
            let [x, y] = group.states[step].arm_m.map(SimdF64::to_array);
            x.into_iter().zip(y).map(move |(x, y)| Vec2::new(x, y) + offset_m)
        });
        places.take(self.ends_m.len()).collect()
    }

    /// Positions of all parts along the rollout, every `every` steps, and at its end.
    pub fn places_m(&self, every: usize) -> impl Iterator<Item = Vec<Vec2>> + '_ {
        let along = (0..self.steps.len()).step_by(every.max(1)).map(|step| self.places_at(step));
        along.chain(std::iter::once_with(|| self.ends_m.clone()))
    }

    /// For each part the smallest distance of its centre from the edge of the shaken plate, as a share of its distance
    /// from the edge of the plate at rest; negative for a part from under which the plate moves away. `half_side_m` is
    /// half of the plate's side.
    pub fn edge_shares(&self, half_side_m: f64) -> Vec<f64> {
        let shares = self.groups.iter().flat_map(|group| group.edge_shares(&self.steps, half_side_m).to_array());
        shares.take(self.ends_m.len()).collect()
    }

    /// Slopes of all ends by every coefficient, m per m/s: a column for each part's x and y in turn.
    pub fn slopes(&self, basis: &HarmonicBasis) -> DMatrix<f64> {
        self.columns(basis, 2, |group, _, axis, by_plate| {
            let mut by_place = [SimdF64::ZERO; 2];
            by_place[axis] = SimdF64::ONE;
            let by_state = (by_place, group.coasting_slope(axis));
            group.adjoint(by_state, &self.steps, 0..self.steps.len(), basis.step_s(), by_plate);
        })
    }

    /// Slopes by every coefficient, `each` columns for each part. `by_plate` adds those of one column by the plate's
    /// motion, for a group and the index of its first part.
    fn columns(
        &self,
        basis: &HarmonicBasis,
        each: usize,
        by_plate: impl Fn(&Group, usize, usize, &mut PlateSlopes),
    ) -> DMatrix<f64> {
        let mut slopes = DMatrix::zeros(basis.len(), each * self.ends_m.len());
        for (group, first) in self.groups.iter().zip((0..).step_by(LANES)) {
            for column in 0..each {
                let mut of_column = PlateSlopes::new(basis);
                by_plate(group, first, column, &mut of_column);
                for (j, of_parts) in basis.slopes(&of_column).enumerate() {
                    let columns = (each * first + column..slopes.ncols()).step_by(each);
                    columns.zip(of_parts.to_array()).for_each(|(column, slope)| slopes[(j, column)] = slope);
                }
            }
        }
        slopes
    }

    /// Positions and velocities after the last step, m and m/s.
    pub fn last(&self) -> impl Iterator<Item = (Vec2, Vec2)> + '_ {
        let lanes = self.groups.iter().flat_map(|group| {
            let [x, y, vx, vy] =
                [group.last_m[0], group.last_m[1], group.last_mps[0], group.last_mps[1]].map(SimdF64::to_array);
            (0..LANES).map(move |lane| (Vec2::new(x[lane], y[lane]), Vec2::new(vx[lane], vy[lane])))
        });
        lanes.take(self.ends_m.len())
    }

    /// Drifts at the end, m/s: mean velocity over the last `window` steps, and half of the speed gained in them.
    pub fn drifts_mps(&self, basis: &HarmonicBasis, window: usize) -> Vec<Vec2> {
        let dt = basis.step_s();
        let first = self.steps.len() - window;
        let (from_m, before_m) = (self.places_at(first), self.places_at(first - 1));
        let from = from_m.iter().zip(before_m);
        self.last()
            .zip(from)
            .map(|((p, v), (p0, p1))| (p - p0) / (window as f64 * dt) + (v - (p0 - p1) / dt) * 0.5)
            .collect()
    }

    /// Slopes, by every coefficient, of each part's drift plus `rates` times its place at the end: a column for each
    /// part's x and y in turn.
    pub fn drift_slopes(&self, basis: &HarmonicBasis, window: usize, rates: &[f64]) -> DMatrix<f64> {
        let dt = basis.step_s();
        let (count, per_s) = (self.steps.len(), 1.0 / (window as f64 * dt));
        self.columns(basis, 2, |group, first, axis, by_plate| {
            let (mut by_place, mut by_speed) = ([SimdF64::ZERO; 2], [SimdF64::ZERO; 2]);
            by_place[axis] = lanes(|lane| rates.get(first + lane).copied().unwrap_or(0.0)) + per_s;
            by_speed[axis] = SimdF64::splat(0.5);
            let range = count - window..count;
            let (mut by_place, mut by_speed) = group.adjoint((by_place, by_speed), &self.steps, range, dt, by_plate);
            by_place[axis] -= per_s;
            by_speed[axis] -= 0.5;
            group.adjoint((by_place, by_speed), &self.steps, 0..count - window, dt, by_plate);
        })
    }

    /// Slopes of the positions before time step `step` along `normals`, one for each part, by every coefficient: a
    /// column for each part.
    pub fn slopes_at(&self, basis: &HarmonicBasis, step: usize, normals: &[Vec2]) -> DMatrix<f64> {
        self.columns(basis, 1, |group, first, _, by_plate| {
            let along = |axis: usize| lanes(|lane| normals.get(first + lane).map_or(0.0, |normal| normal[axis]));
            let by_state = ([along(0), along(1)], [SimdF64::ZERO; 2]);
            group.adjoint(by_state, &self.steps, 0..step, basis.step_s(), by_plate);
        })
    }
}

/// One number for each part of a group.
fn lanes(of: impl Fn(usize) -> f64) -> SimdF64 {
    SimdF64::from(std::array::from_fn::<f64, LANES, _>(of))
}

impl Group {
    /// Moves `discs` from rest through `steps` until they have coasted to rest; returns their final positions, m.
    fn play(&mut self, steps: &[PlateStep], (dt, smoothing_mps): (f64, f64), discs: &[RolloutDisc]) -> [SimdF64; 2] {
        let each = |of: fn(&RolloutDisc) -> f64, idle: f64| lanes(|lane| discs.get(lane).map_or(idle, of));
        let friction_mps2 = each(|disc| disc.friction, 1.0) * GRAVITY_MPS2;
        let pull_mps = friction_mps2 * dt;
        let turning_m2 = each(|disc| KAPPA * disc.radius_m * disc.radius_m, 0.0);
        let coasting = 0.5 / friction_mps2;
        let [mut x, mut y] = [each(|disc| disc.position_m.x, 0.0), each(|disc| disc.position_m.y, 0.0)];
        let [mut vx, mut vy] = [each(|disc| disc.velocity_mps.x, 0.0), each(|disc| disc.velocity_mps.y, 0.0)];
        self.states.clear();
        self.states.extend(steps.iter().map(|PlateStep { plate, .. }| {
            let spin = plate.spin_radps;
            let arm_m = [x - plate.offset_m.x, y - plate.offset_m.y];
            let slip = [plate.velocity_mps.x - vx - arm_m[1] * spin, plate.velocity_mps.y - vy + arm_m[0] * spin];
            let square = slip[0] * slip[0] + slip[1] * slip[1] + turning_m2 * (spin * spin);
            let inverse = 1.0 / (square + smoothing_mps * smoothing_mps).sqrt();
            let pull = slip.map(|slip| slip * inverse);
            vx += pull[0] * pull_mps;
            vy += pull[1] * pull_mps;
            x += vx * dt;
            y += vy * dt;
            RolloutState { arm_m, pull, inverse }
        }));
        (self.pull_mps, self.turning_m2, self.coasting) = (pull_mps, turning_m2, coasting);
        (self.last_m, self.last_mps) = ([x, y], [vx, vy]);
        let coasts_s = (vx * vx + vy * vy).sqrt() * coasting;
        [x + vx * coasts_s, y + vy * coasts_s]
    }

    /// See [`Rollout::edge_shares`].
    fn edge_shares(&self, steps: &[PlateStep], half_side_m: f64) -> SimdF64 {
        let farther = |[x, y]: [SimdF64; 2]| x.abs().max(y.abs());
        let share = |(state, PlateStep { plate, .. }): (&RolloutState, &PlateStep)| {
            let [x, y] = state.arm_m;
            let at_rest_m = half_side_m - farther([x + plate.offset_m.x, y + plate.offset_m.y]);
            // the plate turns by a few degrees at most
            let shaken_m = half_side_m - farther([x + y * plate.turn_rad, y - x * plate.turn_rad]);
            shaken_m / at_rest_m.max(SimdF64::splat(EDGE_M))
        };
        self.states.iter().zip(steps).map(share).fold(SimdF64::ONE, SimdF64::min)
    }

    /// Adds the slopes of a length by the plate's motion in every phase of the steps `range`, given its slopes by
    /// position and by velocity after them; returns those before them.
    fn adjoint(
        &self,
        (mut by_place, mut by_speed): ([SimdF64; 2], [SimdF64; 2]),
        steps: &[PlateStep],
        range: Range<usize>,
        dt: f64,
        by_plate: &mut PlateSlopes,
    ) -> ([SimdF64; 2], [SimdF64; 2]) {
        let PlateSlopes { by_velocity: [by_x, by_y, by_spin], by_displacement } = by_plate;
        for (state, &PlateStep { phase, height, slope, plate }) in
            self.states[range.clone()].iter().zip(&steps[range]).rev()
        {
            let spin = plate.spin_radps;
            by_speed = [by_speed[0] + by_place[0] * dt, by_speed[1] + by_place[1] * dt];
            let along = state.pull[0] * by_speed[0] + state.pull[1] * by_speed[1];
            let pull = self.pull_mps * state.inverse;
            let across = [0, 1].map(|i| (by_speed[i] - state.pull[i] * along) * pull);
            let by_turning = pull * self.turning_m2 * state.inverse * along * spin;
            by_x[phase] += across[0] * height;
            by_y[phase] += across[1] * height;
            let turning = across[1] * state.arm_m[0] - across[0] * state.arm_m[1] - by_turning;
            by_spin[phase] += turning * height;
            if let Some([by_offset_x, by_offset_y, by_turn]) = by_displacement {
                by_offset_x[phase] += across[0] * slope - across[1] * (spin * height);
                by_offset_y[phase] += across[1] * slope + across[0] * (spin * height);
                by_turn[phase] += turning * slope;
            }
            by_speed = [by_speed[0] - across[0], by_speed[1] - across[1]];
            by_place = [by_place[0] + across[1] * spin, by_place[1] - across[0] * spin];
        }
        (by_place, by_speed)
    }

    /// Slope of the distance coasted along `axis`, `v |v| / (2 μ g)`, by the velocity.
    fn coasting_slope(&self, axis: usize) -> [SimdF64; 2] {
        let [vx, vy] = self.last_mps;
        // avoids 0/0 for a part at rest: it does not coast in any direction
        let speed = (vx * vx + vy * vy).sqrt().max(SimdF64::splat(f64::MIN_POSITIVE));
        let mut slope = [vx, vy].map(|v| v * self.last_mps[axis] / speed);
        slope[axis] += speed;
        slope.map(|slope| slope * self.coasting)
    }
}
