use std::f64::consts::TAU;

use proptest::prelude::*;

use super::{DisplacementModel, Library, PlateResponse, testing};
use upm_core::geometry::Twist;

fn library(plate: Option<PlateResponse>) -> Library {
    let pumps = [Twist::new(0.5, 0.0, 0.0), Twist::new(0.0, 0.5, 0.0), Twist::new(0.1, 0.0, 8.0)];
    let displacement = DisplacementModel {
        speed_mps: vec![0.1, 0.5],
        sustain_s: vec![0.0, 0.1],
        distance_m: vec![vec![0.001, 0.004], vec![0.001, 0.006]],
        sd_m: vec![vec![0.0; 2]; 2],
    };
    Library { plate_side_m: 0.3, displacement, plate, ..testing::library(pumps) }
}

const PLATE: PlateResponse =
    PlateResponse { natural_radps: [TAU * 5.0, TAU * 6.25, TAU * 7.0], damping_ratio: [0.18, 0.2, 0.22] };

proptest! {
    #[test]
    fn plate_response_survives_its_file(
        natural_hz in proptest::array::uniform3(0.1..10_000.0f64), damping_ratio in proptest::array::uniform3(0.0..10.0f64),
    ) {
        let saved = library(Some(PlateResponse { natural_radps: natural_hz.map(|hz| TAU * hz), damping_ratio }));
        let text = saved.to_json();
        let read = Library::from_json(&text, "l.json").unwrap();
        prop_assert_eq!(read.to_json(), text, "a second save writes the same bytes");
        let plate = read.plate.unwrap();
        for axis in 0..3 {
            prop_assert!((plate.natural_radps[axis] / TAU - natural_hz[axis]).abs() < 0.51e-4);
            prop_assert!((plate.damping_ratio[axis] - damping_ratio[axis]).abs() < 0.51e-4);
        }
    }
}

#[test]
fn plate_response_is_one_line_of_the_file() {
    let text = library(Some(PLATE)).to_json();
    let line =
        r#"  "plate": {"natural_hz": {"x":5.0,"y":6.25,"spin":7.0}, "damping_ratio": {"x":0.18,"y":0.2,"spin":0.22}}"#;
    assert!(text.lines().any(|found| found == line), "{text}");
}

#[test]
fn library_without_plate_response_loads() {
    let text = library(None).to_json();
    assert!(!text.contains("\"plate\""), "{text}");
    assert_eq!(Library::from_json(&text, "l.json").unwrap().plate, None);
    let with_null = text.replacen("  \"rig\"", "  \"plate\": null,\n  \"rig\"", 1);
    assert_eq!(Library::from_json(&with_null, "l.json").unwrap(), Library::from_json(&text, "l.json").unwrap());
}

#[test]
fn values_out_of_range_are_rejected_with_their_path() {
    let rejected = |text: &str| -> Vec<String> {
        Library::from_json(text, "l").unwrap_err().iter().map(ToString::to_string).collect()
    };
    let with = |change: &dyn Fn(&mut PlateResponse)| {
        let mut plate = PLATE;
        change(&mut plate);
        rejected(&library(Some(plate)).to_json())
    };
    assert_eq!(
        with(&|plate| plate.natural_radps[1] = 0.0),
        ["l: plate.natural_hz.y: expected a number from 0.1 to 10000, found 0"]
    );
    assert_eq!(
        with(&|plate| plate.damping_ratio[2] = -0.1),
        ["l: plate.damping_ratio.spin: expected a number from 0 to 10, found -0.1"]
    );
    let text = library(Some(PLATE)).to_json();
    for (from, to, line) in [
        (",\"spin\":7.0", "", "l: plate.natural_hz.spin: expected a number, found nothing"),
        ("\"x\":5.0", "\"x\":\"low\"", "l: plate.natural_hz.x: expected a number, found \"low\""),
    ] {
        assert_eq!(rejected(&text.replacen(from, to, 1)), [line]);
    }
    assert_eq!(
        rejected(&text.replacen("\"natural_hz\"", "\"hz\"", 1)),
        [
            "l: plate.hz: expected one of damping_ratio, natural_hz, found unknown key \"hz\"",
            "l: plate.natural_hz: expected an object, found nothing",
        ]
    );
}
