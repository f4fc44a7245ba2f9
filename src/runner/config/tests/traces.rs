use serde_json::{Value, json};

use super::set;
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
fn the_rigs_in_the_program_are_the_shipped_ones_without_their_libraries() {
    for (name, inside) in [("upm-1", RigSpec::upm_1()), ("upm-2", RigSpec::upm_2())] {
        let file = RigSpec::load(&super::shipped(&format!("rigs/{name}.json"))).unwrap();
        let inside = inside.unwrap();
        assert_eq!((&inside.model, &inside.sim, &inside.kinds), (&file.model, &file.sim, &file.kinds));
        assert_eq!((&inside.fingerprint, &inside.library), (&file.fingerprint, &None));
        assert!(file.library.is_some());
    }
}
