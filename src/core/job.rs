//! Vocabulary of runs that all crates share: outcomes, causes, recordings, pace, bins and the motion of the plate.

mod stop_cause;

use crate::coded_enum;
use crate::geometry::Vec2;

pub use stop_cause::StopCause;

coded_enum! {
    /// How a run ended. A lost coin or a missing table is an outcome, not an error.
    #[derive(Default, schemars::JsonSchema)]
    pub enum Outcome {
        /// The goal was reached.
        Completed = "completed",
        /// It cannot be reached any more, or not in time; or the run never began.
        #[default]
        Failed = "failed",
        /// An operator, a client or the end of the program stopped it.
        Cancelled = "cancelled",
    }
}

coded_enum! {
    /// How a recording ended that does not hold its whole run.
    #[derive(schemars::JsonSchema)]
    pub enum RecordingEnd {
        /// Something could not be recorded.
        RecordingFailed = "recording_failed",
    }
}

coded_enum! {
    /// How fast plate time passes.
    #[derive(Default, schemars::JsonSchema)]
    pub enum Pace {
        /// Plate time is wall time.
        #[default]
        RealTime = "real-time",
        /// As fast as the machine can.
        Max = "max",
    }
}

coded_enum! {
    /// Form in which the simulated camera delivers.
    #[derive(Default, schemars::JsonSchema)]
    pub enum CameraMode {
        /// Rendered pictures.
        #[default]
        Pixels = "pixels",
        /// Positions of plate and parts with the noise of a measurement in pictures; nothing is rendered.
        Positions = "positions",
    }
}

coded_enum! {
    /// How the plate moves.
    #[derive(Default, schemars::JsonSchema)]
    pub enum PlateMode {
        /// Driven by its motors: mass, springs, gains and all.
        #[default]
        Dynamic = "dynamic",
        /// Exactly as the pulse says: `env(t)` times its wave.
        Kinematic = "kinematic",
    }
}

/// A rectangle on the table into which parts of some kinds are sorted, rims included.
#[derive(Clone, Debug, PartialEq)]
pub struct Bin {
    /// Names of the kinds.
    pub kinds: Vec<String>,
    /// Lower left corner, m.
    pub min_m: Vec2,
    /// Upper right corner, m.
    pub max_m: Vec2,
}
