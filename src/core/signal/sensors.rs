//! Data of the rig's sensors: camera frames and accelerometer traces.

use super::Envelope;
use crate::geometry::Vec2;
use crate::time::PlateTime;

/// One picture of the camera, 8-bit gray, rows from the top; or the positions that its detector measured in it.
#[derive(Clone, Debug, PartialEq)]
pub struct Frame {
    /// Number of columns.
    pub width: usize,
    /// Number of rows.
    pub height: usize,
    /// `width * height` gray levels, row by row; empty where positions are in their place.
    pub pixels: Vec<u8>,
    /// Positions in place of pixels.
    pub positions: Option<MeasuredPositions>,
    /// Number of the frame, counted from the start of the rig.
    pub index: u64,
    /// Time of the exposure's middle.
    pub exposed_at: PlateTime,
}

impl Frame {
    /// A black frame.
    #[inline]
    pub fn new(width: usize, height: usize) -> Self {
        Self { pixels: vec![0; width * height], ..Self::without_pixels(width, height) }
    }

    /// A frame from an external picture, its gray levels row by row; `None` unless there are `width * height` of them.
    pub fn of_picture(width: usize, height: usize, pixels: Vec<u8>) -> Option<Self> {
        let is_whole = width.checked_mul(height) == Some(pixels.len());
        is_whole.then_some(Self { pixels, ..Self::without_pixels(width, height) })
    }

    fn without_pixels(width: usize, height: usize) -> Self {
        Self { width, height, pixels: Vec::new(), positions: None, index: 0, exposed_at: PlateTime::ZERO }
    }

    /// Row `y` from the top.
    #[inline]
    pub fn row(&self, y: usize) -> &[u8] {
        &self.pixels[y * self.width..][..self.width]
    }
}

/// Positions of plate and parts in a picture, as a detector measures them.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct MeasuredPositions {
    /// Corners of the plate, px, clockwise; `None` where one of them is hidden.
    pub corners_px: Option<[Vec2; 4]>,
    /// The visible parts, in no particular order.
    pub discs: Vec<MeasuredDisc>,
}

impl MeasuredPositions {
    /// Leaves out the parts whose centre `is_hidden`, and the corners if one of them is.
    pub fn hide(&mut self, is_hidden: impl Fn(Vec2) -> bool) {
        self.corners_px =
            self.corners_px.filter(|corners_px| !corners_px.iter().any(|&corner_px| is_hidden(corner_px)));
        self.discs.retain(|disc| !is_hidden(disc.center_px));
    }

    /// Moves everything as `moved` moves a point of the picture.
    pub fn displace(&mut self, moved: impl Fn(Vec2) -> Vec2) {
        self.corners_px = self.corners_px.map(|corners_px| corners_px.map(&moved));
        self.discs.iter_mut().for_each(|disc| disc.center_px = moved(disc.center_px));
    }
}

/// A part in a picture.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MeasuredDisc {
    /// Centre of its top face, px.
    pub center_px: Vec2,
    /// Standard deviation of the centre along either axis, px.
    pub sd_px: f64,
    /// Radius of its outline, m.
    pub radius_m: f64,
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
