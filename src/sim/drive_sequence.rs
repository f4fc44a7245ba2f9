//! Pulses that take over from one another without a pause.

use upm_core::signal::{Drive, Envelope, MOTORS};

/// Rounding of plate time, which is in whole nanoseconds, s.
const ROUNDING_S: f64 = 1e-9;

/// The playing pulse, the one that decays while it rises, and the one that takes over next. Times count from the start
/// of the first one, s.
#[derive(Clone, Debug, Default)]
pub(super) struct DriveSequence {
    playing: Option<PlayedDrive>,
    fading: Option<PlayedDrive>,
    next: Option<PlayedDrive>,
    took_over: bool,
}

/// A pulse and its start.
#[derive(Clone, Debug)]
struct PlayedDrive {
    drive: Drive,
    start_s: f64,
}

impl PlayedDrive {
    fn counts_at(&self, t_s: f64) -> [f64; MOTORS] {
        self.drive.counts_at(t_s - self.start_s)
    }

    /// The same pulse that decays from `from_s` on.
    fn decaying_from(mut self, from_s: f64) -> Self {
        let envelope = &mut self.drive.envelope;
        envelope.sustain_s = (from_s - self.start_s - envelope.attack_s).max(0.0);
        self
    }
}

impl DriveSequence {
    /// Begins with `drive`.
    pub fn start(drive: Drive) -> Self {
        Self { playing: Some(PlayedDrive { drive, start_s: 0.0 }), ..Self::default() }
    }

    /// True when nothing plays.
    #[inline]
    pub fn is_over(&self) -> bool {
        self.playing.is_none()
    }

    /// Lets `drive` take over, asked at `now_s`; returns its start. `None` where it is too late: the playing pulse
    /// decays, or another one takes over already. It starts at the end of the playing pulse's attack or, where that is
    /// over, of its sustain.
    pub fn take_over(&mut self, drive: Drive, now_s: f64) -> Option<f64> {
        self.exchange(now_s);
        let PlayedDrive { drive: Drive { envelope, .. }, start_s } =
            self.playing.as_ref().filter(|_| self.next.is_none())?;
        let ends_s = [envelope.attack_s, envelope.attack_s + envelope.sustain_s].map(|end_s| start_s + end_s);
        let start_s = ends_s.into_iter().find(|end_s| now_s <= *end_s)?;
        self.next = Some(PlayedDrive { drive, start_s });
        Some(start_s)
    }

    /// Time that the playing pulse takes to decay, s; 0 where nothing plays.
    pub fn fade_s(&self) -> f64 {
        self.playing.as_ref().map_or(0.0, |playing| playing.drive.envelope.attack_s)
    }

    /// Counts while `drive` takes over from the playing pulse, `t_s` after it starts; zero where nothing plays.
    pub fn counts_of_take_over(&self, drive: &Drive, t_s: f64) -> [f64; MOTORS] {
        let Some(playing) = &self.playing else { return [0.0; MOTORS] };
        let envelope = Envelope { sustain_s: 0.0, ..playing.drive.envelope };
        let fading = Drive { envelope, ..playing.drive.clone() }.counts_at(envelope.attack_s + t_s);
        let rising = drive.counts_at(t_s);
        std::array::from_fn(|motor| fading[motor] + rising[motor])
    }

    /// Start and envelope of the pulse that took over since the last call.
    #[inline]
    pub fn taken_over(&mut self) -> Option<(f64, Envelope)> {
        let playing = self.playing.as_ref().filter(|_| std::mem::take(&mut self.took_over))?;
        Some((playing.start_s, playing.drive.envelope))
    }

    /// Counts at `t_s`; `None` once nothing plays.
    pub fn counts_at(&mut self, t_s: f64) -> Option<[f64; MOTORS]> {
        self.exchange(t_s);
        let is_driven = |playing: &PlayedDrive| t_s < playing.start_s + playing.drive.envelope.driven_s();
        let Some(playing) = self.playing.as_ref().filter(|playing| is_driven(playing)) else {
            *self = Self::default();
            return None;
        };
        let mut counts = playing.counts_at(t_s);
        if let Some(fading) = &self.fading {
            counts.iter_mut().zip(fading.counts_at(t_s)).for_each(|(sum, counts)| *sum += counts);
        }
        Some(counts)
    }

