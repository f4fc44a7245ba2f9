use std::fmt;

use super::super::ending::Ending;
use upm_core::job::Outcome;
use upm_core::rig::RigFault;
use upm_core::signal::{CHANNEL_NAMES, Motor};
use upm_core::units::GRAVITY_MPS2;
use upm_perception::estimation::FitFault;

/// Velocity lags force by 90° on a free mass, by nothing at resonance; an axis nearer to that than this is refused.
pub(super) const LEAST_LAG_DEG: f64 = 45.0;

/// A part of the rig that calibration can tell from the others.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Component {
    /// A voice coil, with its amplifier and cable.
    Coil(Motor),
    /// A channel of the accelerometers, index into [`CHANNEL_NAMES`].
    Channel(usize),
    /// An axis of the plate, where no single coil explains it.
    Axis(&'static str),
}

impl fmt::Display for Component {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Coil(coil) => write!(f, "coil {coil:?}"),
            Self::Channel(channel) => {
                write!(f, "accelerometer channel {}", CHANNEL_NAMES.get(*channel).unwrap_or(&"?"))
            }
            Self::Axis(name) => f.write_str(name),
        }
    }
}

/// What is wrong with a coil. Gains are multiples of the rig file's.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum CoilFault {
    /// It gives no force.
    #[error("found {gain:.2} of its nominal force, allowed: 0.7 to 1.3 (dead: check its cable, fuse and amplifier)")]
    Dead {
        /// Its gain.
        gain: f64,
    },
    /// It pulls where it should push.
    #[error("found {gain:.2} of its nominal force, allowed: 0.7 to 1.3 (reversed: exchange its two wires)")]
    Reversed {
        /// Its gain, negative.
        gain: f64,
    },
    /// It plays what another coil is told to play, and the other way round.
    #[error(
        "found it exchanged with coil {other:?}, allowed: each coil on its own amplifier (check the plugs of both)"
    )]
    Swapped {
        /// The other coil.
        other: Motor,
    },
    /// Too weak or too strong for its data sheet.
    #[error(
        "found {gain:.2} of its nominal force, allowed: 0.7 to 1.3 (check its amplifier, and mass, inertia and \
         newtons_per_count in the rig file)"
    )]
    Gain {
        /// Its gain.
        gain: f64,
    },
    /// Too weak or too strong for one of four alike.
    #[error(
        "found {ratio:.2} times the mean force of the four coils, allowed: 0.85 to 1.15 (check this coil and its \
         amplifier)"
    )]
    Unlike {
        /// Its gain as a multiple of the mean.
        ratio: f64,
    },
}

/// What is wrong with an accelerometer channel. Gains are multiples of the channels' median.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum ChannelFault {
    /// It shows nothing.
    #[error("found {share:.2} of what the strongest channel shows, allowed: 0.1 or more (dead: check its cable)")]
    Dead {
        /// Its root mean square as a part of the strongest channel's.
        share: f64,
    },
    /// Its sign is reversed.
    #[error("found a gain of {gain:.2} against the others, allowed: 0.8 to 1.25 (reversed: check how it is mounted)")]
    Reversed {
        /// Its gain, negative.
        gain: f64,
    },
    /// Its gain is not that of the others.
    #[error("found a gain of {gain:.2} against the others, allowed: 0.8 to 1.25 (check its sensor and its range)")]
    Gain {
        /// Its gain.
        gain: f64,
    },
}

