//! `upm export` and the schemas of run folders, checked against the journals and reports of real runs.

use std::fs;
use std::path::{Path, PathBuf};

use serde_json::{Value, json};
use tempfile::TempDir;

use super::{job, root, status, upm};

/// Runs a job, which may fail to reach its goal; returns its run folder.
fn run(folder: &Path, job: &Path, more: &[&str]) -> PathBuf {
    let out = folder.join("out");
    let args = ["run", job.to_str().unwrap(), "--out", out.to_str().unwrap(), "--rerun", "off", "-q"];
    let output = upm().args(args).args(more).output().unwrap();
    assert!(matches!(output.status.code(), Some(0 | 1)), "{}", String::from_utf8_lossy(&output.stderr));
    fs::read_dir(&out).unwrap().map(|entry| entry.unwrap().path()).next().unwrap()
}

/// A job of two coins that are moved apart by rotations.
fn by_rotations(folder: &Path) -> PathBuf {
    job(folder, |job| {
        job["parts"] = json!([{"kind": "penny", "position_mm": [-20, 5]}, {"kind": "dime"}]);
        job["task"] = json!({"type": "arrange", "targets_mm": [[-40, 0], [40, 10]]});
        job["limits"]["plate_time_s"] = json!(20);
    })
}

/// A job of three coins on paths, moved by one motion for all.
fn by_fields(folder: &Path) -> PathBuf {
    let mut job: Value =
        serde_json::from_str(&fs::read_to_string(root().join("configs/bowtie-3.json")).unwrap()).unwrap();
    job["rig"] = json!(root().join("configs/rigs/upm-2.json"));
    job["limits"]["plate_time_s"] = json!(8);
    let path = folder.join("fields.json");
    fs::write(&path, job.to_string()).unwrap();
    path
}

fn journal(run: &Path) -> Vec<Value> {
    let text = fs::read_to_string(run.join("journal.jsonl")).unwrap();
    text.lines().map(|line| serde_json::from_str(line).unwrap()).collect()
}

fn report(run: &Path) -> Value {
    serde_json::from_str(&fs::read_to_string(run.join("report.json")).unwrap()).unwrap()
}

/// A row of a table as text by column.
type Row = std::collections::BTreeMap<String, String>;

fn table(path: &Path) -> Vec<Row> {
    let mut reader = csv::Reader::from_path(path).unwrap();
    reader.deserialize().map(Result::unwrap).collect()
}

/// Form in which a value of the journal appears in a table.
fn shown(value: &Value) -> String {
    match value {
        Value::Null => String::new(),
        Value::String(text) => text.clone(),
        Value::Number(number) if number.is_f64() => number.as_f64().unwrap().to_string(),
        other => other.to_string(),
    }
}

fn assert_cells(row: &Row, expected: &[(&str, &Value)]) {
    for (column, value) in expected {
        assert_eq!(row[*column], shown(value), "{column} of {row:?}");
    }
}

