//! The plate on its rods: x, y and spin, each a mass-spring-damper `m q̈ + b q̇ + k q = f` (UPM paper, Eq. 33).
//!
//! ```text
//!      ┌──────────┐ ↑ Y1       inputs: wrench at the centre (N, N m)
//!      │ X1 →     │            states: displacement from rest (m, m, rad) and its rate
//!      │    +     │            output: pose, twist and acceleration of the centre
//!      │     ← X2 │
//!   Y2 ↓ ─────────┘
//! ```
//!
//! Valid for displacements small against the plate: the axes are not coupled and forces keep the table's directions.

use nalgebra::Vector3;

use super::PlateParams;
use super::oscillator::{ModeState, Oscillator};
use upm_core::geometry::{Pose, Twist, Vec2, perp};

/// Force along x and y, N, and torque about the plate's centre, N m.
pub type Wrench = Vector3<f64>;

/// The plate's motion at one instant, in the table frame.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct PlateMotion {
    /// Pose relative to the rest position.
    pub plate_in_table: Pose,
    /// Velocity of its centre and its spin.
    pub twist: Twist,
    /// Acceleration of its centre (m/s²) and of its spin (rad/s²).
    pub acceleration: Twist,
}

impl PlateMotion {
    /// Mean of two motions one step apart.
    pub fn midway(&self, later: &Self) -> Self {
        let (a, b) = (&self.plate_in_table, &later.plate_in_table);
        Self {
            plate_in_table: Pose {
                position_m: (a.position_m + b.position_m) * 0.5,
                heading_rad: 0.5 * (a.heading_rad + b.heading_rad),
            },
            twist: (self.twist + later.twist) * 0.5,
            acceleration: (self.acceleration + later.acceleration) * 0.5,
        }
    }

    /// The pose `before_s` earlier, to second order: the error grows with the cube of `before_s`.
    pub fn pose_before(&self, before_s: f64) -> Pose {
        let moved = self.twist * -before_s + self.acceleration * (0.5 * before_s * before_s);
        Pose {
            position_m: self.plate_in_table.position_m + moved.velocity_mps,
            heading_rad: self.plate_in_table.heading_rad + moved.spin_radps,
        }
    }

    /// Proper acceleration of a sensor fixed to the plate at `p_plate_m`, along the plate's axes, m/s²: the centre's
    /// acceleration, that of the spin, and the centripetal part.
    pub fn proper_acceleration_at(&self, p_plate_m: Vec2) -> Vec2 {
        let (sin, cos) = libm::sincos(self.plate_in_table.heading_rad);
        let center = self.acceleration.velocity_mps;
        let center_in_plate = center * cos - perp(center) * sin;
        let spin = self.twist.spin_radps;
        center_in_plate + perp(p_plate_m) * self.acceleration.spin_radps - p_plate_m * (spin * spin)
    }
}

/// The plate's state.
#[derive(Clone, Debug)]
pub(crate) struct ShakenPlate {
    params: PlateParams,
    step_s: f64,
    axes: [Oscillator; 3],
    inverse_inertia: Vector3<f64>,
    motions: [ModeState; 3],
    wrench: Wrench,
}

impl ShakenPlate {
    /// A plate at rest, for steps of `step_s`.
    pub fn new(params: &PlateParams, step_s: f64) -> Self {
        let inverse_mass = params.mass_kg.recip();
        Self {
            params: *params,
            step_s,
            axes: axes(params, step_s, 1.0),
            inverse_inertia: Vector3::new(inverse_mass, inverse_mass, params.inertia_kgm2.recip()),
            motions: [ModeState::default(); 3],
            wrench: Wrench::default(),
        }
    }

    /// Sets the natural frequencies to `factor` times those at construction.
    pub fn detune(&mut self, factor: f64) {
        self.axes = axes(&self.params, self.step_s, factor);
    }

    /// Displaces the plate by `by_m` now.
    pub fn bump(&mut self, by_m: Vec2) {
        self.motions[0].position += by_m.x;
        self.motions[1].position += by_m.y;
    }

    /// Advances one step. `wrench` is that at the step's end; over the step its mean with the previous one acts.
    pub fn step(&mut self, wrench: Wrench) {
        let mean = ((self.wrench + wrench) * 0.5).component_mul(&self.inverse_inertia);
        for ((axis, motion), input) in self.axes.iter().zip(&mut self.motions).zip(&mean) {
            *motion = axis.step(*motion, *input);
        }
        self.wrench = wrench;
    }

