use std::fs;
use std::io::Read;
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::mpsc::sync_channel;

use super::*;
use crate::store::{AuditEntry, Clocks, JobRow, JobStore, NewEvent, NewJob, OpenOutcome, Pace, Store, StoreLimits};
use upm_core::time::{MonotonicClock, PlateTime};
use upm_runner::config::Origin;

const TOKEN: &str = "hIq8Zr0pT3vL5mWn9xYb2cKd7fGj4sAe";

fn fixed_time() -> Timestamp {
    Timestamp::from_second(1_800_000_000).unwrap()
}

fn new_job(name: &str) -> NewJob {
    NewJob {
        name: name.to_owned(),
        plate: "left".into(),
        seed: 1,
        pace: Pace::Max,
        spec_json: "{}".into(),
        rig_fingerprint: "0123456789abcdef".into(),
        library_sha256: "00".repeat(32),
        body_sha256: [0; 32],
        key: None,
    }
}

/// A data folder with secrets in every place that may hold one, and a store that is in use.
struct Planted {
    folder: tempfile::TempDir,
    store: Store,
}

impl Planted {
    fn new() -> Self {
        let folder = tempfile::tempdir().unwrap();
        let data = folder.path().join(TOKEN);
        fs::create_dir(&data).unwrap();
        fs::write(data.join("token"), TOKEN).unwrap();
        let clocks = Clocks::new(fixed_time, MonotonicClock::new());
        let opened =
            Store::open(&data, &["left".to_owned()], StoreLimits::default(), clocks, &|_, _| Err("none".to_owned()));
        let OpenOutcome { store, .. } = opened.unwrap();
        Self { folder, store }
    }

    fn data(&self) -> PathBuf {
        self.folder.path().join(TOKEN)
    }

    fn plant(&self) {
        let job = NewJob {
            spec_json: format!("{{\"name\": \"{TOKEN}\"}}"),
            key: Some(TOKEN.into()),
            ..new_job(&format!("x-{TOKEN}"))
        };
        let (sender, accepted) = sync_channel(1);
        self.store.accept(job, move |made| sender.send(made).unwrap());
        accepted.recv().unwrap().unwrap();
        let made = format!("password={TOKEN}-1");
        let folder = |_: &_| fs::create_dir(self.data().join("runs").join(&made)).map(|()| made.clone());
        let id = self.store.claim("left", &folder).unwrap().unwrap().row.id;
        let run = self.data().join("runs").join(&made);
        fs::write(run.join("journal.jsonl"), format!("{{\"text\": \"a {TOKEN}\", \"cycle\": 3}}\n{{\"te {TOKEN}"))
            .unwrap();
        let body = Arc::from(format!("{{\"text\": \"the token {TOKEN}\", \"n\": 4}}"));
        let event = NewEvent { plate_time: PlateTime::from_secs(1.5), kind: "cycle", body };
        let (sender, requests) = sync_channel(1);
        self.store.append_event(&id, event, Box::new(move |stored| sender.send(stored).unwrap()));
        requests.recv().unwrap().unwrap();
        let reason = format!("my password is {TOKEN}");
        self.store.audit(AuditEntry { act: "reset".into(), operator: "Ana".into(), reason, ..AuditEntry::default() });
        let (sender, seen) = sync_channel(1);
        while {
            let sender = sender.clone();
            self.store.audit_tail(1, move |rows| sender.send(rows).unwrap());
            seen.recv().unwrap().unwrap().is_empty()
        } {}
    }

    fn spec(&self) -> DaemonSpec {
        let configs = std::path::Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../..")).join("configs/daemon.json");
        let mut text: Value = serde_json::from_str(&fs::read_to_string(&configs).unwrap()).unwrap();
        text["data"] = Value::from(self.data().to_string_lossy());
        text["token_file"] = Value::from(self.data().join("token").to_string_lossy());
        text["hosts"] = json!([format!("{}.example.org", TOKEN)]);
        DaemonSpec::from_json(&text.to_string(), &Origin::of_file(&configs)).unwrap()
    }
}

fn made_of(config: Result<&DaemonSpec, &[Diagnostic]>, data: Option<&Path>) -> (Bundle, Vec<(String, Vec<u8>)>) {
    let made = bundle(&BundleSources { version: "1.2.3", target: "any", now: fixed_time(), config, data }).unwrap();
    let files = read(&made.tar);
    assert_eq!(made.files, files.iter().map(|(name, _)| name.clone()).collect::<Vec<_>>());
    (made, files)
}

/// Names and contents of the files in an archive.
fn read(tar: &[u8]) -> Vec<(String, Vec<u8>)> {
    let mut archive = tar::Archive::new(tar);
    let one = |entry: std::io::Result<tar::Entry<'_, &[u8]>>| {
        let mut entry = entry.unwrap();
        assert_eq!((entry.header().mode().unwrap(), entry.header().mtime().unwrap()), (0o600, 1_800_000_000));
        let name = entry.path().unwrap().display().to_string();
        let mut content = Vec::new();
        entry.read_to_end(&mut content).unwrap();
        (name, content)
    };
    archive.entries().unwrap().map(one).collect()
}

fn text_of(files: &[(String, Vec<u8>)], name: &str) -> String {
    let (_, content) =
        files.iter().find(|(file, _)| *file == format!("{ROOT}/{name}")).unwrap_or_else(|| panic!("{name}"));
    String::from_utf8(content.clone()).unwrap()
}

