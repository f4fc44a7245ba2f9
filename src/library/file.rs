use std::fmt::Write as _;
use std::path::Path;

use serde::Serialize;

use super::{Library, LibraryFault, RawLibrary};

impl Library {
    /// The file form: JSON, millimetres, one entry and one row of the displacement a line.
    ///
    /// Numbers are rounded to what can be measured; what is read back is written out the same again, byte for byte.
    pub fn to_json(&self) -> String {
        let raw = RawLibrary::from(self);
        let mut out = String::from("{\n");
        for (key, value) in [("rig", json(&raw.rig)), ("fingerprint", json(&raw.fingerprint))] {
            let _ = writeln!(out, "  \"{key}\": {value},");
        }
        for (key, value) in [("base_hz", raw.base_hz), ("attack_s", raw.attack_s), ("rest_s", raw.rest_s)] {
            let _ = writeln!(out, "  \"{key}\": {},", json(&value));
        }
        let _ = writeln!(out, "  \"shapes\": {},", json(&raw.shapes));
        let _ = writeln!(out, "  \"entries\": [\n{}\n  ],", lines(&raw.entries));
        let displacement = &raw.displacement;
        let _ = writeln!(out, "  \"displacement\": {{");
        let _ = writeln!(out, "  \"speed_mm_s\": {},", json(&displacement.speed_mm_s));
        let _ = writeln!(out, "  \"sustain_s\": {},", json(&displacement.sustain_s));
        let _ = writeln!(out, "  \"distance_mm\": [\n{}\n  ],", lines(&displacement.distance_mm));
        let _ = writeln!(out, "  \"sd_mm\": [\n{}\n  ]\n  }}\n}}", lines(&displacement.sd_mm));
        out
    }

    /// Reads [`Self::to_json`]; `file` is named in the faults, of which all are told.
    pub fn from_json(text: &str, file: &str) -> Result<Self, Vec<LibraryFault>> {
        let reader = &mut serde_json::Deserializer::from_str(text);
        let raw: RawLibrary =
            serde_path_to_error::deserialize(reader).map_err(|error| vec![unreadable(&error, file)])?;
        Self::try_from(raw).map_err(|faults| faults.into_iter().map(|fault| fault.in_file(file)).collect())
    }

    /// Writes the library to `path`.
    pub fn save(&self, path: &Path) -> std::io::Result<()> {
        std::fs::write(path, self.to_json())
    }

    /// Reads and validates the library at `path`; all faults are told.
    pub fn load(path: &Path) -> Result<Self, Vec<LibraryFault>> {
        let file = path.display().to_string();
        let text = std::fs::read_to_string(path)
            .map_err(|error| vec![LibraryFault::new("$", error, "a readable file").in_file(&file)])?;
        Self::from_json(&text, &file)
    }
}

/// JSON of plain data; these types have no way to fail.
fn json(value: &impl Serialize) -> String {
    serde_json::to_string(value).unwrap_or_default()
}

fn lines(values: &[impl Serialize]) -> String {
    values.iter().map(|value| format!("    {}", json(value))).collect::<Vec<_>>().join(",\n")
}

