use serde_json::{Value, json};

use super::{lines, origin, set};
use crate::config::{Fault, PlateMode, SimulateSpec};
use crate::geometry::{Twist, Vec2};
use crate::signal::Envelope;

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

fn read(document: &Value) -> Result<SimulateSpec, Vec<Fault>> {
    SimulateSpec::from_json(&document.to_string(), &origin())
}

#[test]
fn pulses_become_twists_and_envelopes() {
    let spec = read(&experiment()).unwrap();
    assert_eq!((spec.plate, spec.sample_hz), (PlateMode::Kinematic, 1000.0));
    assert_eq!(spec.pulses[0].envelope, Envelope { attack_s: 0.01, sustain_s: 0.1, rest_s: 0.03 });
    assert_eq!(spec.pulses[0].pump, Twist::about(Vec2::new(0.01, -0.02), -8.0));
    let (attack_s, rest_s) = (spec.rig.model.attack_s, spec.rig.model.rest_s);
    assert_eq!(spec.pulses[1].envelope, Envelope { attack_s, sustain_s: 0.2, rest_s });
    assert!((spec.pulses[1].pump.velocity_mps - Vec2::new(0.0, 0.05)).norm() < 1e-15);
    assert_eq!(spec.parts[0].position_m, Vec2::new(0.1, 0.0));
    assert_eq!((spec.parts[1].id.as_str(), spec.parts[1].params.friction), ("dime-1", 0.3));
}

#[test]
fn impossible_experiments_are_faults() {
    for (pointer, value, at, allowed) in [
        ("/pulses/0/rotation", json!(0), "pulses[0].rotation", "-1 or 1"),
        ("/pulses/0/rotation", json!(3_000_000_000_u64), "pulses[0].rotation", "-1 or 1"),
        ("/rig", json!(3), "rig", "a path or a rig object"),
        ("/pulses/0/speed_mps", json!(1), "pulses[0]", "cor_mm and omega_rad_s, or direction_deg and speed_mps"),
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
        let found = faults.iter().any(|fault| fault.starts_with(&format!("{at}: found ")) && fault.contains(allowed));
        assert!(found, "{pointer}: {faults:?}");
    }
    let mut document = experiment();
    set(&mut document, "/sample_hz", json!(100_000));
    set(&mut document, "/pulses/0/sustain_s", json!(60));
    assert!(lines(read(&document).unwrap_err())[0].starts_with("sample_hz: found "));
}
