use super::Envelope;

/// Number of voice coils.
pub const MOTORS: usize = 4;

/// The voice coils, in the order of every array of motors (UPM paper, Fig. 4a).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Motor {
    /// Pushes along +x; its line passes at -y of the centre, so that a push turns the plate clockwise.
    X1,
    /// Pushes along -x from the other side; a push turns the plate clockwise.
    X2,
    /// Pushes along +y; a push turns the plate counter-clockwise.
    Y1,
    /// Pushes along -y from the other side; a push turns the plate counter-clockwise.
    Y2,
}

impl Motor {
    /// All four, in order.
    pub const ALL: [Self; MOTORS] = [Self::X1, Self::X2, Self::Y1, Self::Y2];
}

/// One harmonic of a motor's waveform, in amplitude counts of the waveform generator.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Harmonic {
    /// Amplitude of `cos kwt`, counts.
    pub cos: f64,
    /// Amplitude of `sin kwt`, counts.
    pub sin: f64,
}

/// What the waveform generator is told to play: harmonics for each motor under a common envelope.
/// The generator rounds every sample of the sum to whole counts.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Drive {
    /// Base frequency w, rad/s.
    pub base_radps: f64,
    /// For each motor harmonic `k` at index `k - 1`.
    pub motors: [Vec<Harmonic>; MOTORS],
    /// Outline of the pulse.
    pub envelope: Envelope,
}

impl Drive {
    /// The sample of `motor` (index into [`Motor::ALL`]) at `t_s` after the start, counts, before rounding.
    pub fn counts_at(&self, motor: usize, t_s: f64) -> f64 {
        let height = self.envelope.at(t_s);
        if height == 0.0 {
            return 0.0;
        }
        let (sin, cos) = (self.base_radps * t_s).sin_cos();
        let (mut sin_k, mut cos_k) = (sin, cos);
        let mut sum = 0.0;
        for harmonic in &self.motors[motor] {
            sum += harmonic.cos * cos_k + harmonic.sin * sin_k;
            (sin_k, cos_k) = (sin_k * cos + cos_k * sin, cos_k * cos - sin_k * sin);
        }
        height * sum
    }

    /// Largest sample any motor plays at full height, counts; found to better than 0.1 % for up to 16 harmonics.
    pub fn peak_counts(&self) -> f64 {
        const STEPS: usize = 720;
        let full = Self { envelope: Envelope { attack_s: 0.0, sustain_s: f64::MAX, rest_s: 0.0 }, ..self.clone() };
        let period_s = std::f64::consts::TAU / self.base_radps;
        (0..MOTORS)
            .flat_map(|motor| (1..=STEPS).map(move |i| (motor, i)))
            .map(|(motor, i)| full.counts_at(motor, period_s * i as f64 / STEPS as f64).abs())
            .fold(0.0, f64::max)
    }

    /// The same pulse with every force reversed: parts flow the other way.
    pub fn reversed(mut self) -> Self {
        for harmonic in self.motors.iter_mut().flatten() {
            *harmonic = Harmonic { cos: -harmonic.cos, sin: -harmonic.sin };
        }
        self
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn samples_follow_the_papers_waveform() {
        // f(t) = cos wt - sin 2wt (Eq. 8)
        let wave = vec![Harmonic { cos: 100.0, sin: 0.0 }, Harmonic { cos: 0.0, sin: -100.0 }];
        let drive = Drive {
            base_radps: 377.0,
            motors: [wave, vec![], vec![], vec![]],
            envelope: Envelope { attack_s: 0.01, sustain_s: 0.1, rest_s: 0.05 },
        };
        for t in [0.02f64, 0.05, 0.0777] {
            let expected = 100.0 * ((377.0 * t).cos() - (2.0 * 377.0 * t).sin());
            assert!((drive.counts_at(0, t) - expected).abs() < 1e-9);
        }
        assert_eq!(drive.counts_at(0, 0.125), 0.0);
        assert!((drive.peak_counts() - 176.0).abs() < 0.1, "max of cos a - sin 2a is 1.7602");
    }
}
