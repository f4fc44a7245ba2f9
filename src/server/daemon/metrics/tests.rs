use std::collections::BTreeSet;
use std::path::PathBuf;
use std::time::Duration;

use super::text;
use crate::daemon::status::Observed;
use crate::store::StoreFault;

/// All samples of one metric, as a strict OpenMetrics parser reads them.
#[derive(Debug)]
struct ParsedMetrics {
    name: String,
    kind: String,
    unit: Option<String>,
    samples: Vec<(Vec<(String, String)>, f64)>,
}

impl ParsedMetrics {
    fn value(&self, labels: &[(&str, &str)]) -> Option<f64> {
        let alike =
            |own: &[(String, String)]| own.iter().map(|(k, v)| (k.as_str(), v.as_str())).eq(labels.iter().copied());
        self.samples.iter().find(|(own, _)| alike(own)).map(|(_, value)| *value)
    }
}

fn is_name(name: &str) -> bool {
    let is_start = |c: char| c.is_ascii_alphabetic() || c == '_';
    name.starts_with(is_start) && name.chars().all(|c| is_start(c) || c.is_ascii_digit())
}

/// Parses `k="v",...}`; returns the labels and the text after them.
fn labels_of(mut text: &str) -> (Vec<(String, String)>, &str) {
    let mut labels = Vec::new();
    loop {
        let (name, rest) = text.split_once("=\"").unwrap();
        assert!(is_name(name), "{name}");
        let (mut value, mut chars) = (String::new(), rest.char_indices());
        let end = loop {
            match chars.next().unwrap() {
                (_, '\\') => value.push(match chars.next().unwrap().1 {
                    'n' => '\n',
                    c @ ('\\' | '"') => c,
                    c => panic!("\\{c} is no escape"),
                }),
                (at, '"') => break at,
                (_, c) => value.push(c),
            }
        };
        labels.push((name.to_owned(), value));
        match rest[end + 1..].split_at(1) {
            (",", more) => text = more,
            ("}", more) => return (labels, more),
            (other, _) => panic!("{other} after a label"),
        }
    }
}

fn sample_of(line: &str, family: &ParsedMetrics) -> (Vec<(String, String)>, f64) {
    let suffix = match family.kind.as_str() {
        "counter" => "_total",
        "info" => "_info",
        _ => "",
    };
    let rest = line.strip_prefix(&family.name).and_then(|rest| rest.strip_prefix(suffix));
    let rest = rest.unwrap_or_else(|| panic!("{line} stands among {}{suffix}", family.name));
    let (labels, rest) = rest.strip_prefix('{').map_or((Vec::new(), rest), labels_of);
    let value: f64 = rest.strip_prefix(' ').unwrap().parse().unwrap();
    assert!(family.kind != "counter" || (value >= 0.0 && !rest.contains('.')), "{line}");
    assert!(family.kind != "info" || value == 1.0, "{line}");
    (labels, value)
}

/// Parses OpenMetrics text; panics where the standard is violated.
fn read(text: &str) -> Vec<ParsedMetrics> {
    let body = text.strip_suffix("# EOF\n").expect("the end is marked");
    let mut families: Vec<ParsedMetrics> = Vec::new();
    let mut lines = body.lines().peekable();
    while let Some(line) = lines.next() {
        let (name, help) = line.strip_prefix("# HELP ").unwrap_or_else(|| panic!("{line}")).split_once(' ').unwrap();
        assert!(is_name(name) && !help.is_empty() && !help.contains(['\\', '"']), "{line}");
        let kind = lines.next().and_then(|line| line.strip_prefix(&format!("# TYPE {name} "))).unwrap();
        assert!(["gauge", "counter", "info"].contains(&kind), "{kind}");
        assert!(!["_total", "_info", "_count", "_sum"].iter().any(|suffix| name.ends_with(suffix)), "{name}");
        let unit = lines.peek().and_then(|line| line.strip_prefix("# UNIT ")).map(|line| {
            let (of, unit) = line.split_once(' ').unwrap();
            assert!(of == name && name.ends_with(&format!("_{unit}")), "{line}");
            unit.to_owned()
        });
        lines.next_if(|_| unit.is_some());
        let mut family = ParsedMetrics { name: name.to_owned(), kind: kind.to_owned(), unit, samples: Vec::new() };
        while let Some(line) = lines.next_if(|line| !line.starts_with('#')) {
            family.samples.push(sample_of(line, &family));
        }
        families.push(family);
    }
    let names: BTreeSet<&str> = families.iter().map(|family| family.name.as_str()).collect();
    assert_eq!(names.len(), families.len(), "no name twice");
    for family in &families {
        let labels: BTreeSet<_> = family.samples.iter().map(|(labels, _)| labels).collect();
        assert_eq!(labels.len(), family.samples.len(), "{}: no labels twice", family.name);
    }
    families
}

