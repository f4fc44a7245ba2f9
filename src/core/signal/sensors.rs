//! Data of the rig's sensors: camera frames and accelerometer traces.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::Envelope;
use crate::geometry::Vec2;
use crate::time::PlateTime;
use crate::units::{file_form, hertz, mm_point};

/// One picture of the camera, 8-bit gray, rows from the top; or the positions that its detector measured in it.
#[derive(Clone, Debug, Default, PartialEq)]
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
        Self { width, height, pixels: vec![0; width * height], ..Self::default() }
    }

    /// A frame from an external picture, its gray levels row by row; `None` unless there are `width * height` of them.
    pub fn of_picture(width: usize, height: usize, pixels: Vec<u8>) -> Option<Self> {
        let is_whole = width.checked_mul(height) == Some(pixels.len());
        is_whole.then(|| Self { width, height, pixels, ..Self::default() })
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
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct AccelTrace {
    /// Samples a second in every channel; 16 or more to a period of the drive.
    #[schemars(range(min = 16.0, max = 1e6))]
    pub sample_hz: f64,
    /// Time of the first sample after the start of the pulse, s.
    #[serde(default)]
    #[schemars(range(min = -60.0, max = 60.0))]
    pub first_sample_s: f64,
    /// Acceleration of one count, m/s², as the data sheet has it.
    #[schemars(range(max = 1e5), extend("exclusiveMinimum" = 0.0))]
    pub mps2_per_count: f64,
    /// Largest count the converter shows; a sample there is clipped.
    #[schemars(range(min = 1, max = 32767))]
    pub count_limit: i16,
    /// The samples, equally many in every channel.
    // `MISSING_SAMPLE` for lost ones
    #[serde(with = "channels")]
    #[schemars(with = "ChannelCounts")]
    pub counts: [Vec<i16>; CHANNELS],
}

/// Counts of the four channels, equally many in each; null for a sample that is missing.
#[derive(Serialize, Deserialize, JsonSchema)]
struct ChannelCounts {
    /// Along x, accelerometer 1.
    #[schemars(length(min = 1), inner(range(min = -32767, max = 32767)))]
    x1: Vec<Option<i16>>,
    /// Along y, accelerometer 1.
    #[schemars(length(min = 1), inner(range(min = -32767, max = 32767)))]
    y1: Vec<Option<i16>>,
    /// Along x, accelerometer 2.
    #[schemars(length(min = 1), inner(range(min = -32767, max = 32767)))]
    x2: Vec<Option<i16>>,
    /// Along y, accelerometer 2.
    #[schemars(length(min = 1), inner(range(min = -32767, max = 32767)))]
    y2: Vec<Option<i16>>,
}

file_form!(
    channels: ChannelCounts => [Vec<i16>; CHANNELS],
    |ChannelCounts { x1, y1, x2, y2 }| {
        [x1, y1, x2, y2].map(|channel| channel.into_iter().map(|count| count.unwrap_or(MISSING_SAMPLE)).collect())
    },
    |counts| {
        let seen = |count: &i16| Some(*count).filter(|count| *count != MISSING_SAMPLE);
        let [x1, y1, x2, y2] = counts.each_ref().map(|channel| channel.iter().map(seen).collect());
        ChannelCounts { x1, y1, x2, y2 }
    }
);

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

/// A trace: what the accelerometers saw during one pulse on any rig, and what is needed to read it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[schemars(title = "trace")]
pub struct RecordedPulse {
    /// The accelerometers' trace.
    #[serde(flatten)]
    pub trace: AccelTrace,
    /// Outline of the pulse.
    #[serde(flatten)]
    pub envelope: Envelope,
    /// Base frequency of the vibration.
    #[serde(rename = "base_hz", with = "hertz")]
    #[schemars(with = "f64", range(min = 1.0, max = 1000.0))]
    pub base_radps: f64,
    /// Place of accelerometer 1 on the plate; number 2 sits at minus that.
    #[serde(rename = "position_mm", with = "mm_point")]
    #[schemars(with = "[f64; 2]", inner(range(min = -1000.0, max = 1000.0)))]
    pub accelerometer_in_plate_m: Vec2,
    /// Readings of x1, y1, x2 and y2 per true 1.
    #[serde(default = "no_gain_error")]
    #[schemars(inner(range(min = 0.1, max = 10.0)))]
    pub channel_gain: [f64; CHANNELS],
}

fn no_gain_error() -> [f64; CHANNELS] {
    [1.0; CHANNELS]
}
