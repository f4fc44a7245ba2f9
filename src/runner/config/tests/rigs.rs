use std::f64::consts::TAU;

use serde_json::{Value, json};

use super::{rig, set, shipped, value_of};
use crate::config::{RigSpec, view};
use upm_core::geometry::Vec2;

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
    assert_eq!(quiet.document.simulation.knocks, None);
    set(&mut document, "/simulation/knocks", knocks(2.0, [13.0, -13.0]));
    let knocked = rig(&document).unwrap();
    let read = knocked.document.simulation.knocks.unwrap();
    assert_eq!((read.every_s, read.push_m), (2.0, Vec2::new(0.013, -0.013)));
    assert_eq!(knocked.fingerprint, quiet.fingerprint, "a knocked rig is the same rig");
}

fn knocks(every_s: f64, push_mm: [f64; 2]) -> Value {
    json!({"every_s": every_s, "push_mm": push_mm})
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
