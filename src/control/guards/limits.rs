use super::delay::DELAYS;

/// Deviations of a healthy pulse's motion from its plan, in tolerances, have an exponential tail: `MOTION_ONCE +
/// MOTION_PER_NAT n` is exceeded in one pulse of `e^n`. `tools/faults.py healthy` measures both, and the next two.
const MOTION_ONCE: f64 = 0.51;
const MOTION_PER_NAT: f64 = 0.026;
/// Steps of healthy parts that were compared with their forecast, and those of them that missed it.
const STEPS: f64 = 24_801.0;
const STEPS_MISSED: f64 = 0.0;
/// Least number of missed steps in a row: one wrong observation spoils two.
const LEAST_IN_A_ROW: u32 = 3;

/// Limits of the guards that rest on chance.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Limits {
    /// Deviation of a motion from its plan, in tolerances.
    pub motion: f64,
    /// Logarithm of a likelihood ratio, pictures that are late over pictures in time: by Wald's bound healthy pulses
    /// exceed `h` once in `exp(h)` for each delay.
    pub late: f64,
    /// Steps of one part in a row that miss their forecast.
    pub steps: u32,
}

impl Limits {
    /// The limits that one chance in a pulse exceeds once in `exp(nats)` pulses, on a plate with this number of parts.
    pub fn new(nats: f64, parts: usize) -> Self {
        // the rule of three: a share of which none was seen in n is below 3/n, at 95 %
        let missed_nats = (STEPS / (STEPS_MISSED + 3.0)).ln();
        let of_parts = nats + (parts.max(1) as f64).ln();
        Self {
            motion: MOTION_ONCE + MOTION_PER_NAT * nats,
            late: nats + (DELAYS as f64).ln(),
            steps: ((of_parts / missed_nats).ceil() as u32).max(LEAST_IN_A_ROW),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Guards;

    #[test]
    fn more_false_alarms_give_lower_limits() {
        let limits = [1000.0, 1.0, 0.001].map(|rate| Guards { false_alarms_per_1000_h: rate, without: None }.limits(8));
        let [often, once, hardly] = limits;
        assert!(often.motion < once.motion && once.motion < hardly.motion, "{limits:?}");
        assert!(
            (once.late - often.late - 1000f64.ln()).abs() < 1e-9,
            "a factor of the rate is its logarithm in evidence"
        );
        let steps = [1.0, 17.0, 40.0].map(|nats| Limits::new(nats, 8).steps);
        assert!(steps[0] == LEAST_IN_A_ROW && steps.is_sorted() && steps[2] > LEAST_IN_A_ROW, "{steps:?}");
    }
}
