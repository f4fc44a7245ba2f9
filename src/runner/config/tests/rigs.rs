use std::f64::consts::TAU;

use serde_json::{Value, json};

use super::{lines, rig, set, shipped, value_of};
use crate::config::{RigSpec, view};
use upm_core::geometry::Vec2;
use upm_core::units::GRAVITY_MPS2;

#[test]
fn shipped_rigs_are_valid_and_framed() {
    for (name, px_per_mm) in [("rigs/upm-1.json", 4.4), ("rigs/upm-2.json", 2.9)] {
        let spec = RigSpec::load(&shipped(name)).unwrap();
        let (camera, side_m) = (&spec.sim.camera, spec.model.plate_side_m);
        let height = camera.size_px[1] as f64;
        assert!(view::margin_px(camera, side_m).unwrap() >= 0.03 * height, "{name}");
        let middle = Vec2::new(639.5, 511.5);
        let center = view::image_from_plate(camera, Vec2::zeros()).unwrap();
        assert!((center - middle).norm() < 0.02 * height, "{name}: {center}");
        let corners = view::plate_corners_m(side_m).map(|corner| view::image_from_plate(camera, corner).unwrap());
        let side_px = (corners[1] - corners[0]).norm();
        assert!((side_px / (side_m * 1e3) - px_per_mm).abs() < 0.05, "{name}: {side_px}");
        assert!(spec.model.dark_parts);
    }
}

#[test]
fn the_first_rig_is_weak_and_the_second_is_not() {
    let weak = RigSpec::load(&shipped("rigs/upm-1.json")).unwrap().model;
    let peak_mps2 = 2.0 * weak.count_limit * weak.newtons_per_count / weak.plate_mass_kg;
    assert!((peak_mps2 / GRAVITY_MPS2 - 2.0).abs() < 1e-6);
    assert!((weak.plate_inertia_kgm2 - 0.35 * 0.2032 * 0.2032 / 6.0).abs() < 1e-15);
    let strong = RigSpec::load(&shipped("rigs/upm-2.json")).unwrap().model;
    assert!((strong.count_limit * strong.newtons_per_count - 222.0).abs() < 1e-4);
}

/// Largest acceleration at any accelerometer channel: all motors at their limit, with the worst signs.
#[test]
fn accelerometers_are_not_driven_out_of_range() {
    for name in ["rigs/upm-1.json", "rigs/upm-2.json"] {
        let sim = RigSpec::load(&shipped(name)).unwrap().sim;
        let (force_n, plate) = (sim.motors.count_limit * sim.motors.newtons_per_count, sim.plate);
        let turn = sim.motors.lever_arm_m * sim.accelerometers.position_m.x.abs() / plate.inertia_kgm2;
        let push = 1.0 / plate.mass_kg;
        let worst_mps2 = force_n * (2.0 * turn + (push - turn).abs() + (push + turn).abs());
        assert!(worst_mps2 < sim.accelerometers.range_mps2, "{name}: {worst_mps2}");
    }
}

#[test]
fn fingerprint_depends_only_on_the_inputs_of_a_library() {
    let base = value_of("rigs/upm-1.json");
    let fingerprint = |pointer: &str, value: Value| {
        let mut document = base.clone();
        set(&mut document, pointer, value);
        rig(&document).unwrap().fingerprint
    };
    let unchanged = rig(&base).unwrap().fingerprint;
    assert_eq!(unchanged.len(), 16);
    assert!(unchanged.chars().all(|c| c.is_ascii_hexdigit()));
    for (pointer, value) in [
        ("/plate/mass_kg", json!(0.36)),
        ("/motors/count_limit", json!(500)),
        ("/drive/attack_s", json!(0.0123)),
        ("/accelerometers/bits", json!(12)),
    ] {
        assert_ne!(fingerprint(pointer, value), unchanged, "{pointer}");
    }
    for (pointer, value) in [
        ("/name", json!("other")),
        ("/friction/coefficient", json!(0.25)),
        ("/camera/blur_px", json!(0.5)),
        ("/simulation/step_s", json!(4e-5)),
        ("/library", json!("other.json")),
        ("/plate/inertia_kg_m2", json!(rig(&base).unwrap().model.plate_inertia_kgm2)),
        ("/drive/base_hz", json!(60.0)),
    ] {
        assert_eq!(fingerprint(pointer, value), unchanged, "{pointer}");
    }
}

