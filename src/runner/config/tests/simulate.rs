use serde_json::{Value, json};

use super::{job, lines, origin, set, value_of};
use crate::config::{Diagnostic, SimulateSpec};
use upm_core::geometry::{Twist, Vec2};
use upm_core::job::PlateMode;
use upm_core::signal::{Envelope, TwistHarmonic};

fn experiment() -> Value {
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

#[test]
fn points_are_accepted_in_experiments_only() {
    let with_point = |mut document: Value, diameter_mm: f64| {
        document["rig"] = value_of("rigs/upm-1.json");
        document["rig"]["kinds"]["point"] = json!({"diameter_mm": diameter_mm, "mass_g": 2.5, "thickness_mm": 1.5});
        document["parts"][0]["kind"] = json!("point");
        document
    };
    for diameter_mm in [0.0, 0.01] {
        let spec = read(&with_point(experiment(), diameter_mm)).unwrap();
        assert_eq!(spec.parts[0].params.radius_m, 0.5e-3 * diameter_mm);
        let faults = lines(job(&with_point(value_of("plus-sign.json"), diameter_mm)).unwrap_err());
        let refused = "parts[0].kind: expected 1 mm or more";
        assert!(faults.len() == 1 && faults[0].starts_with(refused), "{faults:?}");
    }
    assert!(job(&with_point(value_of("plus-sign.json"), 1.0)).is_ok());
}

#[test]
fn impossible_experiments_are_faults() {
    for (pointer, value, at, allowed) in [
        ("/pulses/0/rotation", json!(0), "pulses[0].rotation", "-1 or 1"),
        ("/pulses/0/rotation", json!(3_000_000_000_u64), "pulses[0].rotation", "-1 or 1"),
        ("/rig", json!(3), "rig", "a path or a rig object"),
        ("/pulses/0/speed_mps", json!(1), "pulses[0]", "cor_mm and omega_rad_s, or direction_deg and speed_mps"),
        ("/pulses/0/harmonics", json!([{"cos": [1, 0, 0]}]), "pulses[0]", "or harmonics"),
        ("/pulses/0/harmonics", json!([]), "pulses[0].harmonics", "1 to 16 items"),
        ("/pulses/0/harmonics", json!(vec![json!({}); 17]), "pulses[0].harmonics", "1 to 16 items"),
        ("/pulses/0/harmonics", json!([{}, {"sin": [0, 0, 0]}]), "pulses[0].harmonics", "an amplitude other than 0"),
        ("/pulses/0/harmonics", json!([{"cos": [1, 0]}]), "pulses[0].harmonics[0].cos", "a list of 3 items"),
        ("/pulses/0/harmonics", json!([{"cos": [1, 0, 1e9]}]), "pulses[0].harmonics[0].cos[2]", "from -1000 to 1000"),
        ("/pulses/0/harmonics", json!([{"tan": 1}]), "pulses[0].harmonics[0].tan", "cos, sin"),
        ("/base_hz", json!(0), "base_hz", "from 1 to 1000"),
        ("/pulses/0/omega_rad_s", json!(0), "pulses[0].omega_rad_s", "above 0"),
        ("/pulses/1/sustain", json!(0), "pulses[1].sustain", "did you mean sustain_s?"),
        ("/parts/0/position_mm/0", json!(103), "parts[0].position_mm[0]", "its centre on the plate"),
        ("/parts/0/position_mm", json!([-40, 10]), "parts[1].position_mm", "parts cannot overlap"),
        ("/parts/1/kind", json!("dim"), "parts[1].kind", "did you mean dime?"),
        ("/plate", json!("static"), "plate", "dynamic, kinematic"),
    ] {
        let mut document = experiment();
        set(&mut document, pointer, value);
        let faults = lines(read(&document).unwrap_err());
        let found =
            faults.iter().any(|fault| fault.starts_with(&format!("{at}: expected ")) && fault.contains(allowed));
        assert!(found, "{pointer}: {faults:?}");
    }
    let mut document = experiment();
    set(&mut document, "/sample_hz", json!(100_000));
    set(&mut document, "/pulses/0/sustain_s", json!(60));
    assert!(lines(read(&document).unwrap_err())[0].starts_with("sample_hz: expected "));
}