    /// Present pose, twist and acceleration.
    pub fn motion(&self) -> PlateMotion {
        let [x, y, spin] = self.motions;
        let inputs = self.wrench.component_mul(&self.inverse_inertia);
        let acceleration = |i: usize| self.axes[i].acceleration(self.motions[i], inputs[i]);
        PlateMotion {
            plate_in_table: Pose { position_m: Vec2::new(x.position, y.position), heading_rad: spin.position },
            twist: Twist::new(x.velocity, y.velocity, spin.velocity),
            acceleration: Twist::new(acceleration(0), acceleration(1), acceleration(2)),
        }
    }

    /// Sets the plate to its rest position, at rest.
    pub fn settle(&mut self) {
        self.motions = [ModeState::default(); 3];
        self.wrench = Wrench::default();
    }
}

fn axes(params: &PlateParams, step_s: f64, detuned: f64) -> [Oscillator; 3] {
    let natural_radps = |i: usize| std::f64::consts::TAU * params.resonance_hz[i] * detuned;
    std::array::from_fn(|i| Oscillator::new(natural_radps(i), params.damping_ratio[i], step_s))
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Complex;
    use std::f64::consts::TAU;

    const PARAMS: PlateParams = PlateParams {
        side_m: 0.2032,
        mass_kg: 0.4,
        inertia_kgm2: 2.8e-3,
        resonance_hz: [7.0, 8.0, 11.0],
        damping_ratio: [0.05, 0.2, 1.0],
    };

    /// Amplitude and phase of each axis at each harmonic against `1/(k - m w² + i b w)`.
    #[test]
    fn response_follows_the_transfer_function() {
        let (step_s, inertias) = (5e-5, [PARAMS.mass_kg, PARAMS.mass_kg, PARAMS.inertia_kgm2]);
        for (axis, inertia) in inertias.into_iter().enumerate() {
            for hz in [5.0, 20.0, 60.0, 120.0, 180.0] {
                let w = TAU * hz;
                let mut plate = ShakenPlate::new(&PARAMS, step_s);
                let (settle, periods) = (4.0, 20.0);
                let (from, steps) = ((settle / step_s) as usize, ((settle + periods / hz) / step_s).round() as usize);
                let mut sum = Complex::new(0.0, 0.0);
                for i in 1..=steps {
                    let t = i as f64 * step_s;
                    let pull = (w * t).cos();
                    let force = Vec2::new(if axis == 0 { pull } else { 0.0 }, if axis == 1 { pull } else { 0.0 });
                    plate.step(Wrench::new(force.x, force.y, if axis == 2 { pull } else { 0.0 }));
                    if i > from {
                        sum += Complex::from_polar(plate.motions[axis].position, -w * t);
                    }
                }
                let measured = sum * 2.0 / (steps - from) as f64;
                let w0 = TAU * PARAMS.resonance_hz[axis];
                let stiff = Complex::new(w0 * w0 - w * w, 2.0 * PARAMS.damping_ratio[axis] * w0 * w) * inertia;
                let error = (measured * stiff - 1.0).norm();
                assert!(error < 2e-3, "axis {axis} at {hz} Hz: {error}");
            }
        }
    }

    #[test]
    fn sensor_measures_spin_and_centre_acceleration() {
        let p = Vec2::new(0.08, 0.06);
        let spinning = PlateMotion {
            twist: Twist::new(0.0, 0.0, 3.0),
            acceleration: Twist::new(1.0, 2.0, 10.0),
            ..Default::default()
        };
        let felt = spinning.proper_acceleration_at(p);
        assert!((felt - Vec2::new(1.0 - 0.6 - 0.72, 2.0 + 0.8 - 0.54)).norm() < 1e-12);
        let quarter = Pose { position_m: Vec2::zeros(), heading_rad: std::f64::consts::FRAC_PI_2 };
        let turned =
            PlateMotion { plate_in_table: quarter, acceleration: Twist::new(0.0, 1.0, 0.0), ..Default::default() };
        assert!((turned.proper_acceleration_at(p) - Vec2::new(1.0, 0.0)).norm() < 1e-12);
    }
}