#[test]
fn fingerprint_never_changes() {
    let fixed: Value = serde_json::from_str(include_str!("rig.json")).unwrap();
    assert_eq!(rig(&fixed).unwrap().fingerprint, "a349ad52b5a731ff", "libraries carry these: a change orphans them");
}

#[test]
fn knocks_are_read_and_leave_the_fingerprint() {
    let mut document = value_of("rigs/upm-1.json");
    let quiet = rig(&document).unwrap();
    assert_eq!(quiet.raw.simulation.knocks, None);
    set(&mut document, "/simulation/knocks", knocks(2.0, [13.0, -13.0]));
    let knocked = rig(&document).unwrap();
    let read = knocked.raw.simulation.knocks.unwrap();
    assert_eq!((read.every_s, read.push_mm), (2.0, [13.0, -13.0]));
    assert_eq!(knocked.fingerprint, quiet.fingerprint, "a knocked rig is the same rig");
}

fn knocks(every_s: f64, push_mm: [f64; 2]) -> Value {
    json!({"every_s": every_s, "push_mm": push_mm})
}

#[test]
fn impossible_rigs_are_faults() {
    for (pointer, value, at, allowed) in [
        ("/plate/side_mm", json!(0), "plate.side_mm", "from 20 to 2000"),
        ("/plate/inertia_kg_m2", json!(0.02), "plate.inertia_kg_m2", "all mass in the corners"),
        ("/plate/inertia_kg_m2", json!(0), "plate.inertia_kg_m2", "above 0"),
        ("/plate/resonance_hz/y", json!(60), "plate.resonance_hz.y", "below drive.base_hz, 60"),
        ("/motors/sample_hz", json!(480), "motors.sample_hz", "above 480 (four times the second harmonic)"),
        ("/motors/low_pass_hz", json!(120), "motors.low_pass_hz", "above 120 (the second harmonic must pass)"),
        ("/motors/lever_arm_mm", json!(110), "motors.lever_arm_mm", "up to 101.6"),
        ("/motors/gain_error", json!([0, 0, 0]), "motors.gain_error", "a list of 4 items"),
        ("/motors/gain_error/2", json!(0.9), "motors.gain_error[2]", "from -0.5 to 0.5"),
        ("/accelerometers/sample_hz", json!(900), "accelerometers.sample_hz", "960 or more (16 samples to a period"),
        ("/accelerometers/position_mm", json!([0, 1]), "accelerometers.position_mm", "from the centre"),
        ("/accelerometers/position_mm", json!([-92, 0]), "accelerometers.position_mm", "off both axes"),
        ("/accelerometers/position_mm/0", json!(150), "accelerometers.position_mm[0]", "on the plate"),
        ("/camera/exposure_s", json!(0.02), "camera.exposure_s", "below 0.016667 (one frame's period)"),
        ("/camera/position_mm/0", json!(90), "camera", "the whole plate in view"),
        ("/camera/position_mm/2", json!(-900), "camera.position_mm[2]", "101.6 or more"),
        ("/camera/size_px/0", json!(12.5), "camera.size_px[0]", "a whole number from 64 to 8192"),
        ("/camera/size_px", json!([8192, 8192]), "camera.size_px", "up to 64000000 px in all"),
        ("/camera/radial/0", json!(-20), "camera.radial", "one-to-one"),
        ("/camera/levels/part", json!(220), "camera.levels.part", "60 or more away from levels.plate, 225"),
        ("/camera/levels/part", json!(166), "camera.levels.part", "parts must stand out on the plate"),
        ("/camera/levels/ground", json!(240), "camera.levels.ground", "58.5 or more away from levels.plate, 225"),
        ("/camera/levels/ground", json!(185), "camera.levels.ground", "must stand out from the ground"),
        ("/drive/max_sustain_s", json!(0.02), "drive.max_sustain_s", "three periods"),
        ("/simulation/step_s", json!(5e-4), "simulation.step_s", "up to 0.0001"),
        ("/simulation/knocks", knocks(0.05, [1.0, 0.0]), "simulation.knocks.every_s", "from 0.1 to 1000"),
        ("/simulation/knocks", knocks(1.0, [0.0, -13.5]), "simulation.knocks.push_mm[1]", "from -13 to 13"),
        ("/simulation/knocks", knocks(1.0, [0.0, 0.0]), "simulation.knocks.push_mm", "a push along x or y"),
        ("/simulation/knocks", json!({"every_s": 1}), "simulation.knocks.push_mm", "a list of 2 items"),
        ("/kinds", json!({"penny": {"diameter_mm": 20, "mass_g": 2, "thickness_mm": 1}}), "kinds.penny", "other than"),
    ] {
        let mut document = value_of("rigs/upm-1.json");
        set(&mut document, pointer, value);
        let faults = lines(rig(&document).unwrap_err());
        let found =
            faults.iter().any(|fault| fault.starts_with(&format!("{at}: expected ")) && fault.contains(allowed));
        assert!(found, "{pointer}: {faults:?}");
    }
}

