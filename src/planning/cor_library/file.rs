use std::path::Path;

use super::Library;
use upm_core::document::{Diagnostic, Diagnostics, parse, read, text_of};

/// Lists and objects in each other down to which each member and item has its own line.
const DEPTH: usize = 2;

impl Library {
    /// The file format: JSON, millimetres, one line per entry.
    ///
    /// Numbers are rounded to the resolution of the measurement; a file that was read is written back byte for byte.
    pub fn to_json(&self) -> String {
        // serialising plain data cannot fail
        in_lines(&serde_json::to_string(self).unwrap_or_default())
    }

    /// Reads [`Self::to_json`].
    ///
    /// # Errors
    /// The faults, which name `file`. Text that is not JSON and a document of another kind are a single fault. All
    /// wrong keys, types and ranges are reported together; once those are right, all values that are inconsistent with
    /// others.
    pub fn from_json(text: &str, file: &str) -> Result<Self, Vec<Diagnostic>> {
        parse(text, file).and_then(|library: Self| library.checked(file))
    }

    /// As [`Self::from_json`], for a library within a document that is parsed.
    ///
    /// # Errors
    /// As [`Self::from_json`].
    pub fn from_value(value: &serde_json::Value, file: &str) -> Result<Self, Vec<Diagnostic>> {
        read(value, file, Diagnostics::of(file)).and_then(|library: Self| library.checked(file))
    }

    /// Reads and validates the library at `path`.
    ///
    /// # Errors
    /// The fault of [`text_of`], otherwise all faults of [`Self::from_json`].
    pub fn load(path: &Path) -> Result<Self, Vec<Diagnostic>> {
        let text = text_of(path)?;
        Self::from_json(&text, &path.display().to_string())
    }
}

