//! The array at rest: its tiles, its mechanics and the strength of its drive (M-Chip paper, section II).

use std::f64::consts::PI;

use nalgebra::Vector3;

use super::resonator::{Rotor, free_swing};

/// Density of silicon, kg/m³.
pub const SILICON_KGPM3: f64 = 2_330.0;
/// Rows along the feed. Row 0 is the paper's row 1.
pub const ROWS: usize = 8;
/// Resonators in a row.
pub const COLUMNS: usize = 5;
/// Length (along x), width (along y) and thickness of a slab, m.
pub const SLAB_M: [f64; 3] = [280e-6, 180e-6, 5e-6];
/// Distance between neighbouring slabs along x and along y, m. Not in the paper.
const GAP_M: f64 = 10e-6;
/// Distances between neighbouring axes along x and along y, m.
pub const PITCH_M: [f64; 2] = [SLAB_M[0] + GAP_M, SLAB_M[1] + GAP_M];
/// Extent of the array along x, m.
pub const LENGTH_M: f64 = ROWS as f64 * PITCH_M[0];
/// Shift of every second row along y, in column pitches: the interleaved tiling.
const ROW_SHIFT: f64 = 0.5;

/// Ridges, mechanics and drive strength of one array. Feed is along +x; the ridge is on the trailing half of every
/// slab.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Device {
    /// Position of the ridge from the axis along x, m: the paper's L, negative on the trailing side.
    pub ridge_place_m: f64,
    /// Height of the ridge above the slab, m: the paper's H.
    pub ridge_height_m: f64,
    /// Radius of the ridge's rim, m: the collision envelope of a rigid-body engine. Without one no part jams, since a
    /// rim that rises past a part's front meets its bottom as soon as the part has moved at all.
    pub rim_radius_m: f64,
    /// Mass of a slab over that of solid silicon: fabricated slabs are gratings.
    pub solidity: f64,
    /// Undamped natural frequency, Hz.
    pub natural_hz: f64,
    /// Damping over critical damping.
    pub damping_ratio: f64,
    /// Frequency of the torque wave, Hz.
    pub drive_hz: f64,
    /// Largest angle of the free oscillation at a duty of a half, rad.
    pub peak_rad: f64,
    pub friction: f64,
    pub restitution: f64,
}

impl Device {
    /// The array that the paper simulates: 5 kHz and 0.08 rad.
    ///
    /// Natural frequency, damping, solidity and rim are not in the paper. Each pair of the first two with which the
    /// free oscillation runs from 0 to 0.08 rad is possible; this choice has impacts 0.02, 0.18 and 0.2 ms apart at 50
    /// % duty and only 0.2 ms apart at 36 %, jams at new rows, and a rate near 0.8 mm/s.
    pub fn published() -> Self {
        Self {
            ridge_place_m: -140e-6,
            ridge_height_m: 5e-6,
            rim_radius_m: 0.75e-6,
            solidity: 0.6,
            natural_hz: 7_500.0,
            damping_ratio: 0.78,
            drive_hz: 5_000.0,
            peak_rad: 0.08,
            friction: 1.0,
            restitution: 0.5,
        }
    }

    /// The array on soft, lightly damped rods, driven above their natural frequency: the paper's spring and its free
    /// bouncing are reproduced, but the rate is three times as large, and nothing bounces twice or jams.
    pub fn soft() -> Self {
        Self { natural_hz: 4_000.0, damping_ratio: 0.5, ..Self::published() }
    }

    /// Moment of inertia of a slab about its rods, kg m². The ridge's own mass is left out.
    pub fn inertia_kgm2(&self) -> f64 {
        let mass_kg = self.solidity * SILICON_KGPM3 * SLAB_M.iter().product::<f64>();
        let [length_m, _, thickness_m] = SLAB_M;
        mass_kg * (length_m.powi(2) + thickness_m.powi(2)) / 12.0
    }

    /// Height at which the bottom of a part rests on ridges at rest, m.
    pub fn rest_height_m(&self) -> f64 {
        0.5 * SLAB_M[2] + self.ridge_height_m
    }

    /// Height above its rest position that a rim reaches in the free oscillation at a duty of a half, m.
    pub fn reach_m(&self) -> f64 {
        -self.ridge_place_m * self.peak_rad.sin()
    }

    pub fn rotor(&self) -> Rotor {
        let natural_radps = 2.0 * PI * self.natural_hz;
        let inertia_kgm2 = self.inertia_kgm2();
        Rotor {
            inertia_kgm2,
            stiffness_nm: inertia_kgm2 * natural_radps.powi(2),
            damping_nms: 2.0 * self.damping_ratio * inertia_kgm2 * natural_radps,
        }
    }

    /// Torque of the drive while it is on, N m: at a duty of a half it swings a free resonator up to `peak_rad`.
    pub fn torque_nm(&self) -> f64 {
        let rotor = self.rotor();
        // the oscillation is linear in the torque: scale that of the torque that holds one radian
        let peak_rad = free_swing(&rotor, rotor.stiffness_nm, self.drive_hz, 0.5)[1];
        rotor.stiffness_nm * self.peak_rad / peak_rad
    }
}

/// Middle of a resonator's axis, m: the array starts at x = 0 and is centred on y = 0; axes are at z = 0.
pub fn axis_m(row: usize, column: usize) -> Vector3<f64> {
    let x = row as f64 + 0.5;
    // half the shift in both directions keeps the array centred
    let shift = if row % 2 == 1 { ROW_SHIFT } else { 0.0 };
    let y = column as f64 - 0.5 * (COLUMNS as f64 - 1.0) + shift - 0.5 * ROW_SHIFT;
    Vector3::new(x * PITCH_M[0], y * PITCH_M[1], 0.0)
}