#[test]
fn tables_hold_the_values_of_journal_and_report() {
    type Job = fn(&Path) -> PathBuf;
    for of in [by_rotations as Job, by_fields] {
        let folder = TempDir::new().unwrap();
        let run = run(folder.path(), &of(folder.path()), &["--seed", "17"]);
        let tables = folder.path().join("tables");
        status(&["export", run.to_str().unwrap(), "--csv", "--to", tables.to_str().unwrap()], 0);
        let (lines, report) = (journal(&run), report(&run));
        let cycles: Vec<&Value> = lines.iter().filter(|line| line["type"] == "cycle").collect();
        let parts = report["parts"].as_array().unwrap();
        assert!(cycles.len() > 3, "{} cycles", cycles.len());

        let mut rows = table(&tables.join("positions.csv")).into_iter();
        let mut wanted = table(&tables.join("targets.csv")).into_iter();
        for cycle in &cycles {
            for (i, part) in parts.iter().enumerate() {
                let named =
                    [("cycle", &cycle["cycle"]), ("part", &json!(i + 1)), ("id", &part["id"]), ("kind", &part["kind"])];
                let row = rows.next().unwrap();
                assert_cells(&row, &named);
                assert_cells(
                    &row,
                    &[
                        ("observed_at_s", &cycle["observed_at_s"]),
                        ("observed_x_mm", &cycle["observed_mm"][i][0]),
                        ("observed_y_mm", &cycle["observed_mm"][i][1]),
                        ("predicted_y_mm", &cycle["predicted_mm"][i][1]),
                        ("ended_at_s", &cycle["ended_at_s"]),
                        ("result_x_mm", &cycle["result_mm"][i][0]),
                    ],
                );
                let row = wanted.next().unwrap();
                assert_cells(&row, &named);
                let of = &cycle["wanted"];
                assert_cells(
                    &row,
                    &[
                        ("at_s", &cycle["observed_at_s"]),
                        ("phase", &of["phase"]),
                        ("subgoal_x_mm", &of["subgoals_mm"][i][0]),
                        ("target_y_mm", &of["targets_mm"][i][1]),
                        ("cross_track_mm", &of["cross_track_mm"][i]),
                    ],
                );
            }
        }
        assert!(rows.next().is_none() && wanted.next().is_none());

        let mut rows = table(&tables.join("pulses.csv")).into_iter();
        for line in lines.iter().filter(|line| line["sent"].is_array()) {
            for (i, sent) in line["sent"].as_array().unwrap().iter().enumerate() {
                let (row, read) = (rows.next().unwrap(), &sent["read"]);
                assert_cells(
                    &row,
                    &[
                        ("cycle", &line["cycle"]),
                        ("pulse", &json!(i + 1)),
                        ("started_at_s", &sent["started_at_s"]),
                        ("probe", &json!(sent["probe"] == true)),
                        ("sustain_s", &sent["sustain_s"]),
                        ("read_cor_x_mm", &read["cor_mm"][0]),
                        ("read_rotation", &read["rotation"]),
                        ("read_pump_y_mm_s", &read["pump_mm_s"][1]),
                        ("read_residual_m_s2", &read["residual_m_s2"]),
                        ("read_off_asked", &read["off_asked"]),
                        ("read_fault", &read["fault"]),
                    ],
                );
            }
        }
        assert!(rows.next().is_none());

        let timings = table(&tables.join("timings.csv"));
        let of = report["timing_us"].as_object().unwrap();
        assert_eq!(timings.len(), of.len());
        for row in timings {
            let step = &of[&row["step"]];
            assert_cells(&row, &[("p50_us", &step["p50"]), ("p99_us", &step["p99"]), ("max_us", &step["max"])]);
        }
    }
}

#[test]
fn killed_run_is_exported_as_far_as_it_went() {
    let folder = TempDir::new().unwrap();
    let run = run(folder.path(), &by_rotations(folder.path()), &[]);
    let text = fs::read_to_string(run.join("journal.jsonl")).unwrap();
    let whole = text.lines().take(4).map(|line| format!("{line}\n")).collect::<String>();
    fs::write(run.join("journal.jsonl"), format!("{whole}{{\"type\":\"cyc")).unwrap();
    fs::remove_file(run.join("report.json")).unwrap();
    let (stdout, stderr) = status(&["export", run.to_str().unwrap(), "--csv", "--json"], 0);
    assert!(stderr.contains("half a line") && stderr.contains("no report.json"), "{stderr}");
    let summary: Value = serde_json::from_str(&stdout).unwrap();
    let beside = PathBuf::from(summary["folder"].as_str().unwrap());
    assert_eq!(beside.parent().unwrap(), run.canonicalize().unwrap().parent().unwrap());
    let rows = table(&beside.join("positions.csv"));
    let cycles = journal_cycles(&whole);
    assert_eq!(rows.len(), 2 * cycles, "two parts a cycle");
    assert!(rows.iter().all(|row| row["id"].is_empty() && !row["part"].is_empty()));
    assert_eq!(table(&beside.join("timings.csv")).len(), 0);
    assert_eq!(summary["files"].as_array().unwrap().len(), 4);
}

fn journal_cycles(text: &str) -> usize {
    text.lines().filter(|line| line.contains("\"type\":\"cycle\"")).count()
}

#[test]
fn invalid_run_folder_is_refused_in_one_line_without_tables() {
    let folder = TempDir::new().unwrap();
    let (run, to) = (folder.path().join("run"), folder.path().join("tables"));
    fs::create_dir(&run).unwrap();
    let refused = |name: &str, text: Option<&str>| {
        if let Some(text) = text {
            fs::write(run.join(name), text).unwrap();
        }
        let (_, stderr) = status(&["export", run.to_str().unwrap(), "--csv", "--to", to.to_str().unwrap()], 2);
        assert_eq!(stderr.lines().count(), 1, "{stderr}");
        assert!(stderr.contains(name) && stderr.contains("expected what `upm run` left"), "{stderr}");
    };
    refused("journal.jsonl", None);
    refused("report.json", Some("{\"name\": 3}"));
    assert!(!to.exists());
    fs::remove_file(run.join("report.json")).unwrap();
    refused("journal.jsonl", Some("{\"type\":\"cycle\"}\n"));
    let (_, stderr) = status(&["export", run.to_str().unwrap()], 2);
    assert_eq!(stderr, "upm: export: expected --csv, --parquet or both, found neither\n");
}

