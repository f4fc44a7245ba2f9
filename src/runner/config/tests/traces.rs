use serde_json::{Value, json};

use super::{lines, set};
use crate::config::{Diagnostic, RigSpec, trace_from_json, trace_to_json};
use upm_core::geometry::Vec2;
use upm_core::signal::{Envelope, MISSING_SAMPLE, RecordedPulse};

/// Ten samples a channel; the third of `y2` is missing, the last of `x1` clipped.
pub(super) fn trace() -> Value {
    json!({
        "sample_hz": 1000, "mps2_per_count": 0.05, "count_limit": 511, "base_hz": 50,
        "attack_s": 0.02, "sustain_s": 0.1, "position_mm": [-92, 92],
        "counts": {
            "x1": [1, 2, 3, 4, 5, 6, 7, 8, 9, 511],
            "y1": [0, 0, 0, 0, 0, 0, 0, 0, 0, -512],
            "x2": [0, 0, 0, 0, 0, 0, 0, 0, 0, 0],
            "y2": [0, 0, null, 0, 0, 0, 0, 0, 0, 0],
        },
    })
}

fn read(document: &Value) -> Result<RecordedPulse, Vec<Diagnostic>> {
    trace_from_json(&document.to_string(), "trace.json")
}

#[test]
fn a_trace_is_read_in_si_with_its_defaults() {
    let pulse = read(&trace()).unwrap();
    assert_eq!(pulse.envelope, Envelope { attack_s: 0.02, sustain_s: 0.1, rest_s: 0.0 });
    assert_eq!((pulse.trace.first_sample_s, pulse.channel_gain), (0.0, [1.0; 4]));
    assert!((pulse.base_radps - 314.159_265_358_979_3).abs() < 1e-12);
    assert!((pulse.accelerometer_in_plate_m - Vec2::new(-0.092, 0.092)).norm() < 1e-15);
    assert_eq!(pulse.trace.counts[0], [1, 2, 3, 4, 5, 6, 7, 8, 9, 511]);
    assert_eq!(pulse.trace.counts[3][..4], [0, 0, MISSING_SAMPLE, 0]);
}

#[test]
fn written_trace_is_read_back_unchanged() {
    let mut document = trace();
    set(&mut document, "/first_sample_s", json!(-0.003));
    set(&mut document, "/channel_gain", json!([1.01, 0.98, 1.0, 1.003]));
    let pulse = read(&document).unwrap();
    let text = trace_to_json(&pulse);
    let again = trace_from_json(&text, "again.json").unwrap();
    assert_eq!(again, pulse);
    assert!(text.contains("\n  \"base_hz\": 50.0,\n"), "{text}");
    assert!(text.contains("\n    \"y2\": [0,0,null,0,0,0,0,0,0,0]\n"), "{text}");
}

#[test]
fn every_fault_of_a_trace_is_reported_with_its_path() {
    for (pointer, value, line) in [
        ("/sample_hz", json!(700), "sample_hz: expected 800 or more (16 samples to a period of base_hz), found 700"),
        (
            "/position_mm",
            json!([0, 0]),
            "position_mm: expected away from the plate's centre (number 2 is opposite), found [0, 0]",
        ),
        ("/mps2_per_count", json!(0), "mps2_per_count: expected a number above 0, up to 100000, found 0"),
        ("/counts/x2", json!([0]), "counts.x2: expected 10, as in counts.x1, found 1 sample"),
        (
            "/counts/x1/3",
            json!(513),
            "counts.x1[3]: expected from -512 to 511 (count_limit), null for a missing sample, found 513",
        ),
        ("/counts/x1/3", json!(1.5), "counts.x1[3]: expected a whole number from -32767 to 32767 or null, found 1.5"),
        (
            "/counts/x1/3",
            json!(-32768),
            "counts.x1[3]: expected a whole number from -32767 to 32767 or null, found -32768",
        ),
        ("/counts/y1", json!([]), "counts.y1: expected a list of 1 or more items"),
        ("/count_limit", json!(40000), "count_limit: expected a whole number from 1 to 32767, found 40000"),
        ("/channel_gain", json!([1, 1, 0, 1]), "channel_gain[2]: expected a number from 0.1 to 10, found 0"),
        (
            "/counts/z1",
            json!([1]),
            "counts.z1: expected one of x1, x2, y1, y2 (did you mean x1?), found unknown key \"z1\"",
        ),
        ("/base_hz", json!(null), "base_hz: expected a number from 1 to 1000, found null"),
    ] {
        let mut document = trace();
        set(&mut document, pointer, value);
        let found = lines(read(&document).unwrap_err());
        assert!(found.len() == 1 && found[0].starts_with(line), "{pointer}: {found:?}");
    }
    let mut document = trace();
    document.as_object_mut().unwrap().remove("counts");
    assert!(lines(read(&document).unwrap_err())[0].ends_with(", found nothing"));
}

#[test]
fn the_rigs_in_the_program_are_the_shipped_ones_without_their_libraries() {
    for (name, inside) in [("upm-1", RigSpec::upm_1()), ("upm-2", RigSpec::upm_2())] {
        let file = RigSpec::load(&super::shipped(&format!("rigs/{name}.json"))).unwrap();
        let inside = inside.unwrap();
        assert_eq!((&inside.model, &inside.sim, &inside.kinds), (&file.model, &file.sim, &file.kinds));
        assert_eq!((&inside.fingerprint, &inside.library), (&file.fingerprint, &None));
        assert!(file.library.is_some());
    }
}
