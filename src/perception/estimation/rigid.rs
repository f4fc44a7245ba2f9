//! The plate's twist from two opposite corners (UPM paper, App. B).
//!
//! With `r2 = -r1` a rigid plate has `v1 = V + ω r1^⊥` and `v2 = V - ω r1^⊥`, so `V = (v1 + v2)/2` and
//! `ω = (v1 - v2)·r1^⊥ / (2|r1|²)`. The centre of rotation follows from Eq. 6. Both are linear: they hold for each
//! harmonic coefficient by itself. The centripetal part of the accelerations, `-ω² r` at each corner, drops out of
//! both: it cancels in the sum, and in the difference it is at right angles to `r1^⊥`.

use upm_core::geometry::{Twist, Vec2, perp};

/// The twist of a plate whose opposite corners `r1_m` and `-r1_m` move at `v1_mps` and `v2_mps`. NaN when `r1_m` is
/// zero.
pub fn twist_from_corners(v1_mps: Vec2, v2_mps: Vec2, r1_m: Vec2) -> Twist {
    Twist {
        velocity_mps: 0.5 * (v1_mps + v2_mps),
        spin_radps: (v1_mps - v2_mps).dot(&perp(r1_m)) / (2.0 * r1_m.norm_squared()),
    }
}