#[test]
fn parquet_tables_have_the_values_of_the_csv_tables() {
    use parquet::file::reader::{FileReader, SerializedFileReader};

    let folder = TempDir::new().unwrap();
    let run = run(folder.path(), &by_rotations(folder.path()), &["--seed", "5"]);
    let to = folder.path().join("tables");
    status(&["export", run.to_str().unwrap(), "--csv", "--parquet", "--to", to.to_str().unwrap()], 0);
    for name in ["positions", "targets", "pulses", "timings"] {
        let rows = table(&to.join(format!("{name}.csv")));
        let reader = SerializedFileReader::new(fs::File::open(to.join(format!("{name}.parquet"))).unwrap()).unwrap();
        let mut count = 0;
        for (row, read) in rows.iter().zip(reader.get_row_iter(None).unwrap()) {
            for (column, value) in read.unwrap().get_column_iter() {
                assert_eq!(row[column], text_of(value), "{name}: {column} of {row:?}");
            }
            count += 1;
        }
        assert_eq!((rows.len(), reader.metadata().file_metadata().num_rows() as usize), (count, count), "{name}");
        assert!(count > 3, "{name}: {count} rows");
    }
}

fn text_of(field: &parquet::record::Field) -> String {
    use parquet::record::Field;

    match field {
        Field::Null => String::new(),
        Field::Bool(flag) => flag.to_string(),
        Field::Long(number) => number.to_string(),
        Field::Double(number) => number.to_string(),
        Field::Str(text) => text.clone(),
        other => panic!("no table has a {other:?}"),
    }
}

/// A schema that the command prints, compiled by an independent validator.
struct PrintedSchema {
    schemas: boon::Schemas,
    index: boon::SchemaIndex,
}

impl PrintedSchema {
    fn faults(&self, document: &Value) -> String {
        self.schemas.validate(document, self.index).err().map_or(String::new(), |error| format!("{error:#}"))
    }
}

fn schema(name: &str) -> PrintedSchema {
    let schema: Value = serde_json::from_str(&status(&["schema", name], 0).0).unwrap();
    let (mut compiler, mut schemas) = (boon::Compiler::new(), boon::Schemas::new());
    compiler.add_resource("printed.json", schema).unwrap();
    let index = compiler.compile("printed.json", &mut schemas).unwrap();
    PrintedSchema { schemas, index }
}

#[test]
fn journals_and_reports_of_runs_fit_their_schemas() {
    let (of_line, of_report) = (schema("journal"), schema("report"));
    let mut types = std::collections::BTreeSet::new();
    let faulty = ["--faults", "part0:glued@3,camera:dark@8-9"];
    for (job, more) in [
        (by_rotations as fn(&Path) -> PathBuf, &["--seed", "3"][..]),
        (by_rotations, &faulty),
        (by_fields, &["--seed", "11"]),
    ] {
        let folder = TempDir::new().unwrap();
        let run = run(folder.path(), &job(folder.path()), more);
        for line in journal(&run) {
            assert_eq!(of_line.faults(&line), "", "{line}");
            types.insert(line["type"].as_str().unwrap().to_owned());
        }
        assert_eq!(of_report.faults(&report(&run)), "");
    }
    assert!(types.contains("cycle") && types.contains("localised") && types.contains("event"), "{types:?}");
}

#[test]
fn run_folder_schemas_reject_missing_and_mistyped_values() {
    let (of_line, of_report) = (schema("journal"), schema("report"));
    let folder = TempDir::new().unwrap();
    let run = run(folder.path(), &by_rotations(folder.path()), &[]);
    let lines = journal(&run);
    let cycle = lines.iter().find(|line| line["type"] == "cycle" && line["sent"] != json!([])).unwrap();
    let with = |pointer: &str, value: Value| {
        let mut changed = cycle.clone();
        *changed.pointer_mut(pointer).unwrap() = value;
        changed
    };
    for line in [
        with("/type", json!("cycles")),
        with("/cycle", json!(-1)),
        with("/observed_mm/0", json!([1])),
        with("/sent/0/base_hz", json!("60")),
        with("/wanted", json!({})),
        json!({"type": "event", "at_s": 1, "level": "loud", "text": "x"}),
        json!({"type": "event", "at_s": 1, "level": "info"}),
    ] {
        assert!(!of_line.faults(&line).is_empty(), "{line}");
    }
    let report = report(&run);
    for (key, value) in [("outcome", json!("done")), ("cycles", json!("many")), ("parts", json!([{"id": "x"}]))] {
        let mut changed = report.clone();
        changed[key] = value;
        assert!(!of_report.faults(&changed).is_empty(), "{key}");
        changed.as_object_mut().unwrap().remove(key);
        assert!(!of_report.faults(&changed).is_empty(), "without {key}");
    }
}
