//! The papers' algorithm on the ideal field (UPM paper, section 2.1): parts flow along
//! `τ_j(p) = (p - C_j)^⊥ / |p - C_j|` by d_j, one centre after another.

use nalgebra::{Matrix4, Vector4};

use super::super::LabError;
use super::super::pulses::mm;
use upm_core::geometry::{Vec2, perp};

/// Parts, N.
pub const PARTS: usize = 2;
/// Centres of rotation, M = 2N.
pub const CENTERS: usize = 4;
/// Condition number of Φ beyond which the four fields count as dependent.
const SINGULAR: f64 = 1e6;

/// Positions of all parts, m, table frame.
pub type PartPositions = [Vec2; PARTS];

/// Φ of Eq. 2, 4×4: column j is τ_j at part 1 (x, y), then at part 2.
pub fn field_matrix(centers_m: &[Vec2; CENTERS], parts_m: &PartPositions) -> Matrix4<f64> {
    Matrix4::from_fn(|row, column| direction(centers_m[column], parts_m[row / 2])[row % 2])
}

/// Ratio of the largest to the smallest singular value of Φ.
pub fn condition(phi: &Matrix4<f64>) -> f64 {
    let values = phi.singular_values();
    values.max() / values.min()
}

/// The distances d (m) with `Φ d = ΔP` that move the parts from `parts_m` to `goals_m`.
///
/// # Errors
///
/// Fields that are dependent there.
pub fn distances(
    centers_m: &[Vec2; CENTERS],
    parts_m: &PartPositions,
    goals_m: &PartPositions,
) -> Result<[f64; CENTERS], LabError> {
    let phi = field_matrix(centers_m, parts_m);
    let condition = condition(&phi);
    let step = Vector4::from_fn(|row, _| (goals_m[row / 2] - parts_m[row / 2])[row % 2]);
    let solved = if condition <= SINGULAR { phi.lu().solve(&step) } else { None };
    solved.map(Into::into).ok_or_else(|| {
        let [[ax, ay], [bx, by]] = parts_m.map(mm);
        LabError::Rig(format!(
            "fields dependent at ({ax:.0}, {ay:.0}), ({bx:.0}, {by:.0}) mm: condition number {condition:.0e}"
        ))
    })
}

/// Position of a part after it flows by `distance_m` about `center_m`: along the circle, exactly.
pub fn flow(center_m: Vec2, part_m: Vec2, distance_m: f64) -> Vec2 {
    let arm = part_m - center_m;
    let radius = arm.norm();
    if radius == 0.0 {
        return part_m;
    }
    let (sin, cos) = (distance_m / radius).sin_cos();
    center_m + arm * cos + perp(arm) * sin
}

fn direction(center_m: Vec2, part_m: Vec2) -> Vec2 {
    let arm = perp(part_m - center_m);
    let radius = arm.norm();
    if radius > 0.0 { arm / radius } else { Vec2::zeros() }
}

/// `E = (1/N) Σ |P'_i - P*_i|`, m.
pub fn mean_miss(parts_m: &PartPositions, goals_m: &PartPositions) -> f64 {
    parts_m.iter().zip(goals_m).map(|(part, goal)| (part - goal).norm()).sum::<f64>() / PARTS as f64
}

#[cfg(test)]
pub mod tests {
    use super::*;
    use proptest::prelude::*;

    /// The end of [`flow`] by integrating `dp/ds = τ(p)` in fine steps (fourth-order Runge-Kutta).
    pub fn flow_in_steps(center_m: Vec2, part_m: Vec2, distance_m: f64) -> Vec2 {
        const STEPS: u32 = 200;
        let h = distance_m / f64::from(STEPS);
        (0..STEPS).fold(part_m, |p, _| {
            let k1 = direction(center_m, p);
            let k2 = direction(center_m, p + k1 * (0.5 * h));
            let k3 = direction(center_m, p + k2 * (0.5 * h));
            let k4 = direction(center_m, p + k3 * h);
            p + (k1 + (k2 + k3) * 2.0 + k4) * (h / 6.0)
        })
    }

    const SQUARE: [Vec2; CENTERS] =
        [Vec2::new(-1.0, 1.0), Vec2::new(-1.0, -1.0), Vec2::new(1.0, -1.0), Vec2::new(1.0, 1.0)];

    proptest! {
        #[test]
        fn a_small_step_reaches_its_goals_to_first_order(
            x in -0.6..0.0f64, y in -0.6..0.0f64, u in 0.1..0.6f64, v in 0.1..0.5f64,
            step in prop::array::uniform4(-1.0..1.0f64),
        ) {
            let (scale, parts) = (1e-4, [Vec2::new(x, y), Vec2::new(u, v)]);
            let goals = [parts[0] + Vec2::new(step[0], step[1]) * scale, parts[1] + Vec2::new(step[2], step[3]) * scale];
            prop_assume!(condition(&field_matrix(&SQUARE, &parts)) < 30.0);
            let d = distances(&SQUARE, &parts, &goals).unwrap();
            let end = parts.map(|part| SQUARE.iter().zip(d).fold(part, |p, (center, d)| flow(*center, p, d)));
            prop_assert!(mean_miss(&end, &goals) < 0.1 * scale);
        }
    }
}
