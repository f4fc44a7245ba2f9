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
fn values_out_of_range_are_rejected_with_their_path() {
    for (change, line) in [
        (
            (|plate| plate.natural_radps[1] = 0.0) as fn(&mut PlateResponse),
            "natural_hz.y: expected a number from 0.1 to 10000, found 0",
        ),
        (|plate| plate.damping_ratio[2] = -0.1, "damping_ratio.spin: expected a number from 0 to 10, found -0.1"),
    ] {
        let mut plate = PLATE;
        change(&mut plate);
        let faults = Library::from_json(&library(Some(plate)).to_json(), "l").unwrap_err();
        assert_eq!(faults.iter().map(ToString::to_string).collect::<Vec<_>>(), [format!("l: plate.{line}")]);
    }
}