/// Why there is no library.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum CalibrationFault {
    /// The rig refused or failed.
    #[error("rig: {0}")]
    Rig(#[from] RigFault),
    /// Table or coins were not found.
    #[error("{0}")]
    Look(String),
    /// A trace could not be read.
    #[error("{what}: {fault}")]
    Trace {
        /// What was played.
        what: String,
        /// Why it could not be read.
        fault: FitFault,
    },
    /// A coil does not do what the rig file says.
    #[error("{}: {fault}", Component::Coil(*coil))]
    Coil {
        /// Which.
        coil: Motor,
        /// What is wrong with it.
        fault: CoilFault,
    },
    /// An accelerometer channel does not show what the others do.
    #[error("{}: {fault}", Component::Channel(*channel))]
    Channel {
        /// Index into [`CHANNEL_NAMES`].
        channel: usize,
        /// What is wrong with it.
        fault: ChannelFault,
    },
    /// The four channels do not show the motion of one rigid plate.
    #[error(
        "accelerometers: found {misfit:.2} of their readings not those of a rigid plate, allowed: 0.05 or less (check \
         their mounting, their channels' order and `position_mm` in the rig file)"
    )]
    NotRigid {
        /// Part of the readings, root mean square, that no gains explain.
        misfit: f64,
    },
    /// A drive of one axis does not move the plate.
    #[error(
        "{axis}: found {found_mps2:.2} m/s² in its strongest pulse, allowed: {needed_mps2:.2} m/s² or more (check \
         power, emergency stop and the cables of its coils)"
    )]
    Still {
        /// Which.
        axis: &'static str,
        /// Largest acceleration, m/s².
        found_mps2: f64,
        /// What can be read, m/s².
        needed_mps2: f64,
    },
    /// The plate answers as no four coils of any gains would make it.
    #[error(
        "motors: found {misfit:.2} of the plate's answer not that of four coils, allowed: 0.25 or less (check the \
         coils' order and mounting, and mass, inertia and `lever_arm_mm` in the rig file)"
    )]
    Coupled {
        /// Part of the answer, root mean square, that no gains of the coils explain.
        misfit: f64,
    },
    /// The closing pulse is not the opening one: a coil or a channel changed while the rig was calibrated.
    #[error(
        "{component}: found the closing pulse {:.1} % off the opening one, allowed: {:.1} % (it changed while the rig \
         was calibrated: check it, and calibrate again)",
        100.0 * change,
        100.0 * allowed
    )]
    Changed {
        /// What changed.
        component: Component,
        /// By which part of what it did at first.
        change: f64,
        /// Largest change that is accepted.
        allowed: f64,
    },
    /// The same pulse carries parts another way at the end of their measurement than at its start.
    #[error(
        "camera: found steps of {closing_mm:.2} mm in closing pulses that were {opening_mm:.2} mm in the opening ones, \
         allowed: {allowed_mm:.2} mm of difference (check camera, plate and coins, and calibrate again)"
    )]
    StepChanged {
        /// Mean step of the coins at the start, mm.
        opening_mm: f64,
        /// Mean step at the end, mm.
        closing_mm: f64,
        /// Largest difference that is accepted, mm.
        allowed_mm: f64,
    },
    /// The three axes do not move the plate independently.
    #[error("motors do not move x, y and spin independently (gain matrix is singular)")]
    Singular,
    /// The drive is too weak to slide a coin.
    #[error(
        "found a displacement of {moved_mm:.3} mm in the strongest pulse, at {peak_mps2:.2} m/s² of the plate, allowed: \
         {needed_mm} mm or more (parts are carried from a peak of about 2.2 times their friction coefficient times \
         {GRAVITY_MPS2} m/s² on; below it they stick or creep backwards)"
    )]
    TooWeak {
        /// Largest displacement seen, mm.
        moved_mm: f64,
        /// What counts as a displacement, mm.
        needed_mm: f64,
        /// Largest acceleration of the plate in that pulse, m/s².
        peak_mps2: f64,
    },
    /// An axis answers ahead of what a mass would: its resonance is not below the drive's frequency.
    #[error(
        "{axis}: found a velocity {lag_deg:.0}° behind the force at {base_hz:.1} Hz, allowed: {LEAST_LAG_DEG}° or more (the \
         resonance must lie below the drive's frequency, where velocity is the force's integral, 90° behind it)"
    )]
    Resonance {
        /// Which.
        axis: &'static str,
        /// By how much velocity lags force at the base frequency, degrees.
        lag_deg: f64,
        /// The drive's base frequency, Hz.
        base_hz: f64,
    },
    /// Stopped from outside.
    #[error("stopped from outside, motors at zero")]
    Stopped,
}

impl From<Ending> for CalibrationFault {
    fn from(ending: Ending) -> Self {
        match ending.outcome {
            Outcome::Cancelled => Self::Stopped,
            Outcome::Completed | Outcome::Failed => Self::Look(ending.reason),
        }
    }
}
