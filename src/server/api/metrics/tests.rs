use std::path::PathBuf;
use std::time::Duration;

use super::text;
use crate::api::health::Observed;
use crate::store::StoreError;

/// Name, type, unit and labels of the metric whose text begins with its name and its help.
fn line_of(metric: &str) -> String {
    let name = metric.split(' ').next().unwrap();
    let field = |of: &str| metric.lines().find_map(|line| line.strip_prefix(&format!("# {of} {name} ")));
    let sample = metric.lines().skip(1).find(|line| line.starts_with(name)).unwrap();
    let labels = sample.split_once('{').and_then(|(_, rest)| rest.split_once('}')).map_or("", |(labels, _)| labels);
    let labels: Vec<&str> = labels.split(',').map(|label| label.split('=').next().unwrap()).collect();
    format!("{name} {} {} {{{}}}\n", field("TYPE").unwrap(), field("UNIT").unwrap_or("-"), labels.join(","))
}

/// Name, type, unit and labels of every metric against the golden file. `UPM_REMAKE_GOLDEN=1` rewrites that file.
#[test]
fn names_types_units_and_labels_stay() {
    let lines: String = text(&Observed::healthy()).split("# HELP ").skip(1).map(line_of).collect();
    let file = PathBuf::from(concat!(env!("CARGO_MANIFEST_DIR"), "/../..")).join("tests/golden/metrics.txt");
    if std::env::var_os("UPM_REMAKE_GOLDEN").is_some() {
        std::fs::write(&file, &lines).unwrap();
    }
    assert_eq!(lines, std::fs::read_to_string(&file).unwrap());
}

#[test]
fn metrics_equal_the_observed_values() {
    let text = text(&Observed::healthy());
    for line in [
        "upm_uptime_seconds 61.5",
        "upm_plate_state{plate=\"left\",state=\"running\"} 1.0",
        "upm_plate_state{plate=\"left\",state=\"stopped\"} 0.0",
        "upm_queue_jobs{plate=\"right\"} 2.0",
        "upm_jobs{plate=\"gone\",state=\"failed\"} 1.0",
        "upm_deadline_misses_total{plate=\"left\"} 3",
        "upm_behind_seconds{plate=\"left\"} 1.5",
        "upm_frame_age_seconds{plate=\"left\"} 0.015",
        "upm_recording_bytes{plate=\"left\"} 4096.0",
        "upm_disk_free_bytes 5000000000.0",
        "upm_healthy 1.0",
        "upm_ready 1.0",
    ] {
        assert!(text.lines().any(|of| of == line), "{line}: {text}");
    }
    assert!(!text.contains("upm_frame_age_seconds{plate=\"right\"}"), "it has shown nothing yet");
}

#[test]
fn unknown_values_are_omitted_and_odd_names_escaped() {
    let mut observed = Observed::healthy();
    observed.counted.free_bytes = None;
    observed.plates[1].name = "a\\b\"c\nd".to_owned();
    observed.store_fault = Some(StoreError::Full);
    observed.store_silence = Duration::from_secs(60);
    let text = text(&observed);
    assert!(!text.contains("upm_disk_free"));
    for line in
        [r#"upm_queue_jobs{plate="a\\b\"c\nd"} 2.0"#, "upm_store_writable 0.0", "upm_healthy 0.0", "upm_ready 0.0"]
    {
        assert!(text.lines().any(|of| of == line), "{line}: {text}");
    }
}
