use proptest::prelude::*;
use serde_json::{Map, Value, json};

use super::traces::trace;
use super::{origin, text_of, value_of};
use crate::config::{DaemonSpec, Diagnostic, JobSpec, RigSpec, SimulateSpec, place_parts, trace_from_json};
use upm_core::random::Streams;

fn scalar() -> impl Strategy<Value = Value> {
    prop_oneof![
        Just(Value::Null),
        any::<bool>().prop_map(Value::from),
        any::<i64>().prop_map(Value::from),
        any::<u64>().prop_map(Value::from),
        prop_oneof![Just(0.0), Just(-1.0), Just(1e308), Just(-1e-308), any::<f64>()].prop_map(Value::from),
        prop_oneof![Just("penny".to_owned()), Just("\u{0}\n".to_owned()), ".{0,12}"].prop_map(Value::from),
    ]
}

fn anything() -> impl Strategy<Value = Value> {
    let keys = prop_oneof![
        Just("kind".to_owned()),
        Just("type".to_owned()),
        Just("task".to_owned()),
        Just("parts".to_owned()),
        Just("rig".to_owned()),
        Just("plate".to_owned()),
        "[a-z/~ ]{0,5}",
    ];
    scalar().prop_recursive(4, 32, 6, move |inner| {
        prop_oneof![
            proptest::collection::vec(inner.clone(), 0..6).prop_map(Value::from),
            proptest::collection::vec((keys.clone(), inner), 0..6).prop_map(|m| Value::Object(Map::from_iter(m))),
        ]
    })
}

/// JSON pointers of all values in a document.
pub(super) fn places(document: &Value, at: &str, out: &mut Vec<String>) {
    out.push(at.to_owned());
    for (key, member) in document.as_object().into_iter().flatten().filter(|(key, _)| !key.contains(['/', '~'])) {
        places(member, &format!("{at}/{key}"), out);
    }
    for (i, item) in document.as_array().into_iter().flatten().enumerate() {
        places(item, &format!("{at}/{i}"), out);
    }
}

/// A job with its rig written out, so that mutations reach all of it.
pub(super) fn whole(job: &str, rig: &str) -> Value {
    let mut document = value_of(job);
    document["rig"] = value_of(rig);
    document
}

pub(super) fn experiment() -> Value {
    json!({
        "rig": value_of("rigs/upm-1.json"), "plate": "kinematic",
        "parts": [{"kind": "penny", "position_mm": [40, 0]}],
        "pulses": [
            {"cor_mm": [0, 0], "omega_rad_s": 8, "sustain_s": 0.1},
            {"direction_deg": 90, "speed_mps": 0.05, "sustain_s": 0.1},
            {"harmonics": [{"cos": [0.1, 0, 1], "sin": [0, 0.1, 0]}, {"sin": [0, 0, 1]}], "sustain_s": 0.1}
        ],
    })
}

/// Reads `text` as every kind of document; a refusal has at least one fault, each on one line.
fn read(text: &str) -> Result<(), TestCaseError> {
    fn refused<T>(result: Result<T, Vec<Diagnostic>>) -> Result<Option<T>, TestCaseError> {
        match result {
            Ok(made) => Ok(Some(made)),
            Err(faults) => {
                prop_assert!(!faults.is_empty() && faults.len() <= 200);
                prop_assert!(faults.iter().all(|fault| !fault.to_string().contains(['\n', '\r'])));
                Ok(None)
            }
        }
    }
    refused(RigSpec::from_json(text, &origin()))?;
    refused(SimulateSpec::from_json(text, &origin()))?;
    refused(DaemonSpec::from_json(text, &origin()))?;
    refused(trace_from_json(text, "trace.json"))?;
    if let Some(job) = refused(JobSpec::from_json(text, &origin(), None))? {
        let placed = place_parts(&job, Streams::new(job.seed()));
        prop_assert!(placed.is_err() || placed.iter().flatten().all(|part| part.position_m.norm().is_finite()));
        prop_assert_eq!(JobSpec::from_json(&job.effective().to_string(), &origin(), None).unwrap().task, job.task);
    }
    Ok(())
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(300))]

    #[test]
    fn random_json_never_panics(document in anything()) {
        read(&document.to_string())?;
    }

    #[test]
    fn mutated_files_never_panic(
        which in 0..11_usize,
        changes in proptest::collection::vec((any::<prop::sample::Index>(), prop_oneof![scalar(), anything()]), 1..4),
    ) {
        let mut document = match which {
            0 => whole("plus-sign.json", "rigs/upm-1.json"),
            1 => whole("trajectories.json", "rigs/upm-2.json"),
            2 => value_of("rigs/upm-1.json"),
            3 => trace(),
            4 => whole("arrange-8.json", "rigs/upm-2.json"),
            5 => whole("sort-12.json", "rigs/upm-2.json"),
            6 => whole("bowtie-3.json", "rigs/upm-2.json"),
            7 => value_of("daemon.json"),
            8 => whole("letters-16.json", "rigs/upm-2.json"),
            9 => whole("ballet-8.json", "rigs/upm-2.json"),
            _ => experiment(),
        };
        for (index, value) in changes {
            let mut all = Vec::new();
            places(&document, "", &mut all);
            *document.pointer_mut(index.get(&all[..]).as_str()).unwrap() = value;
        }
        read(&document.to_string())?;
    }

    #[test]
    fn other_numbers_are_taken_or_refused_in_words(
        which in 0..5_usize,
        changes in proptest::collection::vec((any::<prop::sample::Index>(), prop_oneof![-200.0..200.0f64, -3.0..9.0f64, any::<f64>()]), 1..4),
    ) {
        let name = ["arrange-8", "sort-8", "sort-12", "ring-6", "bowtie-3"][which];
        let mut document = whole(&format!("{name}.json"), "rigs/upm-2.json");
        let mut all = Vec::new();
        places(&document, "", &mut all);
        all.retain(|place| !place.starts_with("/rig") && document.pointer(place).is_some_and(Value::is_number));
        for (index, value) in changes {
            let is_whole = value.fract() == 0.0 && value.abs() < 1e9;
            let value = if is_whole { json!(value as i64) } else { json!(value) };
            *document.pointer_mut(index.get(&all[..]).as_str()).unwrap() = value;
        }
        let job = JobSpec::from_json(&document.to_string(), &origin(), None);
        let faults = job.and_then(|job| place_parts(&job, Streams::new(job.seed())).map_err(|fault| vec![fault])).err();
        for fault in faults.iter().flatten().map(ToString::to_string) {
            let is_in_words = fault.contains(": expected ") && fault.contains(", found ") && !fault.contains('\n');
            prop_assert!(is_in_words, "{fault}");
        }
    }

    #[test]
    fn torn_text_never_panics(cut in any::<prop::sample::Index>(), byte in any::<char>()) {
        let mut text = text_of("trajectories.json");
        let places: Vec<usize> = text.char_indices().map(|(i, _)| i).collect();
        let at = *cut.get(&places);
        text.replace_range(at..=at, &byte.to_string());
        read(&text)?;
        read(&text[..at])?;
    }
}
