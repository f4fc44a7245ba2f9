//! Checks, layouts and deletions of jobs.

use super::*;

const ENDLESS: &str = r#"{"plate": "upm-1", "name": "rest", "parts": [{"kind": "penny"}, {"kind": "dime", "count": 2}],
    "task": {"type": "hold"}}"#;

#[test]
fn checked_job_is_laid_out_and_not_queued() {
    let running = RunningDaemon::new();
    let check = |text: &str| kept(running.backend.check(text.to_owned()));
    let sort = r#"{"plate": "upm-2", "name": "s", "parts": [{"kind": "dime", "count": 2}], "task": {"type": "sort",
        "bins": [{"kinds": ["dime"], "region_mm": {"min": [-50, -40], "max": [50, 40.5]}}]}}"#;
    let checked = check(sort).unwrap();
    assert_eq!((checked.name.as_str(), checked.plate.as_str(), checked.layout.parts.len()), ("s", "upm-2", 2));
    let bin = &checked.layout.bins[0];
    assert_eq!(
        (&bin.kinds, bin.region_mm.min, bin.region_mm.max),
        (&vec!["dime".to_owned()], [-50.0, -40.0], [50.0, 40.5])
    );
    let Err(Refusal::Invalid(faults)) = check(&sort.replace("[50, 40.5]", "[-45, 40.5]")) else { panic!("no fault") };
    assert_eq!(faults[0].path.to_string(), "task.bins[0].region_mm");
    assert!(matches!(check("{"), Err(Refusal::Malformed(_))));
    assert!(matches!(check(&on("upm-3")), Err(Refusal::Invalid(_))));
    assert_eq!(all_jobs(&running), []);
}

#[test]
fn layout_is_available_while_the_job_is_on_its_plate() {
    let running = RunningDaemon::new();
    let id = running.submit(ENDLESS).unwrap().id;
    let layout = eventually("the job is laid out", || kept(running.backend.layout(&id)).ok());
    let kinds: Vec<&str> = layout.parts.iter().map(|part| part.kind.as_str()).collect();
    assert_eq!((kinds, layout.endless), (vec!["penny", "dime", "dime"], true));
    kept(running.backend.cancel(&id, caller())).unwrap();
    running.ended(&id);
    eventually("the plate rests", || kept(running.backend.layout(&id)).err());
    assert!(matches!(kept(running.backend.layout(&id)), Err(Refusal::Unknown(_))));
    assert!(matches!(kept(running.backend.layout("nothing")), Err(Refusal::Unknown(_))));
}

#[test]
fn job_is_deleted_once_it_does_not_run() {
    let running = RunningDaemon::new();
    let [first, second] = [ENDLESS, &on("upm-1")].map(|text| running.submit(text).unwrap().id);
    let delete = |id: &str| kept(running.backend.delete(id, caller()));
    eventually("the job begins", || kept(running.backend.layout(&first)).ok());
    assert!(matches!(delete(&first), Err(Refusal::Conflict(_))), "it runs");
    assert_eq!(delete(&second), Ok(()), "it waits");
    assert!(matches!(kept(running.backend.job(&second)), Err(Refusal::Unknown(_))));
    kept(running.backend.cancel(&first, caller())).unwrap();
    running.ended(&first);
    assert_eq!(delete(&first), Ok(()));
    assert!(matches!(delete(&first), Err(Refusal::Unknown(_))), "once");
    assert_eq!(all_jobs(&running), []);
    let runs = running.backend.state.store.runs().to_owned();
    eventually_true("its run folder is removed", || std::fs::read_dir(&runs).unwrap().next().is_none());
}
