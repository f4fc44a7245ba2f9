//! Execution of whole runs: [`config`] turns files into validated specs; [`run`] combines rig, control and sinks and
//! writes a run folder; [`campaign`] makes many of them; [`episode`] has plates that learners step.

#![cfg_attr(test, allow(clippy::disallowed_methods))]

pub mod campaign;
pub mod config;
pub mod episode;
pub mod run;
