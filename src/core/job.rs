//! Vocabulary of runs that all crates share: outcomes, causes, recordings, pace, layout and the motion of the plate.

mod evidence;
mod finding;
mod stop_cause;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::coded_enum;
use crate::geometry::Vec2;
use crate::units::{mm, mm_point, mm_points};

pub use evidence::{Evidence, RunnerUp};
pub use finding::{Effect, Finding};
pub use stop_cause::{StopCause, StopRequest};

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
    /// Severity of an event.
    #[derive(schemars::JsonSchema)]
    pub enum EventLevel {
        /// The run goes on as it should.
        Info = "info",
        /// Something was corrected.
        Warning = "warning",
        /// The run ends because of it.
        Error = "error",
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

/// Rectangle on the plate for the parts of some kinds, for some parts by name, or both.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[schemars(rename = "BinEntry")]
pub struct Bin {
    /// Kinds that belong here; parts that a bin names belong there.
    #[serde(default)]
    pub kinds: Vec<String>,
    /// Names of parts that belong here, whatever their kind.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub parts: Vec<String>,
    /// The rectangle in which their rims must lie.
    #[serde(rename = "region_mm")]
    pub region: Region,
}

/// A rectangle.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Region {
    /// Lower left corner.
    #[serde(rename = "min", with = "mm_point")]
    #[schemars(with = "[f64; 2]", inner(range(min = -1000.0, max = 1000.0)))]
    pub min_m: Vec2,
    /// Upper right corner.
    #[serde(rename = "max", with = "mm_point")]
    #[schemars(with = "[f64; 2]", inner(range(min = -1000.0, max = 1000.0)))]
    pub max_m: Vec2,
}

/// A part of a job as it is shown, or a kind of part.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct LayoutPart {
    /// Name in its run: its own, or `penny-1`; empty for a kind.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub id: String,
    /// Name of its kind.
    pub kind: String,
    /// Radius of the kind's outline.
    #[serde(rename = "radius_mm", with = "mm")]
    #[schemars(with = "f64")]
    pub radius_m: f64,
}

/// A path that a part shall follow.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct LayoutPath {
    /// The part that follows it, an index into the parts of the job; null for several.
    pub part: Option<usize>,
    /// Its corners.
    #[serde(rename = "waypoints_mm", with = "mm_points")]
    #[schemars(with = "Vec<[f64; 2]>")]
    pub waypoints_m: Vec<Vec2>,
    /// True for a path that leads from the last corner back to the first.
    pub closed: bool,
}

impl LayoutPath {
    /// The path as a line: a closed one ends at its first corner.
    pub fn line_m(&self) -> Vec<Vec2> {
        let back = self.waypoints_m.first().filter(|_| self.closed);
        self.waypoints_m.iter().chain(back).copied().collect()
    }
}
