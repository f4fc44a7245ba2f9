use serde_json::{Value, json};

use super::{lines, origin, value_of};
use crate::config::{Diagnostic, SimulateSpec};
use upm_core::geometry::{Twist, Vec2};
use upm_core::job::PlateMode;
use upm_core::signal::{Envelope, TwistHarmonic};

pub(super) fn experiment() -> Value {
    json!({
        "rig": "rigs/upm-1.json",
        "plate": "kinematic",
        "parts": [{"kind": "penny", "position_mm": [100, 0]}, {"kind": "dime", "position_mm": [-40, 0]}],
        "pulses": [
            {"cor_mm": [10, -20], "omega_rad_s": 8, "rotation": -1, "sustain_s": 0.1, "attack_s": 0.01, "rest_s": 0.03},
            {"direction_deg": 90, "speed_mps": 0.05, "sustain_s": 0.2}
        ]
    })
}

fn read(document: &Value) -> Result<SimulateSpec, Vec<Diagnostic>> {
    SimulateSpec::from_json(&document.to_string(), &origin())
}

#[test]
fn pulses_become_twists_and_envelopes() {
    let spec = read(&experiment()).unwrap();
    assert_eq!((spec.plate, spec.sample_hz), (PlateMode::Kinematic, 1000.0));
    assert_eq!(spec.pulses[0].envelope, Envelope { attack_s: 0.01, sustain_s: 0.1, rest_s: 0.03 });
    let wave = TwistHarmonic::pump(Twist::about(Vec2::new(0.01, -0.02), -8.0));
    assert_eq!(spec.pulses[0].harmonics, wave);
    assert_eq!(spec.base_radps, spec.rig.model.base_radps);
    let (attack_s, rest_s) = (spec.rig.model.attack_s, spec.rig.model.rest_s);
    assert_eq!(spec.pulses[1].envelope, Envelope { attack_s, sustain_s: 0.2, rest_s });
    assert!((spec.pulses[1].harmonics[0].cos.velocity_mps - Vec2::new(0.0, 0.05)).norm() < 1e-15);
    assert_eq!(spec.parts[0].position_m, Vec2::new(0.1, 0.0));
    assert_eq!((spec.parts[1].id.as_str(), spec.parts[1].params.friction), ("dime-1", 0.3));
}

/// A pulse whose harmonic `k` alone is not zero.
fn free(k: usize) -> Value {
    let mut harmonics = vec![json!({}); k];
    harmonics[k - 1] = json!({"cos": [0.5, -0.25, 3], "sin": [0, 0.125, 0]});
    json!({"harmonics": harmonics, "rotation": -1, "sustain_s": 0.1})
}

#[test]
fn free_waves_are_taken_with_their_sign() {
    let mut document = experiment();
    document["pulses"][0] = free(2);
    document["base_hz"] = json!(40);
    let spec = read(&document).unwrap();
    let second = TwistHarmonic { cos: Twist::new(-0.5, 0.25, -3.0), sin: Twist::new(0.0, -0.125, 0.0) };
    assert_eq!(spec.pulses[0].harmonics, [TwistHarmonic::default(), second]);
    assert!((spec.base_radps - 251.327_412_287).abs() < 1e-8);
}

/// The rig's own limits: 50 steps of 5e-5 s are a period of 400 Hz, 4 samples at 10 kHz one of 2500 Hz, the low-pass
/// ends at 1000 Hz, the highest resonance is 17 Hz.
#[test]
fn frequencies_are_held_to_step_generator_and_resonance() {
    let check = |plate: &str, base_hz: f64, pulse: Value, step_s: f64, low_pass_hz: f64| {
        let mut document = experiment();
        document["rig"] = value_of("rigs/upm-1.json");
        document["rig"]["simulation"]["step_s"] = json!(step_s);
        document["rig"]["motors"]["low_pass_hz"] = json!(low_pass_hz);
        (document["plate"], document["base_hz"], document["pulses"][0]) = (json!(plate), json!(base_hz), pulse);
        read(&document).map(drop).map_err(|faults| lines(faults).join("\n"))
    };
    let pump = experiment()["pulses"][0].clone();
    assert_eq!(check("kinematic", 40.0, free(10), 5e-5, 1000.0), Ok(()));
    let too_fast =
        "pulses[0].harmonics: expected up to 400.0 Hz (50 steps of 0.00005 s a period), found harmonic 11 at 440 Hz";
    assert!(check("kinematic", 40.0, free(11), 5e-5, 1000.0).unwrap_err().starts_with(too_fast));
    assert_eq!(check("kinematic", 40.0, free(11), 4e-5, 1000.0), Ok(()));
    let filtered = check("dynamic", 60.0, free(16), 1e-6, 900.0).unwrap_err();
    assert!(filtered.contains("expected up to 900.0 Hz (the low-pass") && filtered.ends_with("960 Hz"), "{filtered}");
    assert_eq!(check("kinematic", 60.0, free(16), 1e-6, 900.0), Ok(()));
    let sampled = check("dynamic", 200.0, free(14), 1e-6, 4000.0).unwrap_err();
    assert!(sampled.contains("expected up to 2500.0 Hz (4 samples") && sampled.ends_with("2800 Hz"), "{sampled}");
    let base = check("kinematic", 201.0, pump.clone(), 5e-5, 1000.0).unwrap_err();
    assert!(
        base.starts_with("base_hz: expected up to 400.0 Hz") && base.ends_with(", found harmonic 2 at 402 Hz"),
        "{base}"
    );
    let slow = check("dynamic", 17.0, pump.clone(), 5e-5, 1000.0).unwrap_err();
    assert!(
        slow.starts_with("base_hz: expected above 17, the rig's highest resonance") && slow.ends_with(", found 17"),
        "{slow}"
    );
    assert_eq!(check("kinematic", 17.0, pump, 5e-5, 1000.0), Ok(()));
}
