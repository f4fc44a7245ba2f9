use std::sync::atomic::AtomicBool;

use super::{OwnPlanner, Sink};
use upm_core::rig::{Rig, RigModel};
use upm_core::time::Clock;

/// The devices and flags that a run or a calibration works with.
pub struct RunIo<'a> {
    /// The plate.
    pub rig: &'a mut dyn Rig,
    /// The rig's nominal figures.
    pub model: &'a RigModel,
    /// Receives the facts.
    pub sink: &'a mut dyn Sink,
    /// Wall clock, for timings only.
    pub clock: &'a dyn Clock,
    /// Flag set from outside to stop the run at once.
    pub stop: &'a AtomicBool,
    /// Flag set from outside to end the run between two cycles.
    pub give_way: &'a AtomicBool,
    /// The caller's planner, in the place of the run's own.
    pub planner: Option<Box<dyn OwnPlanner>>,
}
