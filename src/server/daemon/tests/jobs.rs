//! Jobs and plates as clients see them.

use tokio::time::timeout;

use super::*;
use upm_runner::config::RigSpec;

const ENDLESS: &str = r#"{"plate": "upm-1", "name": "rest", "parts": [{"kind": "penny"}, {"kind": "dime", "count": 2}],
    "task": {"type": "hold"}}"#;

fn reset() -> Request<Body> {
    let body = r#"{"operator": "A. Person", "reason": "test"}"#;
    request("POST", "/v1/plates/upm-1/reset", &[("content-type", "application/json")], body)
}

#[test]
fn a_job_goes_where_it_asks_to_or_where_its_rig_is() {
    let api = TestApi::new();
    let goes_to = |text: &str| api.post("/v1/check", text).json()["plate"].clone();
    assert_eq!(goes_to(REST), "upm-1");
    let unplaced = REST.replace(r#""plate": "upm-1", "#, "");
    assert_eq!(goes_to(&unplaced), "upm-2", "the default");
    let rig = Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../..")).join("configs/rigs/upm-1.json");
    let rig = std::fs::read_to_string(rig).unwrap();
    assert_eq!(goes_to(&unplaced.replacen('{', &format!(r#"{{"rig": {rig}, "#), 1)), "upm-1");
    let evening = Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../..")).join("configs/rigs/upm-2-evening.json");
    let evening = serde_json::to_string(&RigSpec::load(&evening).unwrap().document).unwrap();
    let elsewhere = api.post("/v1/jobs", &unplaced.replacen('{', &format!(r#"{{"rig": {evening}, "#), 1)).json();
    let allowed = "the rig of the plate, or nothing (plate upm-2-evening has that rig)";
    assert_eq!(elsewhere["faults"][0]["allowed"], allowed, "{elsewhere}");
    let nowhere = api.post("/v1/jobs", &REST.replace("upm-1", "upm-3"));
    let fault = serde_json::json!(
        [{"path": "plate", "found": "\"upm-3\"", "allowed": "one of upm-1, upm-2, upm-2-evening"}]
    );
    assert_eq!((nowhere.status, &nowhere.json()["faults"]), (422, &fault));
    assert_eq!(["{", "[]"].map(|text| api.post("/v1/jobs", text).status), [400, 422]);
}

#[test]
fn full_queue_refuses_jobs_and_runs_after_reset_and_resume() {
    let api = TestApi::stopped();
    assert_eq!(api.post("/v1/jobs", REST).status, 409, "the plate is stopped");
    assert_eq!(api.post("/v1/plates/upm-1/resume", "").status, 409);
    let seen = eventually("a reset", || Some(api.ask(reset())).filter(|seen| seen.status == 200));
    assert_eq!(seen.json()["state"], "paused");
    let ids = [(); 3].map(|()| api.submit(REST));
    let full = api.post("/v1/jobs", REST);
    assert_eq!((full.status, full.header("retry-after")), (429, "5"));
    let cancel = || api.post(&format!("/v1/jobs/{}/cancel", ids[1]), "");
    assert_eq!(cancel().json()["state"], "cancelled");
    assert_eq!(cancel().status, 409);
    let first = api.post(&format!("/v1/jobs/{}/run-next", ids[2]), "");
    assert_eq!((first.status, first.json()["turn"].as_i64()), (200, Some(-1)));
    api.daemon.count_jobs(None);
    assert_eq!(api.get("/v1/plates").json()["plates"][0]["queued"], 2);
    assert_eq!(api.post("/v1/plates/upm-1/resume", "").status, 200);
    for id in [&ids[0], &ids[2]] {
        let ended = api.ended(id);
        assert_eq!((&ended["state"], &ended["reason"]), (&"completed".into(), &"every part held for 0.2 s".into()));
        assert_eq!(ended["report"]["outcome"], "completed");
    }
    let listed = api.get("/v1/jobs?limit=2").json();
    assert_eq!((&listed["jobs"][0]["id"], &listed["next"]), (&ids[2].clone().into(), &ids[1].clone().into()));
    assert_eq!(api.get(&format!("/v1/jobs?cursor={}", ids[1])).json()["jobs"][0]["id"], ids[0]);
    assert_eq!(api.post(&format!("/v1/jobs/{}/run-next", ids[0]), "").status, 409);
}

#[test]
fn waiting_reset_undoes_no_later_stop_and_is_dropped_with_its_caller() {
    let api = TestApi::stopped();
    let held = api.daemon.store.hold();
    api.runtime.block_on(async {
        let moment = Duration::from_millis(50);
        let mut earlier = std::pin::pin!(api.answer(reset()));
        assert!(timeout(moment, &mut earlier).await.is_err(), "it waits for the disk");
        api.plate().estop();
        assert!(timeout(moment, api.answer(reset())).await.is_err(), "its caller gives up");
        drop(held);
        assert_eq!(earlier.await.status, 409, "the plate was stopped again");
        assert_eq!(api.answer(reset()).await.json()["state"], "paused");
        assert_eq!(api.answer(reset()).await.status, 409, "the plate is not stopped");
    });
}

#[test]
fn full_disk_takes_no_job() {
    let api = TestApi::with(|spec| spec.min_free_bytes = u64::MAX);
    api.daemon.count(true);
    assert_eq!(api.post("/v1/jobs", REST).status, 507);
}

#[test]
fn job_has_a_picture_while_it_runs_and_after() {
    let api = TestApi::new();
    let id = api.submit(ENDLESS);
    let path = format!("/v1/jobs/{id}/frame.png");
    let picture = eventually("a picture", || Some(api.get(&path)).filter(|answer| answer.status == 200));
    assert_eq!(picture.header("content-type"), "image/png");
    assert!(picture.header("upm-age-ms").parse::<u64>().is_ok() && picture.body.starts_with(b"\x89PNG"));
    api.post(&format!("/v1/jobs/{id}/cancel"), "");
    api.ended(&id);
    assert_eq!(api.get(&path).status, 200, "the last one stays");
}

#[test]
fn stop_and_list_of_plates_do_not_wait_for_the_store() {
    let api = TestApi::new();
    let held = api.daemon.store.hold();
    let send = |method: &str, path: &str| tokio::spawn(api.app.clone().oneshot(request(method, path, &[], "")));
    let stops = api.runtime.block_on(async {
        // more than there are threads to wait for the store
        let waiting: Vec<_> = (0..2 * BLOCKING_THREADS).map(|_| send("GET", "/v1/jobs")).collect();
        tokio::time::sleep(Duration::from_millis(50)).await;
        let stops: Vec<_> = (0..6).map(|_| send("POST", "/v1/plates/upm-2/estop")).collect();
        let mut answers = Vec::new();
        for stop in stops {
            answers.push(stop.await.unwrap().unwrap().into_body().collect().await.unwrap().to_bytes());
        }
        waiting.iter().for_each(tokio::task::JoinHandle::abort);
        answers
    });
    for stop in stops {
        assert_eq!(serde_json::from_slice::<serde_json::Value>(&stop).unwrap()["persisted"], true, "{stop:?}");
    }
    let stopped = api.post("/v1/plates/upm-1/estop", "").json();
    assert_eq!((&stopped["plate"], &stopped["persisted"]), (&"upm-1".into(), &true.into()));
    assert_eq!(api.get("/v1/plates").json()["plates"][0]["state"], "stopped");
    assert_eq!(api.post("/v1/plates/upm-9/estop", "").status, 404);
    drop(held);
    let metrics = String::from_utf8(api.get("/metrics").body.to_vec()).unwrap();
    assert!(metrics.contains("upm_estops_total{plate=\"upm-1\"} 1"), "{metrics}");
}

#[test]
fn checked_job_is_laid_out_and_not_queued() {
    let api = TestApi::new();
    let sort = r#"{"plate": "upm-2", "name": "s", "parts": [{"kind": "dime", "count": 2}], "task": {"type": "sort",
        "bins": [{"kinds": ["dime"], "region_mm": {"min": [-50, -40], "max": [50, 40.5]}}]}}"#;
    let checked = api.post("/v1/check", sort).json();
    assert_eq!((&checked["name"], &checked["plate"]), (&"s".into(), &"upm-2".into()));
    let bin = serde_json::json!({"kinds": ["dime"], "region_mm": {"min": [-50.0, -40.0], "max": [50.0, 40.5]}});
    assert_eq!((checked["layout"]["parts"].as_array().unwrap().len(), &checked["layout"]["bins"][0]), (2, &bin));
    let refused = api.post("/v1/check", &sort.replace("[50, 40.5]", "[-45, 40.5]"));
    assert_eq!((refused.status, &refused.json()["faults"][0]["path"]), (422, &"task.bins[0].region_mm".into()));
    assert_eq!(api.post("/v1/check", "{").status, 400);
    let job = |reach: f64| {
        let task = format!(r#"{{"type": "arrange", "targets_mm": [[{reach}, 0]]}}"#);
        format!(r#"{{"plate": "upm-2", "name": "d", "parts": [{{"kind": "dime"}}], "task": {task}}}"#)
    };
    let (first, other) = (job(20.0), job(30.0));
    let begun = api.post("/v1/dry-run", &first);
    assert_eq!((begun.status, &begun.json()["forecast"]), (200, &serde_json::Value::Null));
    assert_eq!(api.post("/v1/dry-run", &other).status, 503, "one at a time");
    let told = || Some(api.post("/v1/dry-run", &first).json()["forecast"].clone()).filter(|told| !told.is_null());
    let forecast = eventually("a forecast", told);
    assert_eq!((&forecast["verdict"], &forecast["completed_of"][1]), (&"can_be_done".into(), &5.into()), "{forecast}");
    assert!(forecast["plate_time_s"][0].as_f64() < forecast["plate_time_s"][2].as_f64(), "{forecast}");
    assert_eq!(api.post("/v1/dry-run", &other).status, 200);
    assert_eq!(api.post("/v1/dry-run", &sort.replace("[50, 40.5]", "[-45, 40.5]")).status, 422);
    assert_eq!(api.get("/v1/jobs").json()["jobs"], serde_json::json!([]));
}

#[test]
fn job_has_a_layout_until_the_next_begins_and_is_deleted_after() {
    let api = TestApi::new();
    let [first, second] = [ENDLESS, REST].map(|text| api.submit(text));
    let layout = |id: &str| api.get(&format!("/v1/jobs/{id}/layout"));
    let seen = eventually("the job is laid out", || Some(layout(&first)).filter(|seen| seen.status == 200)).json();
    let kinds: Vec<&str> =
        seen["parts"].as_array().unwrap().iter().map(|part| part["kind"].as_str().unwrap()).collect();
    assert_eq!((kinds, &seen["endless"]), (vec!["penny", "dime", "dime"], &true.into()));
    let delete = |id: &str| api.ask(request("DELETE", &format!("/v1/jobs/{id}"), &[], "")).status;
    assert_eq!((delete(&first), delete(&second)), (409, 204), "one runs, one waits");
    api.post(&format!("/v1/jobs/{first}/cancel"), "");
    assert_eq!(api.ended(&first)["state"], "cancelled");
    assert_eq!((layout(&first).status, layout("nothing").status), (200, 404), "it was the last on its plate");
    let next = api.submit(REST);
    api.ended(&next);
    assert_eq!((layout(&first).status, layout(&next).status, delete(&next)), (404, 200, 204), "it is no longer");
    assert_eq!([delete(&first), delete(&first)], [204, 404], "once");
    assert_eq!(std::fs::read_dir(api.daemon.store.runs()).unwrap().count(), 0);
}
