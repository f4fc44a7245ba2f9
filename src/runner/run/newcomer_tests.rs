//! Jobs as students, feeder engineers and operators write them first.

use serde_json::{Value, json};

use super::InMemoryRun;
use super::testing::job_in_configs;
use upm_core::job::{CameraMode, Outcome};
use upm_recording::Verdict;

/// Name, parts and task of each job, or its `tasks` with `repeat`.
fn jobs() -> [(&'static str, Value, Value); 10] {
    let arrange = |targets: Value| json!({"type": "arrange", "targets": targets});
    let bin =
        |left: i32, of: &str, what: Value| json!({of: what, "region_mm": {"min": [left, -70], "max": [left + 80, 70]}});
    let row = |i: i32, kind: &str, name: &str| json!({"kind": kind, "name": name, "position_mm": [30 * i - 75, 100]});
    [
        (
            "square",
            json!([{"kind": "penny", "count": 4}]),
            json!({"type": "arrange", "targets_mm": [[-40, -40], [40, -40], [40, 40], [-40, 40]]}),
        ),
        ("name", json!([{"kind": "dime", "count": 20}]), arrange(json!({"text": {"string": "Lea", "height_mm": 100}}))),
        (
            "two-kinds",
            json!([{"kind": "penny", "count": 6}, {"kind": "nickel", "count": 6}]),
            json!({"type": "sort", "bins": [bin(-110, "kinds", json!(["penny"])), bin(30, "kinds", json!(["nickel"]))]}),
        ),
        (
            "swap",
            json!([{"kind": "dime", "name": "a", "position_mm": [-30, 0]}, {"kind": "dime", "name": "b", "position_mm": [30, 0]}]),
            json!({"type": "arrange", "parts": ["a", "b"], "targets_mm": [[30, 0], [-30, 0]]}),
        ),
        (
            "round",
            json!([{"kind": "quarter"}]),
            json!({"type": "trajectories", "paths": [{"circle": {"radius_mm": 50}, "speed_mm_s": 10}]}),
        ),
        (
            "recipe",
            json!([{"kind": "penny", "count": 6}]),
            json!([
                arrange(json!({"line": {"from_mm": [-100, 0], "to_mm": [100, 0]}})), {"type": "hold", "duration_s": 2},
                arrange(json!({"circle": {"radius_mm": 60}})),
            ]),
        ),
        ("ring", json!([{"kind": "dime", "count": 12}]), arrange(json!({"circle": {"radius_mm": 90}}))),
        (
            "thirty",
            json!([{"kind": "dime", "count": 30}]),
            arrange(json!({"grid": {"rows": 5, "columns": 6, "spacing_mm": 22}})),
        ),
        (
            "reject",
            json!([
                row(0, "penny", "bent"),
                row(1, "penny", "p"),
                row(2, "dime", "d"),
                row(3, "penny", "q"),
                row(4, "dime", "e")
            ]),
            json!({"type": "sort", "bins": [
                bin(-120, "kinds", json!(["penny", "dime"])), bin(40, "parts", json!(["bent"])),
            ]}),
        ),
        ("hold", json!([{"kind": "nickel", "count": 6}]), json!({"type": "hold", "duration_s": 10})),
    ]
}

#[test]
#[ignore = "long: `cargo test -- --ignored` runs it"]
fn newcomers_jobs_are_done_whatever_the_seed() {
    let mut missed = Vec::new();
    for (name, parts, task) in jobs() {
        for seed in 1..=3 {
            let tasks = if task.is_array() { "tasks" } else { "task" };
            let job = json!({"name": name, "seed": seed, "rig": "rigs/upm-2.json", "parts": parts, tasks: task});
            let report = InMemoryRun::new(&job_in_configs(&job).with_camera(CameraMode::Positions)).unwrap().run();
            if (report.outcome, report.verdict) != (Outcome::Completed, Some(Verdict::True)) {
                missed.push(format!("{name}, seed {seed}: {}", report.reason));
            }
        }
    }
    assert!(missed.is_empty(), "{missed:#?}");
}
