//! The part: a rigid box that moves freely in space.

use nalgebra::{Matrix3, Translation3, UnitQuaternion, Vector3};

/// Shape and mass of a part.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PartShape {
    /// Half lengths along its own axes, m.
    pub half_m: Vector3<f64>,
    pub mass_kg: f64,
}

/// A part's pose and velocities.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MChipPart {
    /// Centre of mass, m.
    pub center_m: Vector3<f64>,
    pub turn: UnitQuaternion<f64>,
    /// Velocity of the centre, m/s.
    pub velocity_mps: Vector3<f64>,
    /// Angular velocity in the array's axes, rad/s.
    pub spin_radps: Vector3<f64>,
}

impl PartShape {
    /// 1.15×0.4×0.25 mm and 55 µg: the paper's box and the mass of its experiments, though silicon would weigh 268 µg.
    pub fn published() -> Self {
        Self { half_m: Vector3::new(0.575e-3, 0.2e-3, 0.125e-3), mass_kg: 55e-9 }
    }

    /// Principal moments of inertia, kg m².
    pub fn inertia_kgm2(&self) -> Vector3<f64> {
        let square = self.half_m.component_mul(&self.half_m);
        Vector3::new(square.y + square.z, square.x + square.z, square.x + square.y) * (self.mass_kg / 3.0)
    }

    /// Inverse of the inertia in the array's axes, 1/(kg m²), of a part rotated by `rotation`.
    pub fn inverse_inertia(&self, rotation: &Matrix3<f64>) -> Matrix3<f64> {
        let inverse = Matrix3::from_diagonal(&self.inertia_kgm2().map(f64::recip));
        rotation * inverse * rotation.transpose()
    }

    /// Kinetic energies along x, y, z and about the part's own x, y, z, J.
    pub fn kinetic_j(&self, state: &MChipPart) -> [f64; 6] {
        let spin = state.turn.inverse() * state.spin_radps;
        let inertia = self.inertia_kgm2();
        std::array::from_fn(|i| match i {
            0..3 => 0.5 * self.mass_kg * state.velocity_mps[i].powi(2),
            _ => 0.5 * inertia[i - 3] * spin[i - 3].powi(2),
        })
    }
}

impl MChipPart {
    /// A part at rest with the middle of its bottom at `bottom_m`.
    pub fn resting(shape: &PartShape, bottom_m: Vector3<f64>, turn: UnitQuaternion<f64>) -> Self {
        Self {
            center_m: bottom_m + Vector3::z() * shape.half_m.z,
            turn,
            velocity_mps: Vector3::zeros(),
            spin_radps: Vector3::zeros(),
        }
    }

    /// Advances by a step under a constant acceleration; the gyroscopic torque of a box this flat and slow is
    /// neglected.
    pub fn step(&mut self, accel_mps2: &Vector3<f64>, step_s: f64) {
        self.center_m += (self.velocity_mps + accel_mps2 * (0.5 * step_s)) * step_s;
        self.velocity_mps += accel_mps2 * step_s;
        self.turn = UnitQuaternion::from_scaled_axis(self.spin_radps * step_s) * self.turn;
    }

    /// Velocity of the part's point at `arm_m` from its centre, m/s.
    pub fn point_velocity_mps(&self, arm_m: &Vector3<f64>) -> Vector3<f64> {
        self.velocity_mps + self.spin_radps.cross(arm_m)
    }

    pub fn pose(&self) -> nalgebra::Isometry3<f64> {
        nalgebra::Isometry3::from_parts(Translation3::from(self.center_m), self.turn)
    }
}
