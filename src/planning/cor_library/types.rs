use nalgebra::{Complex, Matrix3};

use upm_core::geometry::{Twist, Vec2};
use upm_core::signal::{CHANNELS, Harmonic, MotorArrangement};

/// One motion of the rig.
#[derive(Clone, Debug, PartialEq)]
pub struct Entry {
    /// Amplitudes sent to the motors X1, X2, Y1, Y2, counts.
    pub amplitudes: [i32; 4],
    /// Measured amplitude T of the plate's pump wave `T (cos wt - ½ cos 2wt)` at full height.
    pub pump: Twist,
}

impl Entry {
    /// Centre of rotation, m; `None` for a translation, with a spin of exactly zero.
    pub fn center_m(&self) -> Option<Vec2> {
        self.pump.center_of_rotation()
    }

    /// Amplitude of the plate's speed under a part at `p_m`, m/s.
    pub fn speed_at(&self, p_m: Vec2) -> f64 {
        self.pump.velocity_at(p_m).norm()
    }
}

/// Force waveform of one axis (x, y or spin) for one unit of that axis's amplitude: harmonics 1 and 2, pre-compensated
/// for the calibrated deviation of the plate's response from 1/w.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AxisShape(pub [Harmonic; 2]);

impl AxisShape {
    /// `cos wt - sin 2wt` (Eq. 8): exact for a plate that is a free mass.
    pub const FREE_MASS: Self = Self([Harmonic { cos: 1.0, sin: 0.0 }, Harmonic { cos: 0.0, sin: -1.0 }]);
}

/// Measured distance of a part in one pulse: a grid over the plate's speed amplitude under the part and the pulse's
/// sustain. For a rotation the speed is spin times radius, so this is d(radius, sustain) of every entry at once, at any
/// spin.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct DisplacementModel {
    /// Grid of speed amplitudes, m/s, rising.
    pub speed_mps: Vec<f64>,
    /// Grid of sustains, s, rising.
    pub sustain_s: Vec<f64>,
    /// `distance_m[i][k]` at `speed_mps[i]`, `sustain_s[k]`, m along the flow.
    pub distance_m: Vec<Vec<f64>>,
    /// Standard deviation of one such pulse, m, same shape.
    pub sd_m: Vec<Vec<f64>>,
}

/// Calibration of a rig: written by `upm calibrate`, used by the planner.
#[derive(Clone, Debug, PartialEq)]
pub struct Library {
    /// Name of the rig it was measured on.
    pub rig: String,
    /// Fingerprint of that rig's file.
    pub fingerprint: String,
    /// Where its motors stand.
    pub motor_arrangement: MotorArrangement,
    /// Side of that rig's plate, m.
    pub plate_side_m: f64,
    /// Base frequency, rad/s.
    pub base_radps: f64,
    /// Attack of every pulse, s.
    pub attack_s: f64,
    /// Rest after the longest pulse, s; see [`Library::rest_after`].
    pub rest_s: f64,
    /// Reading of each accelerometer channel for a true 1, relative to the others.
    pub accelerometer_gain: [f64; CHANNELS],
    /// Force waveforms of x, y and spin.
    pub shapes: [AxisShape; 3],
    /// All motions, in a fixed order.
    pub entries: Vec<Entry>,
    /// Measured distances of parts.
    pub displacement: DisplacementModel,
    /// Response of the plate to synthesised motions; `None` where the rig has none.
    pub fields: Option<FieldResponse>,
    /// Resonances of the plate's axes; `None` where the rig's longest sustain is too short to determine them.
    pub plate: Option<PlateResponse>,
}

/// The plate's axes as mass-spring-dampers `m q̈ + b q̇ + k q = f` (UPM paper, Eq. 33), in the order x, y, spin; all
/// zero is a free mass.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct PlateResponse {
    /// Undamped natural frequencies `sqrt(k/m)`, rad/s.
    pub natural_radps: [f64; 3],
    /// Damping ratios `b / (2 sqrt(k m))`.
    pub damping_ratio: [f64; 3],
}

/// Response of the plate to each harmonic of the synthesised motions' base frequency.
#[derive(Clone, Debug, PartialEq)]
pub struct FieldResponse {
    /// Base frequency w, rad/s.
    pub base_radps: f64,
    /// Attack of every pulse, s.
    pub attack_s: f64,
    /// Rest after every pulse, s.
    pub rest_s: f64,
    /// Largest sample that a motor may play, counts.
    pub limit_counts: f64,
    /// For harmonic k at index `k - 1` the velocity phasors of x (m/s), y (m/s) and spin (rad/s), row by row, for one
    /// count of each axis amplitude fx, fy and s ([`MotorArrangement`]), column by column: a force
    /// `f(t) = Re(f e^{jkwt})` makes the plate move as `v(t) = Re(G f e^{jkwt})`, times from the start of the pulse.
    pub twist_from_counts: Vec<Matrix3<Complex<f64>>>,
}
