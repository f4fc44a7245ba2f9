use std::f64::consts::TAU;

use serde_json::Value;

use super::raw_trace::{RawCounts, RawTrace};
use super::read::point_m;
use upm_core::signal::{AccelTrace, Envelope, MISSING_SAMPLE, RecordedPulse};
use upm_core::units::mm_from_m;
use upm_document::{Diagnostic, Diagnostics, Path, SchemaKey, counted, parse_and_build, text_of};

/// Fewest samples per base period that a fit can use.
const LEAST_SAMPLES: f64 = 16.0;

/// Reads and validates the trace file at `path`. Errors list every fault.
pub fn load_trace(path: &std::path::Path) -> Result<RecordedPulse, Vec<Diagnostic>> {
    let text = text_of(path).map_err(|fault| vec![fault])?;
    trace_from_json(&text, &path.display().to_string())
}

/// Validates the trace in `text`, called `file` in faults. Errors list every fault. Gaps and clipped samples are valid:
/// the fit decides whether they matter.
pub fn trace_from_json(text: &str, file: &str) -> Result<RecordedPulse, Vec<Diagnostic>> {
    parse_and_build(text, file, |raw, faults| {
        check(&raw, faults);
        Some(pulse_of(&raw))
    })
}

/// Trace file of `pulse`: one line per key and per channel.
pub fn trace_to_json(pulse: &RecordedPulse) -> String {
    laid_out(&serde_json::to_value(raw_of(pulse)).unwrap_or_default(), 0) + "\n"
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

fn check(raw: &RawTrace, faults: &mut Diagnostics) {
    let root = Path::root();
    let least_hz = LEAST_SAMPLES * raw.base_hz;
    let allowed = format!("{least_hz} or more ({LEAST_SAMPLES} samples to a period of base_hz)");
    faults.require(raw.sample_hz >= least_hz, root.key("sample_hz"), raw.sample_hz, allowed);
    let apart = raw.position_mm != [0.0, 0.0];
    faults.require(apart, root.key("position_mm"), "[0, 0]", "away from the plate's centre (number 2 is opposite)");
    let at = root.key("counts");
    let samples = raw.counts.x1.len();
    for (name, channel) in raw.counts.named() {
        let found = counted(channel.len(), "sample");
        faults.require(channel.len() == samples, at.key(name), found, format!("{samples}, as in counts.x1"));
        check_range(channel, raw.count_limit, &at.key(name), faults);
    }
}

/// Checks counts against `limit`; in two's complement the range extends one further down than up.
fn check_range(channel: &[Option<i16>], limit: i16, at: &Path, faults: &mut Diagnostics) {
    let (low, high) = (-i32::from(limit) - 1, i32::from(limit));
    for (i, count) in channel.iter().enumerate() {
        if let Some(count) = count.filter(|&count| !(low..=high).contains(&i32::from(count))) {
            let allowed = format!("from {low} to {high} (count_limit), null for a missing sample");
            faults.push(at.index(i), count.to_string(), allowed);
        }
    }
}

fn pulse_of(raw: &RawTrace) -> RecordedPulse {
    let counts = raw.counts.named().map(|(_, channel)| channel.iter().map(|c| c.unwrap_or(MISSING_SAMPLE)).collect());
    RecordedPulse {
        trace: AccelTrace {
            sample_hz: raw.sample_hz,
            first_sample_s: raw.first_sample_s,
            mps2_per_count: raw.mps2_per_count,
            count_limit: raw.count_limit,
            counts,
        },
        envelope: Envelope { attack_s: raw.attack_s, sustain_s: raw.sustain_s, rest_s: 0.0 },
        base_radps: TAU * raw.base_hz,
        accelerometer_in_plate_m: point_m(raw.position_mm),
        channel_gain: raw.channel_gain,
    }
}

fn raw_of(pulse: &RecordedPulse) -> RawTrace {
    let RecordedPulse { trace, envelope, .. } = pulse;
    let [x1, y1, x2, y2] = trace
        .counts
        .each_ref()
        .map(|channel| channel.iter().map(|&count| (count != MISSING_SAMPLE).then_some(count)).collect());
    RawTrace {
        schema: SchemaKey,
        sample_hz: trace.sample_hz,
        first_sample_s: trace.first_sample_s,
        mps2_per_count: trace.mps2_per_count,
        count_limit: trace.count_limit,
        base_hz: rounded(pulse.base_radps / TAU),
        attack_s: envelope.attack_s,
        sustain_s: envelope.sustain_s,
        position_mm: [pulse.accelerometer_in_plate_m.x, pulse.accelerometer_in_plate_m.y]
            .map(|m| rounded(mm_from_m(m))),
        channel_gain: pulse.channel_gain,
        counts: RawCounts { x1, y1, x2, y2 },
    }
}

/// Rounds to 1e-9, so that 60 Hz converted to rad/s and back is written as 60.
fn rounded(value: f64) -> f64 {
    (value * 1e9).round() / 1e9
}
