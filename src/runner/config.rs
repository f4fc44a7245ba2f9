//! Validation of files: raw JSON as a person writes it becomes a spec with all defaults, in SI units.
//!
//! Every fault of a file is reported on one line: file, JSON path, expected value, value found. Keys, types and ranges
//! are checked first; only if they are right are values checked against each other. Files are JSON, up to 1 MiB,
//! without unknown keys. Serde types stay in this room.
//!
//! ```
//! use upm_runner::config::{Origin, RigSpec};
//! let faults = RigSpec::from_json(r#"{"nam": "upm-3"}"#, &Origin::of_request("rig.json")).unwrap_err();
//! let line = "rig.json: nam: expected one of accelerometers, camera, drive, fields, friction, kinds, library, \
//!             motors, name, plate, simulation (did you mean name?), found unknown key \"nam\"";
//! assert_eq!(faults[0].to_string(), line);
//! ```

mod bins;
mod clearance;
mod corridor;
mod daemon;
mod drawings;
mod faults;
mod fit;
mod in_phase;
mod job;
mod kinds;
mod layout;
mod part_path;
mod paths;
mod placement;
mod raw_daemon;
mod raw_job;
mod raw_rig;
mod raw_shapes;
mod raw_simulate;
mod raw_simulation;
mod raw_trace;
mod read;
mod rig;
mod rig_checks;
mod schema;
mod simulate;
mod targets;
mod task;
#[cfg(test)]
mod tests;
mod trace;
mod view;

pub use clearance::{REST_GAP_M, REST_MARGIN_M, START_GAP_M, START_MARGIN_M};
pub use daemon::{DaemonSpec, KeepSpec, PlateSpec, StandingSpec, WatchdogSpec};
pub use faults::{DrawnFaults, RawFault, RawFaults, RawValue};
pub use job::{JobSpec, LibraryRef};
pub use kinds::{KindSpec, PartGroup};
pub use layout::{JobLayout, LayoutPart, LayoutPath};
pub use placement::{PlacedPart, place_parts};
pub use raw_daemon::{RawDaemon, RawDisk, RawKeep, RawLive, RawServedPlate, RawStandingJob, RawStart, RawWatchdog};
pub use raw_job::{
    Assignment, DeadlinePolicy, LibrarySource, PlannerChoice, RawBin, RawJob, RawLimits, RawParts, RawPath, RawRegion,
    RawTask,
};
pub use raw_rig::{
    RawAccelerometers, RawCamera, RawDamping, RawDrive, RawFields, RawFriction, RawKind, RawLevels, RawMotors,
    RawPlate, RawResonance, RawRig, RigSource,
};
pub use raw_shapes::{RawCircle, RawGrid, RawLine, RawLissajous, RawSvg, RawTargets, RawText};
pub use raw_simulate::{RawHarmonic, RawPlaced, RawPulse, RawSimulate};
pub use raw_simulation::{RawKnocks, RawSimulation};
pub use raw_trace::{RawCounts, RawTrace};
pub use read::{Origin, is_plain_name};
pub use rig::{RigSpec, fingerprint};
pub use schema::{schema, schema_names};
pub use simulate::SimulateSpec;
pub use task::TaskSpec;
pub use trace::{load_trace, trace_from_json, trace_to_json};
pub use upm_document::{
    Diagnostic, DiagnosticClass, Document, MOST_BYTES, Path, TextPosition, listed, nearest, one_of, reason, text_of,
};
