//! The hardware boundary. Control talks to a [`Rig`] and knows of it only what a [`RigModel`] says:
//! figures a person can measure with a ruler or read off a data sheet. How the rig really behaves
//! (friction, resonance, where the camera hangs) is found out by vision, estimation and calibration.

mod interlock;

use crate::geometry::{Lens, Vec2};
use crate::signal::{AccelTrace, Drive, Frame};
use crate::time::PlateTime;

pub use interlock::{Fitted, Interlock, StopTimes, Trip};

/// A kind of part.
#[derive(Clone, Debug, PartialEq)]
pub struct PartKind {
    /// Name in job files: `penny`.
    pub name: String,
    /// Outline, m.
    pub radius_m: f64,
    /// Height, m.
    pub thickness_m: f64,
}

/// What is known of a rig before anything is measured.
#[derive(Clone, Debug, PartialEq)]
pub struct RigModel {
    /// Name in its file.
    pub name: String,
    /// Side of the square plate, m.
    pub plate_side_m: f64,
    /// Distance of the motors' lines of action from the plate's centre, m (r in Eq. 7).
    pub lever_arm_m: f64,
    /// Mass of the moving plate, kg, from the scales.
    pub plate_mass_kg: f64,
    /// Moment of inertia of the moving plate about its centre, kg m², from its drawing.
    pub plate_inertia_kgm2: f64,
    /// Force of one count at a motor, N.
    pub newtons_per_count: f64,
    /// Largest sample a motor may be told to play, counts.
    pub count_limit: f64,
    /// Base frequency of the drive, rad/s.
    pub base_radps: f64,
    /// Attack and decay of every pulse, s.
    pub attack_s: f64,
    /// Rest after every pulse, s.
    pub rest_s: f64,
    /// Longest sustain the rig allows, s.
    pub max_sustain_s: f64,
    /// Synthesised motions; `None` where the rig shall make none.
    pub fields: Option<FieldDriveModel>,
    /// Position of accelerometer 1 on the plate, m; number 2 is opposite.
    pub accelerometer_in_plate_m: Vec2,
    /// Frame width and height, px.
    pub frame_size_px: [usize; 2],
    /// Frames a second.
    pub frame_hz: f64,
    /// Time the shutter is open, s.
    pub exposure_s: f64,
    /// The lens as its calibration sheet has it.
    pub lens: Lens,
    /// True when parts are darker than the plate.
    pub dark_parts: bool,
}

/// Synthesised motions: periodic ones of many harmonics under an envelope of their own.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FieldDriveModel {
    /// Base frequency, rad/s.
    pub base_radps: f64,
    /// Harmonics of it.
    pub harmonics: usize,
    /// Attack and decay of every pulse, s.
    pub attack_s: f64,
    /// Rest after every pulse, s.
    pub rest_s: f64,
}

/// Why a rig did not do what it was told.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum RigFault {
    /// The drive asks for more than the motors may give.
    #[error("drive peaks at {peak_counts:.0} counts, the rig allows {limit_counts:.0}")]
    DriveTooStrong {
        /// What was asked, counts.
        peak_counts: f64,
        /// What is allowed, counts.
        limit_counts: f64,
    },
    /// A pulse is still sounding.
    #[error("a pulse is still sounding until {0}")]
    Busy(PlateTime),
    /// The drive is not a drive: not a number, negative lengths, longer than allowed.
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

    /// Starts a pulse now and returns at once; it sounds while frames are captured.
    fn play(&mut self, drive: &Drive) -> Result<(), RigFault>;

    /// When the last pulse, its rest included, is over; not later than [`Rig::now`] when nothing sounds.
    fn quiet_at(&self) -> PlateTime;

    /// Waits for the camera's next exposure and reads it out into `frame`, which is made to fit.
    fn capture(&mut self, frame: &mut Frame) -> Result<(), RigFault>;

    /// What the accelerometers saw of the last pulse, up to now.
    fn trace(&self) -> AccelTrace;

    /// Motors to zero, at once. Always safe to call.
    fn stop(&mut self);

    /// Lets time pass until `until` in which nobody drives the rig: what time does to hardware by itself. Motors that
    /// sound meanwhile fall silent after [`Interlock::LEASE_S`], which is [`RigFault::Stopped`].
    fn pass(&mut self, _until: PlateTime) -> Result<(), RigFault> {
        Ok(())
    }
}
