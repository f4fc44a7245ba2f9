//! Whole runs: [`config`] turns files into validated specs, [`run`] composes rig, control and sinks, and leaves a run folder.

pub mod config;
pub mod run;
