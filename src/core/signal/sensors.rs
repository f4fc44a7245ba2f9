//! Data of the rig's sensors: camera frames and accelerometer traces.

use super::Envelope;
use crate::geometry::Vec2;
use crate::time::PlateTime;

/// One picture of the camera, 8-bit gray, rows from the top.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Frame {
    /// Number of columns.
    pub width: usize,
    /// Number of rows.
    pub height: usize,
    /// `width * height` gray levels, row by row.
    pub pixels: Vec<u8>,
    /// Number of the frame, counted from the start of the rig.
    pub index: u64,
    /// Time of the exposure's middle.
    pub exposed_at: PlateTime,
}

impl Frame {
    /// A black frame.
    #[inline]
    pub fn new(width: usize, height: usize) -> Self {
        Self { width, height, pixels: vec![0; width * height], index: 0, exposed_at: PlateTime::ZERO }
    }

    /// A frame from an external picture, its gray levels row by row; `None` unless there are `width * height` of them.
    pub fn of_picture(width: usize, height: usize, pixels: Vec<u8>) -> Option<Self> {
        let is_whole = width.checked_mul(height) == Some(pixels.len());
        is_whole.then_some(Self { width, height, pixels, index: 0, exposed_at: PlateTime::ZERO })
    }

    /// Row `y` from the top.
    #[inline]
    pub fn row(&self, y: usize) -> &[u8] {
        &self.pixels[y * self.width..][..self.width]
    }
}

/// Channels of a trace, in order: x and y of accelerometer 1, x and y of accelerometer 2.
pub const CHANNELS: usize = 4;

/// Names of the channels in files and tables.
pub const CHANNEL_NAMES: [&str; CHANNELS] = ["x1", "y1", "x2", "y2"];

/// Count that marks a lost sample.
pub const MISSING_SAMPLE: i16 = i16::MIN;

/// Trace of the two 2-axis accelerometers under opposite corners during one pulse, as the A/D converter sent it (UPM
/// paper, section 3.2). Accelerometer 2 is at minus the position of accelerometer 1.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct AccelTrace {
    /// Sampling rate of every channel, 1/s.
    pub sample_hz: f64,
    /// Time of the first sample after the start of the pulse, s.
    pub first_sample_s: f64,
    /// Acceleration of one count, m/s², from the data sheet.
    pub mps2_per_count: f64,
    /// Largest magnitude of the converter; a sample at it is clipped.
    pub count_limit: i16,
    /// Counts, equally many in every channel; [`MISSING_SAMPLE`] for lost ones.
    pub counts: [Vec<i16>; CHANNELS],
}

impl AccelTrace {
    /// Number of samples in each channel.
    #[inline]
    pub fn len(&self) -> usize {
        self.counts.iter().map(Vec::len).min().unwrap_or(0)
    }

    /// True without samples.
    #[inline]
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Time of sample `i` after the start of the pulse, s.
    #[inline]
    pub fn time_s(&self, i: usize) -> f64 {
        self.first_sample_s + i as f64 / self.sample_hz
    }
}

/// A trace with the data needed to evaluate it: a recording of one pulse on any rig.
#[derive(Clone, Debug, PartialEq)]
pub struct RecordedPulse {
    /// The accelerometers' trace.
    pub trace: AccelTrace,
    /// Outline of the pulse.
    pub envelope: Envelope,
    /// Base frequency of the drive, rad/s.
    pub base_radps: f64,
    /// Position of accelerometer 1 on the plate, m; number 2 is opposite.
    pub accelerometer_in_plate_m: Vec2,
    /// Gain of each channel: its reading for a true 1.
    pub channel_gain: [f64; CHANNELS],
}