/// serde's message, parted where it says what it expected.
fn unreadable(error: &serde_path_to_error::Error<serde_json::Error>, file: &str) -> LibraryFault {
    let message = error.inner().to_string();
    let (found, allowed) =
        message.split_once(", expected ").unwrap_or((&message, "a library as `upm calibrate` writes it"));
    LibraryFault::new(error.path().to_string(), found, allowed).in_file(file)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::Twist;
    use crate::library::{AxisShape, DisplacementModel, Entry};
    use proptest::prelude::*;

    fn library(entries: Vec<Entry>) -> Library {
        Library {
            rig: "bench".into(),
            fingerprint: "12ab".into(),
            base_radps: std::f64::consts::TAU * 60.0,
            attack_s: 0.01,
            rest_s: 0.03,
            shapes: [AxisShape::FREE_MASS; 3],
            entries,
            displacement: DisplacementModel {
                speed_mps: vec![0.1, 0.5],
                sustain_s: vec![0.0, 0.1, 0.2],
                distance_m: vec![vec![0.0001, 0.004, 0.009], vec![0.0001, 0.006, 0.018]],
                sd_m: vec![vec![0.0; 3]; 2],
            },
        }
    }

    fn three() -> Vec<Entry> {
        [Twist::new(0.5, 0.0, 0.0), Twist::new(0.0, 0.5, 0.0), Twist::new(0.1, 0.0, 8.0)]
            .map(|pump| Entry { amplitudes: [100, -100, 0, 0], pump })
            .to_vec()
    }

    fn entry() -> impl Strategy<Value = Entry> {
        (any::<[i32; 4]>(), -2.0..2.0f64, -2.0..2.0f64, -20.0..20.0f64)
            .prop_map(|(amplitudes, vx, vy, spin)| Entry { amplitudes, pump: Twist::new(vx, vy, spin) })
    }

    proptest! {
        #[test]
        fn comes_back_from_its_file(more in proptest::collection::vec(entry(), 0..20), base_hz in 10.0..200.0f64) {
            let entries = three().into_iter().chain(more).collect();
            let saved = Library { base_radps: std::f64::consts::TAU * base_hz, ..library(entries) };
            let text = saved.to_json();
            let read = Library::from_json(&text, "l.json").unwrap();
            for (a, b) in saved.entries.iter().zip(&read.entries) {
                prop_assert_eq!(a.amplitudes, b.amplitudes);
                let off = a.pump - b.pump;
                prop_assert!(off.velocity_mps.norm() < 1e-6 && off.spin_radps.abs() <= 0.51e-5);
            }
            prop_assert!((saved.base_radps - read.base_radps).abs() < 1e-5);
            prop_assert_eq!(saved.entries.len(), read.entries.len());
            prop_assert_eq!(read.to_json(), text, "reading and writing again changes no byte");
        }
    }

    #[test]
    fn one_entry_a_line() {
        let text = library(three()).to_json();
        let line = r#"    {"amplitudes":[100,-100,0,0],"velocity_mm_s":[100.0,0.0],"spin_rad_s":8.0}"#;
        assert!(text.lines().any(|l| l == line), "{text}");
    }

    #[test]
    fn every_fault_is_told_on_a_line() {
        let mut bad = library(three());
        bad.displacement.speed_mps.swap(0, 1);
        bad.displacement.sd_m.pop();
        bad.rest_s = -1.0;
        bad.entries[1].pump = Twist::ZERO;
        let faults = Library::from_json(&bad.to_json(), "l.json").unwrap_err();
        let told: Vec<String> = faults.iter().map(ToString::to_string).collect();
        assert_eq!(
            told,
            [
                "l.json: rest_s: found -1, allowed: a number not below 0",
                "l.json: entries[1]: found a plate that does not move, allowed: a velocity or a spin",
                "l.json: displacement.speed_mm_s[1]: found 100 after 500, allowed: at least 2 rising numbers above 0",
                "l.json: displacement.sd_mm: found 1 rows, allowed: 2, one for each speed",
            ]
        );
    }

    #[test]
    fn foreign_keys_and_types_are_told_with_their_path() {
        let text = library(three()).to_json();
        let wrong = text.replacen("\"spin_rad_s\":8.0", "\"spin_rad_s\":\"fast\"", 1);
        let told = Library::from_json(&wrong, "l.json").unwrap_err()[0].to_string();
        assert!(
            told.starts_with("l.json: entries[2].spin_rad_s: found invalid type: string \"fast\", allowed: f64"),
            "{told}"
        );
        let more = text.replacen("\"rest_s\"", "\"color\": 1, \"rest_s\"", 1);
        assert!(Library::from_json(&more, "l.json").unwrap_err()[0].found.contains("unknown field `color`"));
        let huge = text.replacen("[100,", "[3000000000,", 1);
        assert!(Library::from_json(&huge, "l.json").unwrap_err()[0].path.starts_with("entries[0].amplitudes"));
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
        assert_eq!(library.check_fits("bench", "12ab"), Ok(()));
        assert_eq!(library.check_fits("other", "12ab").unwrap_err().path, "rig");
        assert_eq!(library.check_fits("bench", "34cd").unwrap_err().path, "fingerprint");
    }

    #[test]
    fn goes_through_a_file() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("library.json");
        library(three()).save(&path).unwrap();
        let read = Library::load(&path).unwrap();
        assert_eq!(read, Library::from_json(&library(three()).to_json(), "l.json").unwrap());
        assert_eq!(read.entries.len(), 3);
        let missing = Library::load(&folder.path().join("none.json")).unwrap_err();
        assert_eq!(missing[0].allowed, "a readable file");
    }
}
