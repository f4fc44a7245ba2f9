//! One resonator: a torsional oscillator under spring, damper and a torque that is constant over a step. Steps are
//! exact.

/// Mechanics of a resonator about its rods.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Rotor {
    pub inertia_kgm2: f64,
    pub stiffness_nm: f64,
    pub damping_nms: f64,
}

/// Angle and angular speed of a resonator; positive angles raise the ridge.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Swing {
    pub angle_rad: f64,
    pub speed_radps: f64,
}

/// The map over one step of the deviation from the equilibrium angle under the torque: `exp(A h)` of the oscillator.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ExactStep {
    stiffness_nm: f64,
    map: [[f64; 2]; 2],
}

impl Rotor {
    pub fn exact_step(&self, step_s: f64) -> ExactStep {
        let square = self.stiffness_nm / self.inertia_kgm2;
        let decay = 0.5 * self.damping_nms / self.inertia_kgm2;
        // sine and cosine of the damped oscillation; hyperbolic ones beyond critical damping
        let discriminant = square - decay * decay;
        let root = discriminant.abs().sqrt();
        let (cosine, sine_over) = match (discriminant > 0.0, root * step_s < 1e-9) {
            (_, true) => (1.0, step_s),
            (true, _) => ((root * step_s).cos(), (root * step_s).sin() / root),
            (false, _) => ((root * step_s).cosh(), (root * step_s).sinh() / root),
        };
        let fade = (-decay * step_s).exp();
        let map = [
            [fade * (cosine + decay * sine_over), fade * sine_over],
            [-fade * square * sine_over, fade * (cosine - decay * sine_over)],
        ];
        ExactStep { stiffness_nm: self.stiffness_nm, map }
    }

    /// Kinetic energy plus that of the spring, J.
    #[cfg(test)]
    pub fn energy_j(&self, swing: &Swing) -> f64 {
        0.5 * (self.inertia_kgm2 * swing.speed_radps.powi(2) + self.stiffness_nm * swing.angle_rad.powi(2))
    }
}

impl ExactStep {
    /// `swing` a step later under `torque_nm`.
    pub fn after(&self, swing: &Swing, torque_nm: f64) -> Swing {
        let held_rad = torque_nm / self.stiffness_nm;
        let away_rad = swing.angle_rad - held_rad;
        let [[aa, ab], [ba, bb]] = self.map;
        Swing {
            angle_rad: held_rad + aa * away_rad + ab * swing.speed_radps,
            speed_radps: ba * away_rad + bb * swing.speed_radps,
        }
    }
}

/// Steps of a drive cycle of [`free_swing`].
const CYCLE_STEPS: usize = 1_000;
/// Cycles after which the free oscillation is periodic.
const SETTLING_CYCLES: usize = 200;

/// Least and largest angle of the settled free oscillation under a square wave of torque, rad.
pub fn free_swing(rotor: &Rotor, torque_nm: f64, drive_hz: f64, duty: f64) -> [f64; 2] {
    let step = rotor.exact_step(1.0 / (drive_hz * CYCLE_STEPS as f64));
    let on = (duty * CYCLE_STEPS as f64).round() as usize;
    let (mut swing, mut ends) = (Swing::default(), [0.0; 2]);
    for _ in 0..SETTLING_CYCLES {
        ends = [f64::INFINITY, f64::NEG_INFINITY];
        for i in 0..CYCLE_STEPS {
            ends = [ends[0].min(swing.angle_rad), ends[1].max(swing.angle_rad)];
            swing = step.after(&swing, if i < on { torque_nm } else { 0.0 });
        }
    }
    ends
}

#[cfg(test)]
mod tests {
    use super::super::device::Device;
    use super::*;

    #[test]
    fn free_oscillation_is_positive_up_to_five_degrees() {
        let device = Device::published();
        let [least, most] = free_swing(&device.rotor(), device.torque_nm(), device.drive_hz, 0.5);
        assert!((most - 0.08).abs() < 1e-9, "{most}");
        assert!(least.abs() < 0.06 * most, "{least}");
    }
}
