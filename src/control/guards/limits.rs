/// Evidence of healthy pulses has an exponential tail: `once + per_nat n` is exceeded in one pulse of `e^n`. These are
/// of `tools/faults.py healthy --first 20000 --seeds 360`.
struct Tail {
    once: f64,
    per_nat: f64,
}

/// Deviations of a motion from its plan, in tolerances.
const MOTION: Tail = Tail { once: 0.143, per_nat: 0.0644 };
/// Logarithms of a likelihood ratio: pictures are late, over in time. Errors of the model that repeat make them 2.7
/// times as wide as chance would.
const LATE: Tail = Tail { once: -12.97, per_nat: 2.70 };
/// Largest share of steps of parts that miss their forecast: one did of those compared, 4.74 is its bound at 95 %.
const MISSED: f64 = 4.74 / 80_766.0;
/// Least number of missed steps in a row: one wrong observation spoils two.
const LEAST_IN_A_ROW: u32 = 3;

/// Limits of the guards that rest on chance.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Limits {
    /// Deviation of a motion from its plan, in tolerances.
    pub motion: f64,
    /// Logarithm of a likelihood ratio: pictures that are late over pictures in time.
    pub late: f64,
    /// Steps of one part in a row that miss their forecast.
    pub steps: u32,
}

impl Limits {
    /// The limits that one chance in a pulse exceeds once in `exp(nats)` pulses, on a plate with this number of parts.
    pub fn new(nats: f64, parts: usize) -> Self {
        let exceeded = |tail: Tail| tail.once + tail.per_nat * nats;
        let of_parts = nats + libm::log(parts.max(1) as f64);
        Self {
            motion: exceeded(MOTION),
            late: exceeded(LATE),
            steps: ((of_parts / -libm::log(MISSED)).ceil() as u32).max(LEAST_IN_A_ROW),
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
        assert!((once.late - often.late - LATE.per_nat * 1000f64.ln()).abs() < 1e-9, "{limits:?}");
        let steps = [1.0, 17.0, 40.0].map(|nats| Limits::new(nats, 8).steps);
        assert!(steps[0] == LEAST_IN_A_ROW && steps.is_sorted() && steps[2] > LEAST_IN_A_ROW, "{steps:?}");
    }
}
