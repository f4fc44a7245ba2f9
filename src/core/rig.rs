//! The hardware boundary. Control talks to a [`Rig`] and knows of it only the figures of a [`RigModel`], which are
//! measured with a ruler or read off a data sheet. The rig's actual behaviour (friction, resonance, position of the
//! camera) is determined by vision, estimation and calibration.

mod interlock;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::geometry::{Lens, Vec2};
use crate::signal::{AccelTrace, Drive, Frame, MotorArrangement};
use crate::time::PlateTime;
use crate::units::hertz;

pub use interlock::{Interlock, InterlockGuard, StopTimes, Trip};

/// A kind of part, such as a denomination of coins.
#[derive(Clone, Debug, PartialEq)]
pub struct PartKind {
    /// Name in job files: `penny`.
    pub name: String,
    /// Radius of the outline, m.
    pub radius_m: f64,
    /// Height of the top face above the plate, m.
    pub thickness_m: f64,
}

/// Nominal figures of a rig, known before anything is measured.
#[derive(Clone, Debug, PartialEq)]
pub struct RigModel {
    /// Name in its file.
    pub name: String,
    /// Side of the square plate, m.
    pub plate_side_m: f64,
    /// Distance of the motors' lines of action from the plate's centre, m (r in Eq. 7).
    pub lever_arm_m: f64,
    /// Where the motors stand.
    pub motor_arrangement: MotorArrangement,
    /// Mass of the moving plate, kg, as weighed.
    pub plate_mass_kg: f64,
    /// Moment of inertia of the moving plate about its centre, kg m², from its drawing.
    pub plate_inertia_kgm2: f64,
    /// Force of one count at a motor, N.
    pub newtons_per_count: f64,
    /// Largest sample that a motor may play, counts.
    pub count_limit: f64,
    /// Base frequency of the drive, rad/s.
    pub base_radps: f64,
    /// Attack and decay of every pulse, s.
    pub attack_s: f64,
    /// Rest after the longest pulse, s; shorter ones rest down to half as long.
    pub rest_s: f64,
    /// Longest sustain the rig allows, s.
    pub max_sustain_s: f64,
    /// Synthesised motions; `None` where the rig makes none.
    pub fields: Option<FieldDriveModel>,
    /// Position of accelerometer 1 on the plate, m; number 2 is opposite.
    pub accelerometer_in_plate_m: Vec2,
    /// Frame width and height, px.
    pub frame_size_px: [usize; 2],
    /// Frames per second.
    pub frame_hz: f64,
    /// Exposure time, s.
    pub exposure_s: f64,
    /// The lens according to its calibration sheet.
    pub lens: Lens,
    /// True when parts are darker than the plate.
    pub dark_parts: bool,
}

/// Synthesised motions: periodic ones of many harmonics, each as long as it takes under an envelope of its own.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct FieldDriveModel {
    /// Base frequency of the motions.
    #[serde(rename = "base_hz", with = "hertz")]
    #[schemars(with = "f64", range(min = 5.0, max = 200.0))]
    pub base_radps: f64,
    /// Harmonics of it.
    #[schemars(range(min = 2, max = 16))]
    pub harmonics: usize,
    /// Attack and decay of every pulse, s; half a period of the base frequency or more.
    #[schemars(range(min = 0.0, max = 1.0))]
    pub attack_s: f64,
    /// Rest after every pulse, until parts stand still, s.
    #[schemars(range(min = 0.0, max = 5.0))]
    pub rest_s: f64,
}

/// Reason for which a rig refused or failed to act.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum RigError {
    /// The drive exceeds the motors' limit.
    #[error("drive peaks at {peak_counts:.0} counts, the rig allows {limit_counts:.0}")]
    DriveTooStrong {
        /// Peak of the drive, counts.
        peak_counts: f64,
        /// Largest peak that the rig allows, counts.
        limit_counts: f64,
    },
    /// A pulse is still being played.
    #[error("a pulse is being played until {0}")]
    Busy(PlateTime),
    /// No pulse is playing that another one could take over from.
    #[error("nothing is playing that this drive could take over from")]
    TooLate,
    /// The drive is invalid: not a number, negative lengths, or longer than allowed.
    #[error("bad drive: {0}")]
    BadDrive(String),
    /// The device failed.
    #[error("{0}")]
    Device(String),
    /// Its interlock tripped: motors are at zero and stay there.
    #[error("{0}")]
    Stopped(Trip),
}

/// A plate with its motors, accelerometers and camera. Time passes only in [`Rig::capture`].
pub trait Rig {
    /// Plate time now.
    fn now(&self) -> PlateTime;

    /// Starts a pulse and returns at once; the pulse plays while frames are captured.
    ///
    /// # Errors
    /// [`RigError::BadDrive`] or [`RigError::DriveTooStrong`] for a drive that the rig cannot play, [`RigError::Busy`]
    /// before the last pulse and its rest are over, [`RigError::Stopped`] once the interlock has tripped, and
    /// [`RigError::Device`] when the device fails.
    fn play(&mut self, drive: &Drive) -> Result<(), RigError>;

    /// True for a rig that lets one pulse take over from another.
    fn takes_over(&self) -> bool {
        false
    }

    /// Lets `drive` take over from the playing pulse without a pause, at the end of that pulse's attack, or of its
    /// sustain where the attack is over: the old pulse decays while the new one rises. Where nothing takes over in
    /// time, a pulse plays to its end. Returns the time at which `drive` starts. Only motions without pauses need it.
    ///
    /// # Errors
    /// Those of [`Rig::play`]; [`RigError::TooLate`] where no pulse is playing, its decay has begun, or another one
    /// takes over already, and [`RigError::Device`] from rigs that play one pulse at a time. The present pulse goes
    /// on.
    fn take_over(&mut self, _drive: &Drive) -> Result<PlateTime, RigError> {
        Err(RigError::Device("this rig plays one pulse at a time: take another planner than moving_field".into()))
    }

    /// End of the last pulse, its rest included; not later than [`Rig::now`] when no pulse is playing.
    fn settled_at(&self) -> PlateTime;

    /// Waits for the camera's next exposure and reads it out into `frame`, which is resized as needed.
    ///
    /// # Errors
    /// [`RigError::Stopped`] once the interlock has tripped, and [`RigError::Device`] when the device fails.
    fn capture(&mut self, frame: &mut Frame) -> Result<(), RigError>;

    /// The accelerometers' trace of the last pulse, up to now; of the one before while a pulse that took over rises.
    fn trace(&self) -> AccelTrace;

    /// Sets the motors to zero at once. Always safe to call.
    fn stop(&mut self);

    /// Lets plate time pass until `until` without driving the rig, for effects of time on the hardware. Motors that are
    /// playing fall silent after [`Interlock::LEASE_S`].
    ///
    /// # Errors
    /// [`RigError::Stopped`] when motors fell silent in this way, and once the interlock has tripped.
    fn pass(&mut self, _until: PlateTime) -> Result<(), RigError> {
        Ok(())
    }
}
