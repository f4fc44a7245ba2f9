//! Trace files: what the accelerometers saw during one pulse on any rig.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use serde_json::Value;

use upm_core::document::{Diagnostic, Diagnostics, Path, counted, parse_and_build, text_of};
use upm_core::geometry::Vec2;
use upm_core::signal::{AccelTrace, CHANNEL_NAMES, CHANNELS, Envelope, MISSING_SAMPLE, RecordedPulse};
use upm_core::units::{file_form, hertz, mm_point, written_hertz};

/// Fewest samples per base period that a fit can use.
const LEAST_SAMPLES: f64 = 16.0;

/// A trace: what the accelerometers saw during one pulse on any rig, and what is needed to read it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(title = "trace")]
pub(super) struct TraceFile {
    /// Samples a second in every channel; 16 or more to a period of `base_hz`.
    #[schemars(range(min = 16.0, max = 1e6))]
    sample_hz: f64,
    /// Time of the first sample after the start of the pulse, s.
    #[serde(default)]
    #[schemars(range(min = -60.0, max = 60.0))]
    first_sample_s: f64,
    /// Acceleration of one count, m/s², as the data sheet has it.
    #[schemars(range(max = 1e5), extend("exclusiveMinimum" = 0.0))]
    mps2_per_count: f64,
    /// Largest count the converter shows; a sample there is clipped.
    #[schemars(range(min = 1, max = 32767))]
    count_limit: i16,
    /// Base frequency of the vibration, Hz.
    #[serde(rename = "base_hz", with = "hertz")]
    #[schemars(with = "f64", range(min = 1.0, max = 1000.0))]
    base_radps: f64,
    /// Attack and decay of the pulse, s.
    #[schemars(range(min = 0.0, max = 10.0))]
    attack_s: f64,
    /// Length at full height, s.
    #[schemars(range(min = 0.0, max = 60.0))]
    sustain_s: f64,
    /// Place of accelerometer 1 on the plate, mm; number 2 sits at minus that.
    #[serde(rename = "position_mm", with = "mm_point")]
    #[schemars(with = "[f64; 2]", inner(range(min = -1000.0, max = 1000.0)))]
    accelerometer_in_plate_m: Vec2,
    /// Readings of x1, y1, x2 and y2 per true 1.
    #[serde(default = "no_gain_error")]
    #[schemars(inner(range(min = 0.1, max = 10.0)))]
    channel_gain: [f64; 4],
    /// The samples.
    #[serde(with = "channels")]
    #[schemars(with = "ChannelCounts")]
    counts: [Vec<i16>; CHANNELS],
}

fn no_gain_error() -> [f64; 4] {
    [1.0; 4]
}

/// Counts of the four channels, equally many in each; null for a sample that is missing.
#[derive(Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
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

/// Reads and validates the trace file at `path`. Errors list every fault.
pub fn load_trace(path: &std::path::Path) -> Result<RecordedPulse, Vec<Diagnostic>> {
    trace_from_json(&text_of(path)?, &path.display().to_string())
}

/// Validates the trace in `text`, called `file` in faults. Errors list every fault. Gaps and clipped samples are valid:
/// the fit decides whether they matter.
pub fn trace_from_json(text: &str, file: &str) -> Result<RecordedPulse, Vec<Diagnostic>> {
    parse_and_build(text, file, |trace, faults| {
        check(&trace, faults);
        Some(pulse_of(trace))
    })
}

/// Trace file of `pulse`: one line per key and per channel.
pub fn trace_to_json(pulse: &RecordedPulse) -> String {
    laid_out(&serde_json::to_value(file_of(pulse)).unwrap_or_default(), 0) + "\n"
}

fn laid_out(value: &Value, indent: usize) -> String {
    let Some(members) = value.as_object() else { return value.to_string() };
    let inner = indent + 2;
    let line = |(key, member): (&String, &Value)| {
        format!("{:inner$}{}: {}", "", Value::from(key.as_str()), laid_out(member, inner))
    };
    let lines: Vec<String> = members.iter().map(line).collect();
    format!("{{\n{}\n{:indent$}}}", lines.join(",\n"), "")
}

fn check(file: &TraceFile, faults: &mut Diagnostics) {
    let root = Path::root();
    let least_hz = LEAST_SAMPLES * written_hertz(file.base_radps);
    let allowed = format!("{least_hz} or more ({LEAST_SAMPLES} samples to a period of base_hz)");
    faults.require(file.sample_hz >= least_hz, root.key("sample_hz"), file.sample_hz, allowed);
    let apart = file.accelerometer_in_plate_m != Vec2::zeros();
    faults.require(apart, root.key("position_mm"), "[0, 0]", "away from the plate's centre (number 2 is opposite)");
    let at = root.key("counts");
    let samples = file.counts[0].len();
    for (name, channel) in CHANNEL_NAMES.into_iter().zip(&file.counts) {
        let found = counted(channel.len(), "sample");
        faults.require(channel.len() == samples, at.key(name), found, format!("{samples}, as in counts.x1"));
        check_range(channel, file.count_limit, &at.key(name), faults);
    }
}

/// Checks counts against `limit`; in two's complement the range extends one further down than up.
fn check_range(channel: &[i16], limit: i16, at: &Path, faults: &mut Diagnostics) {
    let (low, high) = (-limit - 1, limit);
    for (i, count) in channel.iter().enumerate().filter(|(_, count)| **count != MISSING_SAMPLE) {
        if !(low..=high).contains(count) {
            faults.push(at.index(i), count, format!("from {low} to {high} (count_limit), null for a missing sample"));
        }
    }
}

fn pulse_of(file: TraceFile) -> RecordedPulse {
    let TraceFile { sample_hz, first_sample_s, mps2_per_count, count_limit, counts, .. } = file;
    RecordedPulse {
        trace: AccelTrace { sample_hz, first_sample_s, mps2_per_count, count_limit, counts },
        envelope: Envelope { attack_s: file.attack_s, sustain_s: file.sustain_s, rest_s: 0.0 },
        base_radps: file.base_radps,
        accelerometer_in_plate_m: file.accelerometer_in_plate_m,
        channel_gain: file.channel_gain,
    }
}

fn file_of(pulse: &RecordedPulse) -> TraceFile {
    let AccelTrace { sample_hz, first_sample_s, mps2_per_count, count_limit, counts } = pulse.trace.clone();
    TraceFile {
        sample_hz,
        first_sample_s,
        mps2_per_count,
        count_limit,
        base_radps: pulse.base_radps,
        attack_s: pulse.envelope.attack_s,
        sustain_s: pulse.envelope.sustain_s,
        accelerometer_in_plate_m: pulse.accelerometer_in_plate_m,
        channel_gain: pulse.channel_gain,
        counts,
    }
}
