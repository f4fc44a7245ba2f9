//! A Universal Planar Manipulator: one flat plate, shaken sideways by four voice coils, moves many coins on it
//! independently, closed over a camera. See `ARCHITECTURE.md` for the rooms and who may import whom.

pub mod chart;
pub mod cli;
pub mod config;
pub mod control;
pub mod daemon;
pub mod estimation;
pub mod geometry;
pub mod goal;
pub mod lab;
pub mod library;
pub mod planner;
pub mod plates;
pub mod priority;
pub mod random;
pub mod recording;
pub mod rig;
pub mod run;
pub mod scene;
pub mod service;
pub mod signal;
pub mod sim;
pub mod store;
pub mod time;
pub mod units;
pub mod vision;
