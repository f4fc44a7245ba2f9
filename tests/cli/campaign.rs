//! `upm campaign` and `upm run --seeds` as subprocesses.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::thread::sleep;
use std::time::Duration;

use serde_json::{Value, json};
use tempfile::TempDir;

use super::{file, root, run, shipped, status, upm};

fn campaign(folder: &Path, seeds: &str, change: impl FnOnce(&mut Value)) -> PathBuf {
    let mut made = json!({"name": "middle", "seeds": seeds, "job": {
        "rig": root().join("configs/rigs/upm-2.json"), "parts": [{"kind": "penny"}],
        "task": {"type": "arrange", "targets_mm": [[0, 0]]},
        "planner": {"$each": ["moving_field", "synthesized_field"]}, "limits": {"plate_time_s": {"$one_of": [9, 0.2]}},
    }});
    change(&mut made);
    file(folder, "middle.json", &made)
}

fn command(file: &Path, out: &Path, more: &[&str]) -> Command {
    let mut command = upm();
    command.arg("campaign").arg(file).arg("--out").arg(out).arg("--quiet").args(more);
    command
}

/// Runs a campaign to its end, which has to have this status; standard output and error.
fn ended(file: &Path, out: &Path, more: &[&str], expected: i32) -> (String, String) {
    let output = command(file, out, more).output().unwrap();
    let [stdout, stderr] = [output.stdout, output.stderr].map(|text| String::from_utf8(text).unwrap());
    assert_eq!(output.status.code(), Some(expected), "{stdout}{stderr}");
    (stdout, stderr)
}

fn bytes(out: &Path) -> [Vec<u8>; 3] {
    ["summary.json", "runs.parquet", "plate_time_s.svg"].map(|name| fs::read(out.join(name)).unwrap())
}

fn lines(out: &Path) -> usize {
    let shards = fs::read_dir(out).into_iter().flatten().flatten().map(|entry| entry.path());
    let texts = shards.filter(|path| path.extension().is_some_and(|ending| ending == "jsonl"));
    texts.map(|path| fs::read_to_string(path).unwrap().lines().count()).sum()
}

#[test]
fn summary_is_equal_for_all_workers_shards_and_ends() {
    let folder = TempDir::new().unwrap();
    let file = campaign(folder.path(), "1..60", |_| {});
    let at = |name: &str| folder.path().join(name);
    let (table, _) = ended(&file, &at("two"), &["--jobs", "2"], 1);
    assert!(table.starts_with("middle: 120 runs, ") && table.contains("planner=moving_field"), "{table}");
    let expected = bytes(&at("two"));
    ended(&file, &at("sixteen"), &["--jobs", "16"], 1);
    assert!(bytes(&at("sixteen")) == expected, "16 workers");
    // killed five times, and once between two writes of a line
    for _ in 0..5 {
        let mut child = command(&file, &at("killed"), &["--jobs", "2"]).stdout(Stdio::null()).spawn().unwrap();
        let before = lines(&at("killed"));
        while child.try_wait().unwrap().is_none() && lines(&at("killed")) < before + 8 {
            sleep(Duration::from_millis(2));
        }
        child.kill().unwrap();
        child.wait().unwrap();
    }
    let half = fs::read_dir(at("killed")).unwrap().map(|entry| entry.unwrap().path());
    let half = half.filter(|path| path.extension().is_some_and(|ending| ending == "jsonl")).min().unwrap();
    fs::write(&half, [fs::read(&half).unwrap(), b"{\"run\":".to_vec()].concat()).unwrap();
    ended(&file, &at("killed"), &["--jobs", "2"], 1);
    assert!(bytes(&at("killed")) == expected && lines(&at("killed")) == 120, "killed and resumed");
    // shards on two machines, one of them twice
    for shard in 1..=4 {
        ended(&file, &at(["even", "odd"][shard % 2]), &["--shard", &format!("{shard}/4")], 0);
    }
    ended(&file, &at("odd"), &["--shard", "4/4"], 0);
    let merge = |more: &[&str], expected| {
        let (even, odd) = (at("even"), at("odd"));
        status(&[&["campaign", "merge", odd.to_str().unwrap(), even.to_str().unwrap()], more].concat(), expected)
    };
    let (_, said) = merge(&["--expect", "120"], 1);
    assert!(said.contains("30 runs are in more than one folder"), "{said}");
    let summary = |out: &Path| {
        let mut summary: Value = serde_json::from_slice(&bytes(out)[0]).unwrap();
        assert!(summary["shards"].take().is_number());
        summary
    };
    assert!(summary(&at("odd")) == summary(&at("two")), "shards of two folders");
    assert!(merge(&["--expect", "121"], 1).1.contains("expected 121 runs, found 120"));
}

