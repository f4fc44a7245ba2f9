//! One part: constants and state.

use crate::PartParams;
use upm_core::geometry::{Pose, Vec2};
use upm_core::units::GRAVITY_MPS2;

/// Distance of a fallen part's rim from the plate's edge, m: clear of the plate under any shaking.
const FALLEN_CLEARANCE_M: f64 = 5e-3;

/// State of one part in the table frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PartMotion {
    /// Pose of the part in the table frame.
    pub part_in_table: Pose,
    /// Its velocity, m/s.
    pub velocity_mps: Vec2,
    /// Its spin, rad/s, counter-clockwise.
    pub spin_radps: f64,
    /// False once its centre has left the plate; it then rests beside the plate permanently.
    pub on_plate: bool,
}

impl PartMotion {
    /// A part at rest on the plate.
    pub fn at_rest(part_in_table: Pose) -> Self {
        Self { part_in_table, velocity_mps: Vec2::zeros(), spin_radps: 0.0, on_plate: true }
    }

    /// The pose `before_s` earlier, at most one step.
    pub fn pose_before(&self, before_s: f64) -> Pose {
        Pose {
            position_m: self.part_in_table.position_m - self.velocity_mps * before_s,
            heading_rad: self.part_in_table.heading_rad - self.spin_radps * before_s,
        }
    }
}

/// One part: constants and state.
#[derive(Clone, Copy, Debug)]
pub struct PartBody {
    pub motion: PartMotion,
    pub radius_m: f64,
    pub inverse_mass: f64,
    pub mass_kg: f64,
    /// Largest change of speed by friction in one step, μ g h, m/s.
    pub reach_mps: f64,
    /// Its pose before it was taken off the plate.
    pub taken_from: Option<Pose>,
}

impl PartBody {
    /// A part at rest on the plate.
    pub fn new(params: &PartParams, part_in_table: Pose, step_s: f64) -> Self {
        Self {
            motion: PartMotion::at_rest(part_in_table),
            radius_m: params.radius_m,
            inverse_mass: params.mass_kg.recip(),
            mass_kg: params.mass_kg,
            reach_mps: params.friction * GRAVITY_MPS2 * step_s,
            taken_from: None,
        }
    }

    /// Moment of inertia of a uniform disc, kg m².
    pub fn inertia_kgm2(&self) -> f64 {
        0.5 * self.mass_kg * self.radius_m * self.radius_m
    }

    /// Its slide, m/s, and its spin, rad/s, against a plate that moves at `surface_mps` at the part and spins at
    /// `surface_radps`.
    #[inline]
    pub fn slip(&self, surface_mps: Vec2, surface_radps: f64) -> (Vec2, f64) {
        (self.motion.velocity_mps - surface_mps, self.motion.spin_radps - surface_radps)
    }

    /// Lower bound of the squared speed of the rim's fastest point, m²/s².
    pub fn min_rim_speed_squared(&self) -> f64 {
        self.motion.velocity_mps.norm_squared() + (self.radius_m * self.motion.spin_radps).powi(2)
    }

    /// Lets the part tip over the edge that it passed at `arm_m` from the plate's centre and come to rest beside the
    /// plate.
    #[cold]
    pub fn fall(&mut self, arm_m: Vec2, half_side_m: f64) {
        let clear = half_side_m + self.radius_m + FALLEN_CLEARANCE_M;
        let outwards = clear / arm_m.amax() - 1.0;
        self.motion.part_in_table.position_m += arm_m * outwards.max(0.0);
        self.motion.velocity_mps = Vec2::zeros();
        self.motion.spin_radps = 0.0;
        self.motion.on_plate = false;
    }
}
