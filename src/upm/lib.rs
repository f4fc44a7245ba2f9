//! A Universal Planar Manipulator as a library: one flat plate, shaken sideways by four voice coils, moves many coins
//! on it independently, while a camera closes the loop.
//!
//! The crate finds table and coins in pictures, measures what a plate can do, plans motions that move every coin along
//! its own path, and runs whole jobs closed loop on a simulated rig. Add your own task or rig as a type that implements
//! [`task::Task`] or [`rig::Rig`]. Time and random numbers are passed in: equal jobs, seeds and builds give
//! bit-identical results.
//!
//! | purpose | module and first item |
//! |---|---|
//! | read and check jobs, rigs and other files | [`config`]: `JobSpec::load`, `RigSpec::load` |
//! | run, dry-run and verify jobs, calibrate rigs | [`run`]: `InMemoryRun`, `run`, `dry_run`, `verify`, `calibrate` |
//! | find the table and the coins in a picture, follow them | [`vision`]: `locate_table`, `CoinFinder`, `Tracker` |
//! | read the plate's motion from its accelerometers | [`estimation`]: `fit_twist`, `fit_wave` |
//! | plan motions for many parts | [`planner`]: `FieldPlanner`, `RotationPlanner` |
//! | look up what a plate was measured to do | [`cor_library`]: `Library` |
//! | say where parts should go | [`task`]: the trait `Task`, and the tasks of job files |
//! | step plates for learning | [`episode`]: `EpisodeParams`, `Episode`, `Episodes` |
//! | close the loop over any rig | [`control`]: `run`, the trait `Sink` |
//! | stand in for a rig | [`rig`]: the trait `Rig`; [`sim`]: `SimRig`; [`ground_truth`]: `GroundTruthHandle` |
//! | keep a run | [`recording`]: `Journal`, `RunStats`, `Report`; [`viewer`]: recordings for Rerun |
//! | draw charts | [`chart`]: `Chart`, `svg` |
//! | serve plates over HTTP | `daemon`, `api`, with the feature `daemon` |
//! | speak of space, time and signals | [`geometry`], [`units`], [`time`], [`signal`], [`random`], [`job`] |
//!
//! A job in memory, from its text to its report:
//!
//! ```
//! use std::path::Path;
//!
//! use upm::config::{JobSpec, Origin};
//! use upm::job::Outcome;
//! use upm::run::{InMemoryRun, RunError};
//!
//! # fn main() -> Result<(), RunError> {
//! let text = r#"{
//!     "name": "nudge",
//!     "rig": "rigs/upm-2.json",
//!     "parts": [{"kind": "penny", "position_mm": [0, 0]}],
//!     "task": {"type": "arrange", "targets_mm": [[6, 3]]}
//! }"#;
//! // files that a job names are looked for beside it
//! let job = JobSpec::from_json(text, &Origin::of_file(Path::new("configs/nudge.json")), None)?;
//! let report = InMemoryRun::new(&job)?.run();
//! assert_eq!(report.outcome, Outcome::Completed);
//! assert!(report.accuracy.max_error_mm < Some(0.6), "{:?}", report.accuracy.max_error_mm);
//! # Ok(())
//! # }
//! ```
//!
//! `docs/library.md` explains the programs in `examples/`. `ARCHITECTURE.md` says which crate and room of the code does
//! what.

pub mod cli;

pub use upm_chart as chart;
pub use upm_control as control;
pub use upm_core::{geometry, ground_truth, job, random, rig, signal, thread_priority, time, units};
pub use upm_perception::{estimation, vision};
pub use upm_planning::cor_library;
pub use upm_planning::planner;
pub use upm_planning::task;
pub use upm_recording as recording;
pub use upm_runner::{config, episode, run};
#[cfg(feature = "daemon")]
pub use upm_server::{api, daemon, http, states};
pub use upm_sim as sim;
pub use upm_viewer as viewer;