#[test]
fn synthesised_motions_are_checked_and_part_of_the_fingerprint() {
    let base = value_of("rigs/upm-2.json");
    let spec = rig(&base).unwrap();
    let fields = spec.model.fields.unwrap();
    assert_eq!((fields.base_radps, fields.harmonics), (TAU * 30.0, 8));
    assert_eq!((fields.attack_s, fields.rest_s), (0.066667, 0.04));
    assert_eq!(rig(&value_of("rigs/upm-1.json")).unwrap().model.fields, None);
    let mut none = base.clone();
    set(&mut none, "/fields", Value::Null);
    assert_eq!(rig(&none).unwrap().model.fields, None);
    assert_ne!(rig(&none).unwrap().fingerprint, spec.fingerprint);
    for (pointer, value, at, allowed) in [
        ("/fields/base_hz", json!(4), "fields.base_hz", "from 5 to 200"),
        ("/fields/base_hz", json!(7), "fields.base_hz", "above 7, the highest of plate.resonance_hz"),
        (
            "/fields/base_hz",
            json!(9),
            "fields.base_hz",
            "10.0000 or more (three periods within drive.max_sustain_s, 0.3)",
        ),
        ("/fields/harmonics", json!(1), "fields.harmonics", "from 2 to 16"),
        ("/fields/harmonics", json!(17), "fields.harmonics", "from 2 to 16"),
        ("/motors/low_pass_hz", json!(240), "fields.harmonics", "below 240 Hz"),
        ("/motors/sample_hz", json!(900), "fields.harmonics", "below 225 Hz (motors.low_pass_hz, a quarter of"),
        ("/accelerometers/sample_hz", json!(1800), "fields.harmonics", "below 225 Hz"),
        ("/fields/attack_s", json!(0.016), "fields.attack_s", "0.016667 or more (half a period of fields.base_hz)"),
        ("/fields/rest_s", json!(-1), "fields.rest_s", "from 0 to 5"),
    ] {
        let mut document = base.clone();
        set(&mut document, pointer, value);
        let faults = lines(rig(&document).unwrap_err());
        let found =
            faults.iter().any(|fault| fault.starts_with(&format!("{at}: expected ")) && fault.contains(allowed));
        assert!(found, "{pointer}: {faults:?}");
    }
}

#[test]
fn kinds_come_after_the_coins_by_name() {
    let mut document = value_of("rigs/upm-1.json");
    let token = json!({"diameter_mm": 30, "mass_g": 8, "thickness_mm": 2.5, "friction": 0.2});
    set(&mut document, "/kinds", json!({"token": token, "bead": {"diameter_mm": 8, "mass_g": 1, "thickness_mm": 3}}));
    let spec = rig(&document).unwrap();
    let names: Vec<&str> = spec.kinds.iter().map(|spec| spec.kind.name.as_str()).collect();
    assert_eq!(names, ["penny", "nickel", "dime", "quarter", "bead", "token"]);
    assert_eq!((spec.kinds[4].friction, spec.kinds[5].friction), (0.3, 0.2));
    assert_eq!((spec.kinds[5].kind.radius_m, spec.kinds[5].mass_kg), (0.015, 0.008));
    assert_eq!((spec.kinds[0].kind.radius_m, spec.kinds[0].mass_kg), (0.009525, 0.0025));
}
