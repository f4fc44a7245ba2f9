//! Libraries that are submitted with a job.

use serde_json::{Value, json};

use super::*;
use upm_runner::config::Diagnostic;

fn asked(test_plates: &TestPlates, allow: bool, change: impl FnOnce(&mut Value)) -> Result<(), Diagnostic> {
    let plates = test_plates.open_with(None, |around| around.allow_inline_libraries = allow);
    let mut job: Value = serde_json::from_str(TWO_COINS).unwrap();
    job["library"] = serde_json::from_str(&library().to_json()).unwrap();
    change(&mut job["library"]);
    let made = plates.get("one").unwrap().validate(&job.to_string(), Pace::Max, None);
    made.map(|_| ()).map_err(|faults| faults.into_iter().next().unwrap())
}

fn reverse_entries(library: &mut Value) {
    for entry in library["entries"].as_array_mut().unwrap() {
        entry["velocity_mm_s"].as_array_mut().unwrap().iter_mut().for_each(reverse);
        reverse(&mut entry["spin_rad_s"]);
    }
}

fn reverse_fields(library: &mut Value) {
    for harmonic in library["fields"]["twist_from_counts"].as_array_mut().unwrap() {
        for answer in harmonic.as_array_mut().unwrap().iter_mut().flat_map(|row| row.as_array_mut().unwrap()) {
            answer.as_array_mut().unwrap().iter_mut().for_each(reverse);
        }
    }
}

fn reverse(number: &mut Value) {
    *number = json!(-number.as_f64().unwrap());
}

#[test]
fn inline_library_equal_to_the_plates_own_is_accepted() {
    assert_eq!(asked(&TestPlates::new(), false, |_| {}), Ok(()));
}

#[test]
fn inline_library_with_reversed_signs_is_refused_with_its_path() {
    let fault = asked(&TestPlates::new(), false, reverse_entries).unwrap_err();
    assert_eq!((&*fault.file, fault.path.as_str()), ("job: library", "entries[0]"), "{fault}");
    let fault = asked(&TestPlates::new(), false, reverse_fields).unwrap_err();
    assert_eq!(fault.path, "fields.twist_from_counts[0][0]", "{fault}");
    assert_eq!(fault.to_string().lines().count(), 1, "{fault}");
}

#[test]
fn inline_library_with_reversed_signs_is_accepted_where_the_file_allows_it() {
    assert_eq!(asked(&TestPlates::new(), true, reverse_entries), Ok(()));
}