fn of<'a>(families: &'a [ParsedMetrics], name: &str) -> &'a ParsedMetrics {
    families.iter().find(|family| family.name == name).unwrap_or_else(|| panic!("{name} is missing"))
}

/// Name, type, unit and labels of every metric against the golden file. `UPM_REMAKE_GOLDEN=1` rewrites that file.
#[test]
fn names_types_units_and_labels_stay() {
    let families = read(&text(&Observed::healthy()));
    let line_of = |family: &ParsedMetrics| {
        let labels: Vec<&str> = family.samples[0].0.iter().map(|(name, _)| name.as_str()).collect();
        let unit = family.unit.as_deref().unwrap_or("-");
        format!("{} {} {unit} {{{}}}\n", family.name, family.kind, labels.join(","))
    };
    let lines: String = families.iter().map(line_of).collect();
    let file = PathBuf::from(concat!(env!("CARGO_MANIFEST_DIR"), "/../..")).join("tests/golden/metrics.txt");
    if std::env::var_os("UPM_REMAKE_GOLDEN").is_some() {
        std::fs::write(&file, &lines).unwrap();
    }
    assert_eq!(lines, std::fs::read_to_string(&file).unwrap());
}

#[test]
fn metrics_equal_the_observed_values() {
    let families = read(&text(&Observed::healthy()));
    let value = |name: &str, labels: &[(&str, &str)]| of(&families, name).value(labels);
    assert_eq!(value("upm_uptime_seconds", &[]), Some(61.5));
    assert_eq!(value("upm_plate_state", &[("plate", "left"), ("state", "running")]), Some(1.0));
    assert_eq!(value("upm_plate_state", &[("plate", "left"), ("state", "stopped")]), Some(0.0));
    assert_eq!(of(&families, "upm_plate_state").samples.len(), 8);
    assert_eq!(value("upm_queue_jobs", &[("plate", "right")]), Some(2.0));
    assert_eq!(value("upm_jobs", &[("plate", "gone"), ("state", "failed")]), Some(1.0));
    assert_eq!(value("upm_deadline_misses", &[("plate", "left")]), Some(3.0));
    assert_eq!(value("upm_behind_seconds", &[("plate", "left")]), Some(1.5));
    assert_eq!(value("upm_frame_age_seconds", &[("plate", "left")]), Some(0.015));
    assert_eq!(value("upm_frame_age_seconds", &[("plate", "right")]), None, "it has shown nothing yet");
    assert_eq!(value("upm_recording_bytes", &[("plate", "left")]), Some(4096.0));
    assert_eq!(value("upm_disk_free_bytes", &[]), Some(5e9));
    assert_eq!(value("upm_event_streams", &[]), Some(5.0));
    assert_eq!((value("upm_healthy", &[]), value("upm_ready", &[])), (Some(1.0), Some(1.0)));
}

#[test]
fn unknown_values_are_omitted_and_odd_names_read_back() {
    let mut observed = Observed::healthy();
    observed.store.free_bytes = None;
    observed.plates[1].name = "a\\b\"c\nd,e}=".to_owned();
    observed.store.fault = Some(StoreFault::Full);
    observed.store.heartbeat = Duration::from_secs(60);
    let families = read(&text(&observed));
    assert!(!families.iter().any(|family| family.name == "upm_disk_free_bytes"));
    assert_eq!(of(&families, "upm_queue_jobs").value(&[("plate", "a\\b\"c\nd,e}=")]), Some(2.0));
    let flags = ["upm_store_writable", "upm_healthy", "upm_ready"].map(|name| of(&families, name).value(&[]));
    assert_eq!(flags, [Some(0.0); 3]);
}
