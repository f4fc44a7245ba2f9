use std::f64::consts::PI;

/// The outline of a shaped pulse: attack, sustain, decay as long as the attack, then rest until parts stand
/// still (UPM paper, section 3.3 and Fig. 9). The flanks are raised cosines.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Envelope {
    /// Length of the attack and of the decay, s.
    pub attack_s: f64,
    /// Length at full height, s.
    pub sustain_s: f64,
    /// Silence after the decay, s.
    pub rest_s: f64,
}

impl Envelope {
    /// Height in 0..=1 at `t_s` after the start.
    pub fn at(&self, t_s: f64) -> f64 {
        let from_edge = t_s.min(self.sounding_s() - t_s);
        if from_edge <= 0.0 {
            0.0
        } else if from_edge < self.attack_s {
            0.5 - 0.5 * (PI * from_edge / self.attack_s).cos()
        } else {
            1.0
        }
    }

    /// Time in which the motors move, s.
    pub fn sounding_s(&self) -> f64 {
        2.0 * self.attack_s + self.sustain_s
    }

    /// Time until the next pulse may start, s.
    pub fn total_s(&self) -> f64 {
        self.sounding_s() + self.rest_s
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rises_holds_falls_and_rests() {
        let envelope = Envelope { attack_s: 0.01, sustain_s: 0.1, rest_s: 0.03 };
        assert_eq!(envelope.at(-0.001), 0.0);
        assert!((envelope.at(0.005) - 0.5).abs() < 1e-12);
        assert_eq!(envelope.at(0.06), 1.0);
        assert!((envelope.at(0.115) - 0.5).abs() < 1e-12);
        assert_eq!(envelope.at(0.13), 0.0);
        assert!((envelope.total_s() - 0.15).abs() < 1e-12);
    }
}