#[test]
fn no_planted_secret_is_in_a_bundle() {
    let planted = Planted::new();
    planted.plant();
    let (made, files) = made_of(Ok(&planted.spec()), Some(&planted.data()));
    assert!(!made.tar.windows(TOKEN.len()).any(|bytes| bytes == TOKEN.as_bytes()));
    assert!(!made.tar.windows(8).any(|bytes| bytes.eq_ignore_ascii_case(&TOKEN.as_bytes()[..8])));
    // the text around the secrets is included, so the secrets were encountered
    let event: Value = serde_json::from_str(&text_of(&files, "events.jsonl")).unwrap();
    assert_eq!(event["body"], json!({"text": "the token [removed]", "n": 4}));
    let act: Value = serde_json::from_str(&text_of(&files, "audit.jsonl")).unwrap();
    assert_eq!((&act["operator"], &act["reason"]), (&json!("Ana"), &json!("my password [removed]")));
    let jobs: Value = serde_json::from_str(&text_of(&files, "jobs.json")).unwrap();
    assert_eq!((&jobs["newest"][0]["name"], &jobs["newest"][0]["state"]), (&json!("[removed]"), &json!("running")));
    assert_eq!(text_of(&files, "journals/1.jsonl"), "{\"cycle\":3,\"text\":\"a [removed]\"}\n\"[removed]\"\n");
    let runs: Value = serde_json::from_str(&text_of(&files, "runs.json")).unwrap();
    assert_eq!((&runs["count"], &runs["newest"][0]["folder"]), (&json!(1), &json!("[removed]")));
    let config: Value = serde_json::from_str(&text_of(&files, "config.json")).unwrap();
    assert_eq!((&config["token_file"], &config["hosts"][0]), (&json!("[removed]"), &json!("[removed]")));
    assert_eq!((&config["queue"], &config["plates"][1]["name"]), (&json!(64), &json!("upm-2")));
    assert_eq!(made.missing, ["the latches: no such file"]);
}

#[test]
fn the_daemon_goes_on_and_afterwards_its_folder_is_as_it_was() {
    let planted = Planted::new();
    planted.plant();
    let names = || {
        let mut names: Vec<_> = fs::read_dir(planted.data()).unwrap().map(|entry| entry.unwrap().file_name()).collect();
        names.sort();
        names
    };
    let before = names();
    made_of(Ok(&planted.spec()), Some(&planted.data()));
    assert_eq!(names(), before);
    assert_eq!(planted.store.health().fault, None);
    assert!(planted.store.close(std::time::Duration::from_secs(60)));
    let (_, files) = made_of(Ok(&planted.spec()), Some(&planted.data()));
    assert!(text_of(&files, "jobs.json").contains("\"closed_in_order\": true"));
}

#[test]
fn missing_bundle_parts_are_reported() {
    let faults = DaemonSpec::from_json(&format!("{{\"listen\": \"{TOKEN}\"}}"), &Origin::of_request("x")).unwrap_err();
    let empty = tempfile::tempdir().unwrap();
    let (made, files) = made_of(Err(&faults), Some(empty.path()));
    assert!(!made.tar.windows(TOKEN.len()).any(|bytes| bytes == TOKEN.as_bytes()));
    let about: Value = serde_json::from_str(&text_of(&files, "about.json")).unwrap();
    let missing = about["missing"].as_array().unwrap();
    assert_eq!((missing.len(), made.missing.len()), (4, 4), "{missing:?}");
    assert!(missing[0].as_str().unwrap().starts_with("the configuration has "));
    assert_eq!(fs::read_dir(empty.path()).unwrap().count(), 0);
    let (made, _) = made_of(Err(&faults), None);
    assert_eq!(made.missing.len(), 2);
}

#[test]
fn a_run_folder_keeps_the_id_of_its_job_and_no_other() {
    let planted = Planted::new();
    let (sender, accepted) = sync_channel(1);
    planted.store.accept(new_job("plus-sign"), move |made| sender.send(made).unwrap());
    accepted.recv().unwrap().unwrap();
    let folder = |row: &JobRow| {
        let name = format!("plus-sign-{}", row.id);
        fs::create_dir(planted.data().join("runs").join(&name)).map(|()| name)
    };
    let id = planted.store.claim("left", &folder).unwrap().unwrap().row.id;
    fs::create_dir(planted.data().join("runs/plus-sign-01a2027ac79975b5a0a98ac036e45e21")).unwrap();
    let (_, files) = made_of(Err(&[]), Some(&planted.data()));
    let runs: Value = serde_json::from_str(&text_of(&files, "runs.json")).unwrap();
    let mut names: Vec<&str> = [0, 1].map(|i| runs["newest"][i]["folder"].as_str().unwrap()).to_vec();
    names.sort();
    assert_eq!(names, ["[removed]", &format!("plus-sign-{id}")]);
    let jobs: Value = serde_json::from_str(&text_of(&files, "jobs.json")).unwrap();
    assert_eq!(jobs["newest"][0]["folder"], json!(format!("plus-sign-{id}")));
}

#[test]
fn latches_are_shown() {
    let data = tempfile::tempdir().unwrap();
    fs::create_dir(data.path().join("latch")).unwrap();
    fs::write(data.path().join("latch/left"), "upm: stopped    ").unwrap();
    let (_, files) = made_of(Err(&[]), Some(data.path()));
    let shown: Value = serde_json::from_str(&text_of(&files, "data.json")).unwrap();
    assert_eq!(shown["latches"], json!([{"plate": "left", "says": "upm: stopped"}]));
}
