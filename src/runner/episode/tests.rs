use std::path::Path;
use std::sync::Arc;

use proptest::prelude::*;
use serde_json::{Value, json};

use super::{ActionKind, Episode, EpisodeParams, Episodes, StepOutcome};
use crate::config::Origin;

fn read(task: &Value, pennies: usize, action: &str) -> Result<Arc<EpisodeParams>, String> {
    let origin = Origin::of_file(&Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../..")).join("configs/job.json"));
    let parts = json!([{"kind": "penny", "count": pennies}, {"kind": "dime"}]);
    let text = json!({"parts": parts, "task": task, "action": action, "limits": {"plate_time_s": 30}}).to_string();
    EpisodeParams::from_json(&text, &origin).map(Arc::new).map_err(|error| error.to_string())
}

fn drawn(task: &str, pennies: usize, action: &str) -> Arc<EpisodeParams> {
    read(&json!({"type": task}), pennies, action).unwrap()
}

#[test]
fn expert_solves_drawn_arrangements_sorts_and_streams_by_every_kind_of_action() {
    let bin = |kind: &str, x: f64| json!({"kinds": [kind], "region_mm": {"min": [x, -60], "max": [x + 100.0, 60]}});
    let sort = json!({"type": "sort", "bins": [bin("penny", -140.0), bin("dime", 40.0)]});
    let [arrange, stream] = ["arrange", "stream"].map(|task| json!({"type": task}));
    for (task, action, pennies, seeds, rewards) in [
        (&arrange, "steps", 1, 0..3, 1.0..3.0),
        (&arrange, "motion", 3, 0..3, 1.0..3.0),
        (&arrange, "pulse", 1, 0..2, 1.0..3.0),
        (&sort, "steps", 3, 0..3, 1.0..3.0),
        (&sort, "motion", 2, 0..3, 1.0..3.0),
        (&stream, "motion", 1, 0..1, 8.0..99.0),
    ] {
        let params = read(task, pennies, action).unwrap();
        for seed in seeds {
            let (mut episode, mut sum) = (Episode::new(&params, seed).unwrap(), 0.0);
            while !episode.outcome().is_last() {
                let action = episode.expert();
                sum += episode.step(&action).unwrap().reward;
            }
            let (last, is_stream) = (episode.outcome(), task == &stream);
            assert!((last.truncated, last.terminated) == (is_stream, !is_stream), "{task} {action} {seed}: {last:?}");
            assert!(last.is_success || is_stream, "{task} {action} {seed}: {last:?}");
            assert!(rewards.contains(&sum), "{task} {action} {seed}: {sum}");
        }
    }
}

#[test]
fn journals_are_equal_for_any_number_of_threads_and_episodes_and_go_on_after_an_end() {
    let params = drawn("arrange", 1, "steps");
    let hashes = |number: usize, seed: u64, threads: usize| {
        let mut episodes = Episodes::new(&params, number, seed, threads).unwrap();
        let ended: usize = (0..16)
            .map(|_| {
                // half of them go astray
                let steps =
                    episodes.expert().chunks(8).flat_map(|two| [&two[..4], &[3.0; 4][..]].concat()).collect::<Vec<_>>();
                episodes.step(&steps[..4 * number]).unwrap().iter().filter(|outcome| outcome.was_reset).count()
            })
            .sum();
        (episodes.episodes.iter().map(Episode::journal_hash).collect::<Vec<_>>(), ended)
    };
    let (together, ended) = hashes(8, 5, 3);
    assert!(ended > 0 && together[4] != together[6], "{ended}");
    assert_eq!(together, hashes(8, 5, 1).0);
    assert_eq!(together[4..5], hashes(1, 9, 1).0);
}

#[test]
fn descriptions_without_sense_and_steps_after_the_end_are_refused() {
    for (task, action, fault) in [
        (json!({"type": "hold"}), "motion", "task.type: expected one of arrange, sort, stream, found \"hold\""),
        (json!({"type": "arrange"}), "motions", "action: expected one of motion, pulse, steps (did you mean motion?)"),
        (json!({"type": "stream", "targets_mm": []}), "pulse", "task: expected its type alone"),
        (json!({"type": "sort", "bins": []}), "steps", "task.bins"),
    ] {
        let refused = read(&task, 1, action).unwrap_err();
        assert!(refused.contains(fault), "{refused}");
    }
    let params = drawn("arrange", 1, "pulse");
    assert!([0, usize::MAX].iter().all(|number| Episodes::new(&params, *number, 1, 0).is_err()));
    let mut episode = Episode::new(&params, 1).unwrap();
    let last = std::iter::repeat_with(|| episode.step(&[0.0; 2]).unwrap()).find(StepOutcome::is_last).unwrap();
    assert!(last.truncated && last.reward == 0.0 && (30.0..30.02).contains(&last.plate_time_s), "{last:?}");
    let refused = episode.step(&[0.0; 2]).unwrap_err().to_string();
    assert_eq!(refused, "action: expected a reset, found one after the end");
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(24))]

    #[test]
    fn hostile_actions_are_refused_unmoved_and_allowed_ones_played(
        kind in prop::sample::select(&ActionKind::ALL[..]), length in 0usize..60, at in 0usize..49,
        value in prop_oneof![any::<f64>(), -400.0..400.0f64, Just(f64::NAN)], share in 0.0..=1.0f64,
    ) {
        let params = drawn("arrange", 1, kind.code());
        let (mut episode, bounds) = (Episode::new(&params, 11).unwrap(), &params.action_bounds);
        let (before, at) = (episode.journal_hash(), at % bounds.len());
        let mut action: Vec<f64> = bounds.iter().map(|[least, most]| (least + share * (most - least)).trunc()).collect();
        let is_whole = kind != ActionKind::Pulse || at > 0 || value.fract() == 0.0;
        let is_allowed = value >= bounds[at][0] && value <= bounds[at][1] && is_whole;
        action[at] = value;
        let played = episode.step(&action);
        prop_assert_eq!(played.is_ok(), is_allowed, "{:?}", played);
        prop_assert_eq!(episode.journal_hash() != before, is_allowed);
        let is_fit = length == bounds.len() && !episode.outcome().is_last();
        prop_assert_eq!(episode.step(&vec![0.0; length]).is_ok(), is_fit);
    }
}
