//! Driven oscillator `q̈ + 2ζw0 q̇ + w0² q = u`, stepped without error for u constant over a step (zero-order hold).
//! The same formula serves the plate's axes (Eq. 33) and the amplifiers' low-pass.

/// Position and velocity of an oscillator.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct ModeState {
    pub position: f64,
    pub velocity: f64,
}

/// Exact step of one oscillator.
#[derive(Clone, Copy, Debug)]
pub(super) struct Oscillator {
    stiffness: f64,
    damping: f64,
    position_from: [f64; 3],
    velocity_from: [f64; 3],
}

impl Oscillator {
    /// From the undamped natural frequency w0 (rad/s; zero for a free mass), the damping ratio ζ (any, 1 and more
    /// included) and the step, s.
    pub fn new(natural_radps: f64, damping_ratio: f64, step_s: f64) -> Self {
        let (stiffness, decay) = (natural_radps * natural_radps, damping_ratio * natural_radps);
        let damping = 2.0 * decay;
        let beat2 = stiffness - decay * decay;
        let beat = beat2.abs().sqrt();
        let turn = beat * step_s;
        let (cos, sin_over_beat) = if turn < 1e-6 {
            (1.0 - 0.5 * beat2 * step_s * step_s, step_s)
        } else if beat2 > 0.0 {
            (libm::cos(turn), libm::sin(turn) / beat)
        } else {
            (libm::cosh(turn), libm::sinh(turn) / beat)
        };
        let fade = libm::exp(-decay * step_s);
        let (even, odd) = (fade * cos, fade * sin_over_beat);
        let stays = even + decay * odd;
        // ∫ of the impulse response; its series where the closed form would lose precision.
        let step_response = if stiffness * step_s * step_s > 1e-8 {
            (1.0 - stays) / stiffness
        } else {
            let series = damping / 3.0 - (damping * damping - stiffness) * step_s / 12.0;
            step_s * step_s * 0.5 * (1.0 - step_s * series)
        };
        Self {
            stiffness,
            damping,
            position_from: [stays, odd, step_response],
            velocity_from: [-stiffness * odd, even - decay * odd, odd],
        }
    }

    /// Motion one step later under `input`.
    #[inline]
    pub fn step(&self, from: ModeState, input: f64) -> ModeState {
        let ([qq, qv, qu], [vq, vv, vu]) = (self.position_from, self.velocity_from);
        ModeState {
            position: qq * from.position + qv * from.velocity + qu * input,
            velocity: vq * from.position + vv * from.velocity + vu * input,
        }
    }

    /// Acceleration of `motion` under `input`.
    #[inline]
    pub fn acceleration(&self, motion: ModeState, input: f64) -> f64 {
        input - self.damping * motion.velocity - self.stiffness * motion.position
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// Reference: the same step in many small steps of the classical Runge-Kutta method.
    fn runge_kutta(oscillator: &Oscillator, from: ModeState, input: f64, step_s: f64) -> ModeState {
        const PARTS: usize = 2000;
        let h = step_s / PARTS as f64;
        let slope = |m: ModeState| ModeState { position: m.velocity, velocity: oscillator.acceleration(m, input) };
        let go = |m: ModeState, s: ModeState, h: f64| ModeState {
            position: m.position + h * s.position,
            velocity: m.velocity + h * s.velocity,
        };
        (0..PARTS).fold(from, |m, _| {
            let k1 = slope(m);
            let k2 = slope(go(m, k1, 0.5 * h));
            let k3 = slope(go(m, k2, 0.5 * h));
            let k4 = slope(go(m, k3, h));
            go(go(go(go(m, k1, h / 6.0), k2, h / 3.0), k3, h / 3.0), k4, h / 6.0)
        })
    }

    proptest! {
        #[test]
        fn one_step_equals_many_small_ones(
            w in prop_oneof![Just(0.0), 1e-3..5e4f64], zeta in prop_oneof![Just(1.0), 0.0..2.0f64],
            position in -1.0..1.0f64, velocity in -1.0..1.0f64, input in -1.0..1.0f64,
        ) {
            let step_s = 5e-5;
            let oscillator = Oscillator::new(w, zeta, step_s);
            let from = ModeState { position, velocity: velocity * (1.0 + w) };
            let (exact, small) = (oscillator.step(from, input), runge_kutta(&oscillator, from, input, step_s));
            let scale = 1e-9 * (1.0 + w);
            prop_assert!((exact.position - small.position).abs() < 1e-9);
            prop_assert!((exact.velocity - small.velocity).abs() < scale);
            // the response to the input alone, against the free mass's h²/2 and h
            let (kick, small) = (oscillator.step(ModeState::default(), 1.0), runge_kutta(&oscillator, ModeState::default(), 1.0, step_s));
            prop_assert!((kick.position / small.position - 1.0).abs() < 1e-7);
            prop_assert!((kick.velocity - small.velocity).abs() < 1e-9 * step_s);
        }
    }
}
