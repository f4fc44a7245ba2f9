//! Validation of files: raw JSON as a person writes it becomes a spec with all defaults, in SI units.
//!
//! Every fault of a file is reported on one line: file, JSON path, expected value, value found. Keys, types and ranges
//! are checked first; only if they are right are values checked against each other. Files are JSON, up to 1 MiB,
//! without unknown keys.
//!
//! ```
//! use upm_runner::config::{Origin, RigSpec};
//! let faults = RigSpec::from_json(r#"{"nam": "upm-3"}"#, &Origin::of_request("rig.json")).unwrap_err();
//! let line = "rig.json: nam: expected one of accelerometers, camera, drive, fields, friction, kinds, library, \
//!             motors, name, plate, simulation (did you mean name?), found unknown key \"nam\"";
//! assert_eq!(faults[0].to_string(), line);
//! ```

mod bins;
mod campaign_file;
mod clearance;
mod coins;
mod daemon;
mod daemon_file;
mod drawings;
mod faults;
mod fit;
mod in_phase;
mod job;
mod job_file;
mod kinds;
mod layout;
mod names;
mod part_path;
mod paths;
mod placement;
mod planner_checks;
mod read;
mod rig;
mod rig_changes;
mod rig_checks;
mod rig_file;
mod schema;
mod shape_file;
mod simulate;
mod targets;
mod task;
#[cfg(test)]
mod tests;
mod trace;
mod view;

pub use campaign_file::CampaignFile;
pub use clearance::{REST_GAP_M, REST_MARGIN_M, START_GAP_M, START_MARGIN_M};
pub use coins::{coin_set, load_coins};
pub use daemon::{DaemonSpec, PlateSpec, StandingSpec};
pub use daemon_file::{KeepSpec, WatchdogSpec};
pub(crate) use faults::fault_entry;
pub use job::JobSpec;
pub use job_file::{Assignment, DeadlinePolicy, JobFile, LibraryRef, PlannerChoice};
pub use kinds::{KindSpec, PartGroup};
pub use layout::JobLayout;
pub(crate) use placement::free_place;
pub use placement::{PlacedPart, place_parts};
pub(crate) use planner_checks::moving_obstacle;
pub use read::{Origin, is_plain_name};
pub use rig::RigSpec;
pub use rig_file::{FrictionSection, Knocks, RigFile, RigSource, SimulationSection};
pub use schema::{schema, schema_names};
pub use simulate::SimulateSpec;
pub use task::TaskSpec;
pub(crate) use task::{FIELD_SCATTER_M, accuracy_m};
pub use trace::{load_trace, trace_from_json, trace_to_json};
pub use upm_core::document::{
    Diagnostic, DiagnosticClass, Document, MOST_BYTES, Path, TextPosition, listed, nearest, one_of, reason, text_of,
};
