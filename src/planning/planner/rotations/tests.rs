mod closed_loop;
mod forecast;
mod near_center;
mod planner;
mod qp;

use std::sync::{Arc, LazyLock};

use super::RotationPlanner;
use super::motion_set::MotionSet;
use crate::planner::fixture::{library, params};

/// A planner for the fixture's library; the belt table is computed once.
fn planner() -> RotationPlanner {
    static MADE: LazyLock<RotationPlanner> = LazyLock::new(|| RotationPlanner::new(library(), params()));
    MADE.clone()
}

fn motion_set() -> Arc<MotionSet> {
    planner().motion_set
}
