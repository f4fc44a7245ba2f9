use proptest::prelude::*;
use serde_json::{Value, json};

use super::job;
use crate::config::{START_GAP_M, START_MARGIN_M, place_parts};
use upm_core::random::Streams;

fn mixed(parts: Value) -> Value {
    json!({"name": "m", "rig": "rigs/upm-2.json", "parts": parts, "task": {"type": "hold", "duration_s": 1}})
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    #[test]
    fn placed_parts_are_apart_and_inside(seed in any::<u64>(), pennies in 1..12_u32, quarters in 1..8_u32) {
        let parts = json!([
            {"kind": "penny", "count": pennies},
            {"kind": "dime", "position_mm": [140, -140]},
            {"kind": "quarter", "count": quarters},
        ]);
        let spec = job(&mixed(parts)).unwrap();
        let placed = place_parts(&spec, Streams::new(seed)).unwrap();
        prop_assert_eq!(&placed, &place_parts(&spec, Streams::new(seed)).unwrap());
        prop_assert_eq!(placed.len() as u32, pennies + 1 + quarters);
        let reach_m = 0.5 * spec.rig.model.plate_side_m - START_MARGIN_M;
        for (i, a) in placed.iter().enumerate() {
            if a.id == "dime-1" {
                prop_assert!((a.position_m * 1e3 - nalgebra::Vector2::new(140.0, -140.0)).norm() < 1e-9);
            } else {
                prop_assert!(a.position_m.amax() + a.params.radius_m <= reach_m + 1e-12);
            }
            prop_assert!((a.params.friction / 0.3 - 1.0).abs() <= 0.3 + 1e-12);
            for b in &placed[..i] {
                let gap_m = (a.position_m - b.position_m).norm() - a.params.radius_m - b.params.radius_m;
                prop_assert!(gap_m >= START_GAP_M);
            }
        }
    }
}

#[test]
fn ids_count_within_a_kind_in_job_order() {
    let parts = json!([{"kind": "penny", "count": 2}, {"kind": "dime"}, {"kind": "penny"}]);
    let placed = place_parts(&job(&mixed(parts)).unwrap(), Streams::new(1)).unwrap();
    let ids: Vec<&str> = placed.iter().map(|part| part.id.as_str()).collect();
    assert_eq!(ids, ["penny-1", "penny-2", "dime-1", "penny-3"]);
}

#[test]
fn friction_is_spread_as_configured() {
    let spec = job(&mixed(json!([{"kind": "dime", "count": 60}]))).unwrap();
    let frictions: Vec<f64> = (0..20)
        .flat_map(|seed| place_parts(&spec, Streams::new(seed)).unwrap())
        .map(|part| part.params.friction / 0.3 - 1.0)
        .collect();
    let mean = frictions.iter().sum::<f64>() / frictions.len() as f64;
    let sd = (frictions.iter().map(|f| (f - mean).powi(2)).sum::<f64>() / frictions.len() as f64).sqrt();
    // 1200 draws: standard errors 0.003 and 0.002
    assert!(mean.abs() < 0.012 && (sd - 0.1).abs() < 0.008, "{mean} {sd}");
}