/// Compact JSON with a line for each member of the file, and for each member or item of those.
fn in_lines(json: &str) -> String {
    let (mut lines, mut depth, mut in_text, mut escaped) = (String::with_capacity(2 * json.len()), 0, false, false);
    for c in json.chars() {
        in_text ^= c == '"' && !escaped;
        escaped = c == '\\' && !escaped;
        let (opens, closes) = (!in_text && matches!(c, '[' | '{'), !in_text && matches!(c, ']' | '}'));
        depth -= usize::from(closes);
        if closes && depth < DEPTH {
            lines = lines + "\n" + &"  ".repeat(depth);
        }
        lines.push(c);
        depth += usize::from(opens);
        if depth <= DEPTH && (opens || !in_text && c == ',') {
            lines = lines + "\n" + &"  ".repeat(depth);
        } else if depth <= DEPTH && !in_text && c == ':' {
            lines.push(' ');
        }
    }
    lines + "\n"
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cor_library::fields_tests::rig_of;
    use crate::cor_library::{DisplacementModel, Entry, PlateResponse, testing};
    use proptest::prelude::*;
    use std::f64::consts::TAU;
    use upm_core::geometry::Twist;
    use upm_core::rig::RigModel;
    use upm_core::signal::MotorArrangement;

    fn library(entries: Vec<Entry>) -> Library {
        let displacement = DisplacementModel {
            speed_mps: vec![0.1, 0.5],
            sustain_s: vec![0.0, 0.1, 0.2],
            distance_m: vec![vec![0.0001, 0.004, 0.009], vec![0.0001, 0.006, 0.018]],
            sd_m: vec![vec![0.0; 3]; 2],
        };
        Library { accelerometer_gain: [1.0, 0.99, 1.01, 1.0], entries, displacement, ..testing::library([]) }
    }

    fn three() -> Vec<Entry> {
        [Twist::new(0.5, 0.0, 0.0), Twist::new(0.0, 0.5, 0.0), Twist::new(0.1, 0.0, 8.0)]
            .map(|pump| Entry { amplitudes: [100, -100, 0, 0], pump })
            .to_vec()
    }

    fn entry() -> impl Strategy<Value = Entry> {
        (proptest::array::uniform3(-1000..1000_i32), -2.0..2.0f64, -2.0..2.0f64, -20.0..20.0f64)
            .prop_map(|([a, b, c], vx, vy, spin)| Entry { amplitudes: [a, b, c, 1001], pump: Twist::new(vx, vy, spin) })
    }

    proptest! {
        #[test]
        fn comes_back_from_its_file(
            more in proptest::collection::vec(entry(), 0..20), base_hz in 10.0..200.0f64, beside: bool,
            natural_hz in proptest::array::uniform3(0.1..10_000.0f64), damping_ratio in proptest::array::uniform3(0.0..10.0f64),
        ) {
            let motor_arrangement = MotorArrangement::ALL[usize::from(beside)];
            let entries = three().into_iter().chain(more).collect();
            let plate = PlateResponse { natural_radps: natural_hz.map(|hz| TAU * hz), damping_ratio };
            let saved = Library { base_radps: TAU * base_hz, motor_arrangement, plate: Some(plate), ..library(entries) };
            let text = saved.to_json();
            let read = Library::from_json(&text, "l.json").unwrap();
            for (a, b) in saved.entries.iter().zip(&read.entries) {
                prop_assert_eq!(a.amplitudes, b.amplitudes);
                let off = a.pump - b.pump;
                prop_assert!(off.velocity_mps.norm() < 1e-6 && off.spin_radps.abs() <= 0.51e-5);
            }
            prop_assert!((saved.base_radps - read.base_radps).abs() < 1e-5);
            prop_assert_eq!(saved.motor_arrangement, read.motor_arrangement);
            prop_assert_eq!(saved.entries.len(), read.entries.len());
            prop_assert_eq!(read.to_json(), text, "reading and writing again changes no byte");
            let plate = read.plate.unwrap();
            for axis in 0..3 {
                prop_assert!((plate.natural_radps[axis] / TAU - natural_hz[axis]).abs() < 0.51e-4);
                prop_assert!((plate.damping_ratio[axis] - damping_ratio[axis]).abs() < 0.51e-4);
            }
        }
    }

    fn fault_lines(text: &str) -> Vec<String> {
        let faults = Library::from_json(text, "l.json").unwrap_err();
        faults.iter().map(|fault| fault.to_string().replacen("l.json: ", "", 1)).collect()
    }

    #[test]
    fn each_fault_is_reported_on_its_own_line() {
        let mut bad = library(three());
        bad.displacement.speed_mps.swap(0, 1);
        bad.displacement.sd_m.pop();
        bad.entries[1].pump = Twist::ZERO;
        let faults = Library::from_json(&bad.to_json(), "l.json").unwrap_err();
        let lines: Vec<String> = faults.iter().map(ToString::to_string).collect();
        assert_eq!(
            lines,
            [
                "l.json: entries[1]: expected a velocity or a spin, found a plate that does not move",
                "l.json: displacement.speed_mm_s[1]: expected rising numbers above 0, found 100 after 500",
                "l.json: displacement.sd_mm: expected 2, one for each speed, found 1 row",
            ]
        );
    }

    #[test]
    fn foreign_keys_and_types_are_reported_with_their_path() {
        let text = library(three()).to_json();
        let wrong = text.replacen("\"spin_rad_s\":8.0", "\"spin_rad_s\":\"fast\"", 1);
        assert_eq!(
            fault_lines(&wrong),
            ["entries[2].spin_rad_s: expected a number from -10000 to 10000, found \"fast\""]
        );
        for (from, to, line) in [
            ("\"rest_s\": 0.03,", "", "rest_s: expected a number from 0 to 100, found nothing"),
            (
                "\"rest_s\"",
                "\"rig\": \"b\", \"rest_s\"",
                "rig: expected each key once, found the key \"rig\" a second time",
            ),
            (
                "[100,-100,0,0]",
                "[100,-100,0]",
                "entries[0].amplitudes: expected a list of 4 items (a whole number from -1000000 to 1000000 each), found a list of 3",
            ),
        ] {
            let changed = text.replacen(from, to, 1);
            assert_ne!(changed, text, "{from}");
            assert_eq!(fault_lines(&changed), [line]);
        }
    }

    #[test]
    fn one_direction_is_not_enough() {
        let line = (1..4).map(|k| Entry { pump: Twist::new(0.2 * f64::from(k), 0.0, 0.0), ..three()[0].clone() });
        let faults = Library::from_json(&library(line.collect()).to_json(), "l.json").unwrap_err();
        assert_eq!(faults[0].path, "entries");
    }

    #[test]
    fn another_rig_is_refused() {
        let library = library(three());
        let rig = rig_of(&library, 1000.0, None);
        let paths_of = |rig: &RigModel, fingerprint: &str| -> Vec<String> {
            library.check_fits(rig, fingerprint).into_iter().map(|fault| fault.path).collect()
        };
        let paths = |rig: &RigModel| paths_of(rig, "12ab");
        assert_eq!(paths(&rig), [""; 0]);
        let other = RigModel { name: "other".into(), ..rig.clone() };
        assert_eq!(paths(&other), [""; 0], "what was measured is the same");
        assert_eq!(paths_of(&RigModel { rest_s: 0.0, ..other }, "34cd"), ["rig"]);
        assert_eq!(paths_of(&rig, "34cd"), ["fingerprint"]);
        assert_eq!(paths(&RigModel { plate_side_m: 0.3, ..rig.clone() }), ["plate_side_mm"]);
        assert_eq!(paths(&RigModel { base_radps: 1.00001 * rig.base_radps, ..rig.clone() }), ["base_hz"]);
        let fault = &library.check_fits(&RigModel { base_radps: TAU * 50.0, ..rig.clone() }, "12ab")[0];
        assert_eq!((fault.found.as_str(), fault.expected.as_str()), ("60", "50, as the rig has it"));
        assert_eq!(paths(&RigModel { attack_s: 0.010_002, ..rig.clone() }), ["attack_s"]);
        let unrested = RigModel { rest_s: 0.0, ..rig.clone() };
        assert_eq!(paths_of(&unrested, "34cd"), ["fingerprint", "rest_s"]);
        let weak = RigModel { count_limit: 10.0, ..rig.clone() };
        assert_eq!(paths(&weak), [0, 1, 2].map(|i| format!("entries[{i}].amplitudes")));
    }

    #[test]
    fn a_rig_of_odd_numbers_fits_the_library_saved_for_it() {
        let saved = Library { attack_s: 0.012_345_678_9, base_radps: TAU * 60.123_456_78, ..library(three()) };
        let rig = rig_of(&saved, 1000.0, None);
        assert_eq!(Library::from_json(&saved.to_json(), "l.json").unwrap().check_fits(&rig, "12ab"), []);
    }

    #[test]
    fn numbers_beyond_any_rig_are_refused() {
        let refused = |change: &dyn Fn(&mut Library)| {
            let mut bad = library(three());
            change(&mut bad);
            fault_lines(&bad.to_json())
        };
        type Change = fn(&mut Library);
        fn plate(library: &mut Library) -> &mut PlateResponse {
            library.plate.insert(PlateResponse { natural_radps: [TAU * 5.0; 3], damping_ratio: [0.2; 3] })
        }
        let cases: [(Change, &str); 8] = [
            (|l| plate(l).natural_radps[1] = 0.0, "plate.natural_hz.y: expected a number from 0.1 to 10000, found 0"),
            (
                |l| plate(l).damping_ratio[2] = -0.1,
                "plate.damping_ratio.spin: expected a number from 0 to 10, found -0.1",
            ),
            (|l| l.shapes[2].0[1].sin = 1e300, "shapes.spin[1][1]: expected a number from -1000 to 1000, found 1e+300"),
            (|l| l.attack_s = 101.0, "attack_s: expected a number from 0 to 100, found 101"),
            (
                |l| l.entries[1].amplitudes[2] = -1_000_001,
                "entries[1].amplitudes[2]: expected a whole number from -1000000 to 1000000, found -1000001",
            ),
            (
                |l| l.entries[0].amplitudes = [7; 4],
                "entries[0].amplitudes: expected four that make a force or a torque, not all the same, found [7, 7, 7, 7]",
            ),
            (
                |l| l.entries[2].pump = Twist::new(0.0, 101.0, 0.0),
                "entries[2].velocity_mm_s[1]: expected a number from -100000 to 100000, found 101000",
            ),
            (
                |l| l.displacement.distance_m[1][2] = 1.5,
                "displacement.distance_mm[1][2]: expected a number from 0 to 1000, found 1500",
            ),
        ];
        for (change, line) in cases {
            assert_eq!(refused(&change), [line]);
        }
    }
}
