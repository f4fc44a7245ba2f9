//! Trace files: what the accelerometers saw during one pulse on any rig.

use serde_json::Value;

use upm_core::document::{Diagnostic, Diagnostics, Path, counted, parse_and_build, text_of};
use upm_core::geometry::Vec2;
use upm_core::signal::{CHANNEL_NAMES, MISSING_SAMPLE, RecordedPulse};
use upm_core::units::written_hertz;

/// Fewest samples per base period that a fit can use.
const LEAST_SAMPLES: f64 = 16.0;

/// Reads and validates the trace file at `path`. Errors list every fault.
pub fn load_trace(path: &std::path::Path) -> Result<RecordedPulse, Vec<Diagnostic>> {
    trace_from_json(&text_of(path)?, &path.display().to_string())
}

/// Validates the trace in `text`, called `file` in faults. Errors list every fault. Gaps and clipped samples are valid:
/// the fit decides whether they matter.
pub fn trace_from_json(text: &str, file: &str) -> Result<RecordedPulse, Vec<Diagnostic>> {
    parse_and_build(text, file, |trace, faults| {
        check(&trace, faults);
        Some(trace)
    })
}

/// Trace file of `pulse`: one line per key and per channel.
pub fn trace_to_json(pulse: &RecordedPulse) -> String {
    laid_out(&serde_json::to_value(pulse).unwrap_or_default(), 0) + "\n"
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

fn check(pulse: &RecordedPulse, faults: &mut Diagnostics) {
    let (root, trace) = (Path::root(), &pulse.trace);
    let least_hz = LEAST_SAMPLES * written_hertz(pulse.base_radps);
    let allowed = format!("{least_hz} or more ({LEAST_SAMPLES} samples to a period of base_hz)");
    faults.require(trace.sample_hz >= least_hz, root.key("sample_hz"), trace.sample_hz, allowed);
    let apart = pulse.accelerometer_in_plate_m != Vec2::zeros();
    faults.require(apart, root.key("position_mm"), "[0, 0]", "away from the plate's centre (number 2 is opposite)");
    let at = root.key("counts");
    let samples = trace.counts[0].len();
    for (name, channel) in CHANNEL_NAMES.into_iter().zip(&trace.counts) {
        let found = counted(channel.len(), "sample");
        faults.require(channel.len() == samples, at.key(name), found, format!("{samples}, as in counts.x1"));
        // in two's complement the range extends one further down than up
        let (low, high) = (-trace.count_limit - 1, trace.count_limit);
        let is_wrong = |count: &i16| *count != MISSING_SAMPLE && !(low..=high).contains(count);
        for (i, count) in channel.iter().enumerate().filter(|(_, count)| is_wrong(count)) {
            let allowed = format!("from {low} to {high} (count_limit), null for a missing sample");
            faults.push(at.key(name).index(i), count, allowed);
        }
    }
}