#[test]
fn what_does_not_belong_together_is_refused() {
    let folder = TempDir::new().unwrap();
    let (one, at) = (campaign(folder.path(), "1..4", |_| {}), |name: &str| folder.path().join(name));
    ended(&one, &at("one"), &[], 1);
    let two = campaign(folder.path(), "1..5", |_| {});
    let (_, said) = ended(&two, &at("one"), &[], 2);
    assert!(
        said.contains("campaign: expected those of campaign ") && said.contains(", found runs of campaign "),
        "{said}"
    );
    ended(&two, &at("two"), &[], 1);
    let folders = [at("one"), at("two")].map(|path| path.to_str().unwrap().to_owned());
    let (_, said) = status(&["campaign", "merge", &folders[0], &folders[1]], 2);
    assert!(said.contains("two/campaign.json: campaign: expected"), "{said}");
    let program = fs::read_to_string(at("two").join("campaign.json")).unwrap();
    let program = program.replace("\"program\": \"", "\"program\": \"0");
    fs::write(at("two").join("campaign.json"), program).unwrap();
    assert!(ended(&two, &at("two"), &[], 2).1.contains("program: expected those of program "));
    assert!(ended(&two, &at("x"), &["--runs", "3..99"], 2).1.contains("expected numbers from 1 to 10, found 3..99"));
    let (_, said) = ended(&two, &at("y"), &["--judge", "true"], 2);
    assert!(said.contains("--judge: expected a line {\"violations\": [...]} for each run folder"), "{said}");
    let endless = campaign(folder.path(), "1..4", |made| {
        made["job"]["task"] = json!({"type": "plus_sign", "laps": 0});
        made["job"]["planner"] = json!("synthesized_field");
        made["job"]["limits"] = json!({"plate_time_s": 100_000});
    });
    let mut child = command(&endless, &at("held"), &["--shard", "1/1"]).stdout(Stdio::null()).spawn().unwrap();
    while !at("held").join("shard-001.jsonl").exists() {
        sleep(Duration::from_millis(5));
    }
    let (_, said) = ended(&endless, &at("held"), &["--shard", "1/1"], 2);
    assert!(said.contains("found a shard that another process runs"), "{said}");
    child.kill().unwrap();
    child.wait().unwrap();
}

#[test]
fn full_disk_leaves_whole_lines() {
    let folder = TempDir::new().unwrap();
    let (file, out) = (campaign(folder.path(), "1..40", |_| {}), folder.path().join("out"));
    // files may have 4 blocks of 512 or 1024 bytes
    let limited = format!(
        "trap '' XFSZ; ulimit -f 4; exec {} campaign {} --out {} --shard 1/1 --quiet",
        env!("CARGO_BIN_EXE_upm"),
        file.display(),
        out.display()
    );
    let output = Command::new("sh").args(["-c", &limited]).output().unwrap();
    let said = String::from_utf8(output.stderr).unwrap();
    assert!(output.status.code() == Some(2) && said.contains("cannot write"), "{said}");
    let text = fs::read_to_string(out.join("shard-001.jsonl")).unwrap();
    assert!(text.ends_with('\n') && text.lines().all(|line| serde_json::from_str::<Value>(line).is_ok()), "{text}");
    ended(&file, &out, &["--shard", "1/1"], 0);
    assert_eq!(lines(&out), 80);
}

#[test]
fn planners_are_compared_in_pairs() {
    let folder = TempDir::new().unwrap();
    let file = campaign(folder.path(), "1..200", |made| {
        made["job"]["limits"] = json!({"plate_time_s": 30});
        made["job"]["planner"] = json!("synthesized_field");
    });
    let against = |other: &str, out: &str, jobs: &str| {
        let more = ["--against", other, "--jobs", jobs, "--json", "--tells", "0.1"];
        let (told, _) = ended(&file, &folder.path().join(out), &more, 0);
        serde_json::from_str::<Value>(&told).unwrap()
    };
    let told = against("planner=moving_field", "planner", "2");
    assert_eq!(told["pairs"]["verdict"], "faster", "{told}");
    assert_eq!(against("planner=moving_field", "again", "1"), told);
    let same = against(env!("CARGO_BIN_EXE_upm"), "program", "2");
    assert_eq!((&same["pairs"]["verdict"], &same["mean_log_ratio"]["value"]), (&json!("equal"), &json!(0.0)));
    let (_, said) = ended(&file, &folder.path().join("x"), &["--against", "planer"], 2);
    assert!(said.contains("--against: expected KEY=VALUE, found \"planer\""), "{said}");
}

#[test]
fn run_with_seeds_is_a_campaign_of_one_job_that_keeps_its_runs() {
    let folder = TempDir::new().unwrap();
    let file = shipped(folder.path(), "arrange-2", |job| job["name"] = json!("two"));
    let out = folder.path().join("many");
    let args = ["run", file.to_str().unwrap(), "--camera", "positions", "--seeds", "31..32,7", "--json", "-q", "--out"];
    let (summary, _) = status(&[&args[..], &[out.to_str().unwrap()]].concat(), 0);
    let summary: Value = serde_json::from_str(&summary).unwrap();
    assert_eq!((&summary["done"], &summary["successes"]), (&json!(3), &json!(3)));
    let (single, _) = run(&file, &folder.path().join("alone"), &["--seed", "32", "--camera", "positions"], 0);
    let journal = |folder: &Path| fs::read(folder.join("journal.jsonl")).unwrap();
    let kept = out.join("kept/two-32-run-0000002");
    assert!(journal(&kept) == journal(&single), "the journals are equal byte for byte");
    assert!(!kept.join("run.rrd").exists(), "recordings are off unless asked for");
    let never = folder.path().join("never");
    for (more, said) in [
        (&["--seeds", "20..1"][..], "upm: --seeds: expected FIRST..LAST or seeds by comma"),
        (&["--seeds", "4,4"], "upm: --seeds: expected each seed once, found 4 twice"),
        (&["--seeds", "1..2", "--rerun", "nowhere"], "upm: --rerun: "),
        (&["--seeds", "1..2", "--pace", "real-time"], "upm: --pace: expected max (with --seeds), found real-time"),
        (&["--seeds", "1..2", "--faults", "coil9:dead"], "upm: --faults"),
    ] {
        let args = [&["run", file.to_str().unwrap(), "--out", never.to_str().unwrap()], more].concat();
        let (stdout, stderr) = status(&args, 2);
        assert!(stdout.is_empty() && stderr.starts_with(said), "{more:?}: {stderr}");
    }
    assert!(!never.exists());
}
