//! Execution of whole runs: [`config`] turns files into validated specs; [`run`] combines rig, control and sinks and
//! writes a run folder.

pub mod config;
pub mod run;
