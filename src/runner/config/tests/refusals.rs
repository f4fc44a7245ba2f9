//! Wrong values and the lines that refuse them, as recorded in `refusals.txt`: the name of a document, pointers into it
//! with the values put there, and below them, indented, what is said of it.

use std::fmt::Write as _;

use serde_json::{Value, json};

use super::{job, lines, origin, rig, set, simulate, traces, value_of};
use crate::config::{DaemonSpec, SimulateSpec, trace_from_json};

/// The document called `name`.
fn named(name: &str) -> Value {
    let with_rig = |rig: &str| {
        let mut job = value_of("plus-sign.json");
        set(&mut job, "/rig", value_of(rig));
        job
    };
    match name {
        "rig-1" => value_of("rigs/upm-1.json"),
        "rig-2" => value_of("rigs/upm-2.json"),
        "experiment" => simulate::experiment(),
        "trace" => traces::trace(),
        "daemon" => value_of("daemon.json"),
        "plus" => value_of("plus-sign.json"),
        "paths" => value_of("trajectories.json"),
        "hold" => value_of("hold-4.json"),
        "whole-1" => with_rig("rigs/upm-1.json"),
        "whole-2" => with_rig("rigs/upm-2.json"),
        _ => json!({"name": "a", "rig": "rigs/upm-2.json", "parts": [{"kind": "penny"}], "task": {"type": "hold"}}),
    }
}

/// Lines that refuse the document called `name` with these changes: `POINTER VALUE & POINTER VALUE`.
fn refusal(name: &str, changes: &str) -> Vec<String> {
    let mut document = named(name);
    for change in changes.split(" & ") {
        let (pointer, value) = change.split_once(' ').unwrap();
        set(&mut document, pointer, serde_json::from_str(value).unwrap());
    }
    let text = document.to_string();
    let refused = match name {
        "rig-1" | "rig-2" => rig(&document).err(),
        "experiment" => SimulateSpec::from_json(&text, &origin()).err(),
        "trace" => trace_from_json(&text, "trace.json").err(),
        "daemon" => DaemonSpec::from_json(&text, &origin()).err(),
        _ => job(&document).err(),
    };
    refused.map_or(vec!["accepted".to_owned()], lines)
}

/// `UPM_REMAKE_GOLDEN=1` writes the lines anew.
#[test]
fn wrong_values_are_refused_with_place_expected_and_found() {
    let recorded = include_str!("refusals.txt");
    let mut text = String::new();
    for line in recorded.lines().filter(|line| !line.starts_with(' ')) {
        let (name, changes) = line.split_once(' ').unwrap();
        writeln!(text, "{line}").unwrap();
        refusal(name, changes).iter().for_each(|said| writeln!(text, "  {said}").unwrap());
    }
    if std::env::var_os("UPM_REMAKE_GOLDEN").is_some() {
        std::fs::write(concat!(env!("CARGO_MANIFEST_DIR"), "/config/tests/refusals.txt"), &text).unwrap();
        return;
    }
    for (said, recorded) in text.lines().zip(recorded.lines()) {
        assert_eq!(said, recorded);
    }
    assert_eq!(text.len(), recorded.len());
}
