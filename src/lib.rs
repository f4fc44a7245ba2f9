//! A Universal Planar Manipulator: one flat plate, shaken sideways by four voice coils, moves many coins on it
//! independently, closed over a camera. See `ARCHITECTURE.md` for the crates and who may import whom.

pub mod cli;

pub use upm_chart as chart;
pub use upm_control as control;
pub use upm_core::{geometry, ground_truth, priority, random, rig, signal, time, units};
pub use upm_goal as goal;
#[cfg(feature = "lab")]
pub use upm_lab as lab;
pub use upm_library as library;
pub use upm_perception::{estimation, vision};
pub use upm_planner as planner;
pub use upm_recording as recording;
pub use upm_runner::{config, run};
#[cfg(feature = "lab")]
pub use upm_scene as scene;
#[cfg(feature = "daemon")]
pub use upm_server::{daemon, plates, service};
pub use upm_sim as sim;
pub use upm_viewer as viewer;