    /// Lets the next pulse take over if it is due at `t_s`.
    fn exchange(&mut self, t_s: f64) {
        if let Some(next) = self.next.take_if(|next| t_s + ROUNDING_S >= next.start_s) {
            self.fading = self.playing.take().map(|last| last.decaying_from(next.start_s));
            (self.playing, self.took_over) = (Some(next), true);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f64::consts::TAU;
    use upm_core::signal::{Harmonic, Shaping};

    const PERIOD_S: f64 = 1.0 / 15.0;

    /// Rises over a period, plays for another and decays over a third.
    fn drive(counts: f64) -> Drive {
        let wave = |counts: f64| vec![Harmonic { cos: counts, sin: 0.3 * counts }, Harmonic { cos: 0.0, sin: -counts }];
        let flank = |share: f64| [wave(share * counts), wave(share * share * counts)];
        Drive {
            base_radps: TAU / PERIOD_S,
            motors: [wave(counts), vec![], wave(-0.5 * counts), vec![]],
            shaping: Shaping::Displacement([flank(0.01), Default::default(), flank(-0.01), Default::default()]),
            envelope: Envelope { attack_s: PERIOD_S, sustain_s: PERIOD_S, rest_s: 0.04 },
        }
    }

    #[test]
    fn the_same_motion_that_takes_over_goes_on_as_if_nothing_happened() {
        let mut sequence = DriveSequence::start(drive(300.0));
        let steady = Drive { envelope: Envelope { sustain_s: 1.0, ..drive(300.0).envelope }, ..drive(300.0) };
        let mut starts = vec![0.0];
        for k in 0..3000 {
            let t_s = 1e-4 * f64::from(k);
            if t_s > starts[starts.len() - 1] && starts.len() < 3 {
                starts.extend(sequence.take_over(drive(300.0), t_s));
            }
            let counts = sequence.counts_at(t_s).unwrap();
            let wanted = steady.counts_at(t_s);
            let off = counts.iter().zip(wanted).map(|(found, wanted)| (found - wanted).abs()).fold(0.0, f64::max);
            assert!(off < 1e-6 || t_s > starts[starts.len() - 1] + 2.0 * PERIOD_S, "{t_s}: {off}");
        }
        assert!((starts[2] - 2.0 * PERIOD_S).abs() < 1e-12, "{starts:?}");
        assert_eq!(sequence.counts_at(5.1 * PERIOD_S), None, "without another one it ends");
    }

    #[test]
    fn a_late_one_starts_a_period_later_and_one_too_late_is_refused() {
        let mut sequence = DriveSequence::start(drive(100.0));
        assert_eq!(sequence.clone().take_over(drive(50.0), 0.5 * PERIOD_S), Some(PERIOD_S));
        assert_eq!(sequence.clone().take_over(drive(50.0), 2.5 * PERIOD_S), None);
        assert_eq!(sequence.take_over(drive(50.0), 1.5 * PERIOD_S), Some(2.0 * PERIOD_S));
        assert_eq!(sequence.take_over(drive(50.0), 1.6 * PERIOD_S), None, "one at a time");
        assert_eq!(sequence.taken_over(), None);
        let t_s = 2.25 * PERIOD_S;
        let forecast = DriveSequence::start(drive(100.0)).counts_of_take_over(&drive(50.0), 0.25 * PERIOD_S);
        let played = sequence.counts_at(t_s).unwrap();
        assert!(forecast.iter().zip(played).all(|(a, b)| (a - b).abs() < 1e-9), "{forecast:?} {played:?}");
        assert_eq!(sequence.taken_over().map(|(start_s, _)| start_s), Some(2.0 * PERIOD_S));
        assert_eq!(DriveSequence::default().take_over(drive(1.0), 0.0), None);
    }
}
