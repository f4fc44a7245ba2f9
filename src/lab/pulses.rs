//! Pulses of rotation about a point, within the limits of a rig's motors.

use std::f64::consts::TAU;

use super::numerics::bisect;
use super::{LabError, LabRig, coulomb_pump};
use upm_core::geometry::{Pose, Vec2, cross};
use upm_core::job::PlateMode;
use upm_core::signal::Envelope;
use upm_core::units::GRAVITY_MPS2;
use upm_sim::{OpenPulse, PartTrajectory, check_pulses, simulate};

/// Samples a second of a series of positions.
pub(super) const SERIES_HZ: f64 = 60.0;
/// Simulation samples for each of these, for counting angles and finding the ends of pulses.
pub(super) const FINER: usize = 16;
/// Clearance between a coin's rim and the plate's edge at the start, m: on a rig's plate coins drift.
pub(super) const EDGE_M: f64 = 10e-3;

/// The rig's pulse with a sustain of `sustain_s`.
pub(super) fn envelope(rig: &LabRig, sustain_s: f64) -> Envelope {
    Envelope { attack_s: rig.model.attack_s, sustain_s, rest_s: rig.model.rest_s }
}

/// The same, on a dynamic plate with flanks of two periods at least. Its motors play the forces of a free mass, which
/// leave a plate on rods swinging after a shorter flank; its swing carries parts off their way.
pub(super) fn calm_envelope(rig: &LabRig, mode: PlateMode, sustain_s: f64) -> Envelope {
    let periods = if mode == PlateMode::Dynamic { 2.0 } else { 0.0 };
    let flank_s = periods * TAU / rig.model.base_radps;
    Envelope { attack_s: rig.model.attack_s.max(flank_s), ..envelope(rig, sustain_s) }
}

/// The largest amplitude of spin about `cor_m` within the limits of the rig's motors, rad/s, by bisection.
pub(super) fn strongest_spin(rig: &LabRig, cor_m: Vec2) -> Result<f64, LabError> {
    const DOUBLINGS: usize = 40;
    const HALVINGS: usize = 60;
    let check = |spin_radps: f64| {
        let pulse = OpenPulse::about(cor_m, spin_radps, envelope(rig, 0.0));
        check_pulses(&rig.sim, PlateMode::Dynamic, &[pulse], rig.model.base_radps)
    };
    check(0.0).map_err(LabError::Rig)?;
    let refused = |spin_radps: f64| check(spin_radps).is_err();
    let mut doubled = std::iter::successors(Some(1.0), |spin_radps| Some(2.0 * spin_radps)).take(DOUBLINGS);
    let highest = doubled.find(|&spin_radps| refused(spin_radps)).unwrap_or(f64::INFINITY);
    Ok(bisect([0.0, highest], HALVINGS, refused)[0])
}

/// Rejects a plate that does not carry a part forwards at `radius_m` from its centre of rotation.
pub(super) fn check_carries(rig: &LabRig, spin_radps: f64, radius_m: f64) -> Result<(), LabError> {
    let shaken = spin_radps * radius_m * rig.model.base_radps;
    let needed = coulomb_pump::CARRIED_FROM * rig.penny.friction * GRAVITY_MPS2;
    if shaken > needed {
        return Ok(());
    }
    Err(LabError::Rig(format!(
        "parts stick or creep backwards {:.0} mm from the centre of rotation: expected an acceleration A w above \
         {needed:.2} m/s² there, found {shaken:.2}",
        1e3 * radius_m
    )))
}

/// Positions of parts over time, from the start on.
pub(super) struct Played {
    pub t_s: Vec<f64>,
    pub ways_m: Vec<Vec<Vec2>>,
}

impl Played {
    /// Where part `i` comes to rest.
    pub fn end_m(&self, i: usize) -> Vec2 {
        self.ways_m.get(i).and_then(|way_m| way_m.last()).copied().unwrap_or(Vec2::repeat(f64::NAN))
    }
}

/// Plays `pulses` on this rig's coins at `parts_m`, with `sample_hz` positions a second.
pub(super) fn play(
    rig: &LabRig,
    mode: PlateMode,
    parts_m: &[Vec2],
    pulses: &[OpenPulse],
    sample_hz: f64,
) -> Result<Played, LabError> {
    let parts: Vec<_> = parts_m.iter().map(|&at| (rig.penny, Pose { position_m: at, heading_rad: 0.0 })).collect();
    let played = simulate(&rig.sim, mode, &parts, pulses, rig.model.base_radps, sample_hz).map_err(LabError::Rig)?;
    let way = |part: &PartTrajectory| part.x_m.iter().zip(&part.y_m).map(|(&x, &y)| Vec2::new(x, y)).collect();
    Ok(Played { ways_m: played.parts.iter().map(way).collect(), t_s: played.t_s })
}

/// Rotation from `from_m` to `to_m` about `cor_m`: angle, rad, counter-clockwise, and length of the arc, m.
pub(super) fn turn(cor_m: Vec2, from_m: Vec2, to_m: Vec2) -> (f64, f64) {
    let (from, to) = (from_m - cor_m, to_m - cor_m);
    let angle = cross(from, to).atan2(from.dot(&to));
    (angle, angle * 0.5 * (from.norm() + to.norm()))
}

/// The speed a pulse gives to a part by the S² law, f0 μ g (S + 2 attacks), over the belt's speed A/2 at `radius_m`.
/// Displacement is the same everywhere while this is far below 1; above it the plate carries parts along like a belt.
pub(super) fn saturation(rig: &LabRig, spin_radps: f64, radius_m: f64, envelope: &Envelope) -> f64 {
    let gained_mps = coulomb_pump::mean_force(0.0) * rig.penny.friction * GRAVITY_MPS2 * envelope.driven_s();
    gained_mps / (coulomb_pump::BELT * spin_radps * radius_m)
}

/// Position in millimetres, for maps.
pub(super) fn mm(place_m: Vec2) -> [f64; 2] {
    [1e3 * place_m.x, 1e3 * place_m.y]
}

#[cfg(test)]
mod tests {
    use super::super::testing::lab_rig;
    use super::*;

    #[test]
    fn the_strongest_spin_is_just_within_the_motors() {
        for name in ["upm-1", "upm-2"] {
            let rig = lab_rig(name);
            let cor = Vec2::new(-0.5, -0.5) * rig.sim.plate.side_m;
            let spin = strongest_spin(&rig, cor).unwrap();
            let plays = |spin| {
                let pulse = OpenPulse::about(cor, spin, envelope(&rig, 0.0));
                check_pulses(&rig.sim, PlateMode::Dynamic, &[pulse], rig.model.base_radps).is_ok()
            };
            assert!(spin > 0.0 && plays(spin) && !plays(1.001 * spin), "{name}: {spin}");
        }
    }
}
