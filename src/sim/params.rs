use nalgebra::Vector3;

use upm_core::geometry::{Lens, Vec2};
use upm_core::signal::MotorArrangement;

/// Constant parameters of the simulated rig, apart from all state.
#[derive(Clone, Debug, PartialEq)]
pub struct SimParams {
    /// Time step of motors, plate and parts, s.
    pub step_s: f64,
    /// Size, mass and springs of the plate.
    pub plate: PlateParams,
    /// Waveform generator, amplifiers and voice coils.
    pub motors: MotorParams,
    /// The two accelerometers.
    pub accelerometers: AccelerometerParams,
    /// Optics, position and noise of the camera, and the light.
    pub camera: CameraParams,
    /// Contact between parts.
    pub contact: ContactParams,
}

/// A plate on flexible rods: each axis a mass-spring-damper (Eq. 33). Order of triples: x, y, spin.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PlateParams {
    /// Length of the square plate's edges, m.
    pub side_m: f64,
    /// Moving mass, kg.
    pub mass_kg: f64,
    /// Moment of inertia about the centre, kg m².
    pub inertia_kgm2: f64,
    /// Undamped natural frequency of each axis, Hz.
    pub resonance_hz: [f64; 3],
    /// Damping ratio of each axis.
    pub damping_ratio: [f64; 3],
}

/// Parameters from counts to newtons.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MotorParams {
    /// Distance of the lines of action from the centre, m.
    pub lever_arm_m: f64,
    /// Where the motors stand.
    pub arrangement: MotorArrangement,
    /// Force of one count, N.
    pub newtons_per_count: f64,
    /// Relative error of each motor's force.
    pub gain_error: [f64; 4],
    /// Sampling rate of the waveform generator, Hz.
    pub sample_hz: f64,
    /// Largest sample, counts; rounding is to whole counts.
    pub count_limit: f64,
    /// Corner of the low-pass behind the PWM (two poles, Butterworth), Hz.
    pub low_pass_hz: f64,
    /// Force at which a coil's amplifier saturates, N.
    pub force_limit_n: f64,
}

/// Two 2-axis accelerometers under opposite corners.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AccelerometerParams {
    /// Position of number 1 on the plate, m; number 2 is opposite.
    pub position_m: Vec2,
    /// Sampling rate, Hz.
    pub sample_hz: f64,
    /// Bits of the converter, sign included.
    pub bits: u32,
    /// Largest measurable acceleration, m/s².
    pub range_mps2: f64,
    /// Standard deviation of the white noise per sample, m/s².
    pub noise_mps2: f64,
    /// Standard deviation of each channel's constant offset, m/s².
    pub bias_sd_mps2: f64,
    /// Standard deviation of each channel's gain error.
    pub gain_sd: f64,
}

/// A pinhole camera above the plate, and the light.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CameraParams {
    /// Columns and rows, px.
    pub size_px: [usize; 2],
    /// Frame rate, Hz.
    pub frame_hz: f64,
    /// Exposure time, s.
    pub exposure_s: f64,
    /// Focal length, principal point and distortion.
    pub lens: Lens,
    /// Position of the camera's centre in the table frame, m; the camera faces down.
    pub position_m: Vector3<f64>,
    /// Rotation about the image's x and y axes and about the optical axis, rad.
    pub tilt_rad: [f64; 3],
    /// Standard deviation of the lens's Gaussian blur, px.
    pub blur_px: f64,
    /// Gray levels of ground, plate and parts in full light.
    pub levels: [f64; 3],
    /// Relative loss of light from the near to the far corner, 0 to 1.
    pub shading: f64,
    /// Direction in the image in which light falls off, rad.
    pub shading_direction_rad: f64,
    /// Electrons at gray level 255, which determine the shot noise. Infinite for none.
    pub full_well_e: f64,
    /// Standard deviation of the read noise, gray levels.
    pub read_noise: f64,
}

/// Contact between parts.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ContactParams {
    /// Coefficient of restitution between parts.
    pub restitution: f64,
    /// Coefficient of Coulomb friction between rims.
    pub rim_friction: f64,
}

/// One part: a disc.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PartParams {
    /// Radius of its outline, m.
    pub radius_m: f64,
    /// Height, m.
    pub thickness_m: f64,
    /// Mass of the disc, kg.
    pub mass_kg: f64,
    /// Coefficient of Coulomb friction against the plate.
    pub friction: f64,
}

#[cfg(test)]
impl PartParams {
    /// A US penny on a plate of friction 0.3.
    pub const PENNY: Self = Self { radius_m: 9.525e-3, thickness_m: 1.52e-3, mass_kg: 2.5e-3, friction: 0.3 };
}
