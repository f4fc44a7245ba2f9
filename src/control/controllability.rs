//! Whether rotations can move the parts of a job independently where they are first seen.

use std::ops::ControlFlow::{Break, Continue};

use super::ending::{Ending, Flow};
use upm_core::geometry::Vec2;
use upm_core::job::StopCause;
use upm_goal::Wanted;
use upm_library::Library;
use upm_planner::{Independence, Method};

/// Least share of the best joint motion of all parts with which the hardest one must be made. The shipped jobs by rotations
/// have 5e-4 (24 coins) or more; a library that lacks a direction, or has too few centres for the parts, has less than 1e-6.
const LEAST_SHARE: f64 = 1e-4;

/// An ending where `method` plays rotations, a part is to be moved, and the library cannot move the parts at `seen_m`
/// independently. It names the part that goes farthest in the hardest joint motion, its direction there and the bound.
pub(super) fn check_controllable<'a>(
    method: Method,
    library: &Library,
    seen_m: &[Vec2],
    wanted: &Wanted,
    id: impl Fn(usize) -> &'a str,
) -> Flow {
    let by_rotations = match method {
        Method::CorSequence | Method::PseudoInverse => true,
        Method::SynthesizedField => false,
    };
    if !by_rotations || wanted.subgoals_m == seen_m {
        return Continue(());
    }
    let independence = Independence::of_rotations(library, seen_m);
    let (share, Some((part, direction))) = (independence.share(), independence.weakest) else { return Continue(()) };
    if share >= LEAST_SHARE {
        return Continue(());
    }
    let direction_deg = direction.y.atan2(direction.x).to_degrees().rem_euclid(180.0);
    let part = id(part);
    let reason = format!(
        "rotations cannot move the parts independently: {part} towards {direction_deg:.0} deg with {share:.1e} of the best \
         joint motion, at least {LEAST_SHARE:.0e} is needed; calibrate again, take another planner or move fewer parts"
    );
    Break(Ending::failed_because(StopCause::Uncontrollable, reason))
}
