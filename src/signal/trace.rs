/// Channels of a trace, in order: x and y of accelerometer 1, x and y of accelerometer 2.
pub const CHANNELS: usize = 4;

/// Count that stands for a sample that never arrived.
pub const MISSING_SAMPLE: i16 = i16::MIN;

/// What the two 2-axis accelerometers under opposite corners saw during one pulse, as the A/D converter
/// sent it (UPM paper, section 3.2). Accelerometer 2 sits at minus the position of accelerometer 1.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct AccelTrace {
    /// Samples a second in every channel.
    pub sample_hz: f64,
    /// Time of the first sample after the start of the pulse, s.
    pub first_sample_s: f64,
    /// Acceleration of one count, m/s², as the data sheet has it.
    pub mps2_per_count: f64,
    /// Largest magnitude the converter can show; a sample there is clipped.
    pub count_limit: i16,
    /// Counts, equally many in every channel; [`MISSING_SAMPLE`] where one was lost.
    pub counts: [Vec<i16>; CHANNELS],
}

impl AccelTrace {
    /// Samples in each channel.
    pub fn len(&self) -> usize {
        self.counts.iter().map(Vec::len).min().unwrap_or(0)
    }

    /// True when nothing was sampled.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Time of sample `i` after the start of the pulse, s.
    pub fn time_s(&self, i: usize) -> f64 {
        self.first_sample_s + i as f64 / self.sample_hz
    }
}
