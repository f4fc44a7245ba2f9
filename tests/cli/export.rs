//! `upm export` and the schemas of run folders, checked against the journals and reports of real runs.

use std::fs;
use std::path::{Path, PathBuf};
use std::sync::LazyLock;

use serde_json::{Value, json};
use tempfile::TempDir;

use super::{shipped, status, upm};

/// Runs a job without pixels, which may fail to reach its goal; returns its run folder.
fn run(folder: &Path, job: &Path, more: &[&str]) -> PathBuf {
    let out = folder.join("out");
    let args = ["run", job.to_str().unwrap(), "--camera", "positions", "--out", out.to_str().unwrap()];
    let output = upm().args(args).args(["--rerun", "off", "-q"]).args(more).output().unwrap();
    assert!(matches!(output.status.code(), Some(0 | 1)), "{}", String::from_utf8_lossy(&output.stderr));
    fs::read_dir(&out).unwrap().map(|entry| entry.unwrap().path()).next().unwrap()
}

/// Run folders that the tests share, by rotations and by fields; they leave them as they are.
static RUNS: LazyLock<[(TempDir, PathBuf); 2]> = LazyLock::new(|| {
    [by_rotations, by_fields].map(|job| {
        let folder = TempDir::new().unwrap();
        let run = run(folder.path(), &job(folder.path()), &[]);
        (folder, run)
    })
});

fn shared_run() -> &'static Path {
    &RUNS[0].1
}

/// A job of two coins that are moved apart by rotations.
fn by_rotations(folder: &Path) -> PathBuf {
    shipped(folder, "plus-sign-upm-2", |job| {
        job["planner"] = json!("cor_sequence");
        job["parts"] = json!([{"kind": "penny", "position_mm": [-20, 5]}, {"kind": "dime"}]);
        job["task"] = json!({"type": "arrange", "targets_mm": [[-40, 0], [40, 10]]});
        job["limits"]["plate_time_s"] = json!(20);
    })
}

/// A job of three coins on paths, moved by one motion for all.
fn by_fields(folder: &Path) -> PathBuf {
    shipped(folder, "bowtie-3", |job| job["limits"]["plate_time_s"] = json!(8))
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
        other => other.to_string(),
    }
}

/// Compares cells, each a column and the JSON pointer to its value in `line`, where `#` is the index of the row.
fn assert_cells(row: &Row, line: &Value, index: usize, cells: &str) {
    for cell in cells.split_whitespace() {
        let (column, pointer) = cell.split_once('=').unwrap();
        let value = line.pointer(&pointer.replace('#', &index.to_string())).unwrap_or(&Value::Null);
        assert_eq!(row[column], shown(value), "{column} of {row:?}");
    }
}

const POSITIONS: &str = "cycle=/cycle id=/parts/#/id kind=/parts/#/kind observed_at_s=/observed_at_s \
                         observed_x_mm=/observed_mm/#/0 observed_y_mm=/observed_mm/#/1 \
                         predicted_y_mm=/predicted_mm/#/1 ended_at_s=/ended_at_s result_x_mm=/result_mm/#/0";
const TARGETS: &str = "cycle=/cycle id=/parts/#/id at_s=/observed_at_s phase=/wanted/phase \
                       subgoal_x_mm=/wanted/subgoals_mm/#/0 target_y_mm=/wanted/targets_mm/#/1 \
                       cross_track_mm=/wanted/cross_track_mm/#";
const PULSES: &str = "cycle=/cycle started_at_s=/sent/#/started_at_s sustain_s=/sent/#/sustain_s \
                      read_cor_x_mm=/sent/#/read/cor_mm/0 read_rotation=/sent/#/read/rotation \
                      read_pump_y_mm_s=/sent/#/read/pump_mm_s/1 read_off_asked=/sent/#/read/off_asked \
                      read_residual_m_s2=/sent/#/read/residual_m_s2 read_fault=/sent/#/read/fault";

#[test]
fn tables_hold_the_values_of_journal_and_report() {
    let folder = TempDir::new().unwrap();
    for (_, run) in &*RUNS {
        let tables = folder.path().join("tables");
        status(&["export", run.to_str().unwrap(), "--csv", "--to", tables.to_str().unwrap()], 0);
        let (mut lines, report) = (journal(run), report(run));
        let rows = |name: &str| table(&tables.join(name)).into_iter();
        let (mut positions, mut targets, mut pulses) = (rows("positions.csv"), rows("targets.csv"), rows("pulses.csv"));
        for line in &mut lines {
            line["parts"] = report["parts"].clone();
            for i in (0..report["parts"].as_array().unwrap().len()).filter(|_| line["type"] == "cycle") {
                assert_cells(&positions.next().unwrap(), line, i, POSITIONS);
                assert_cells(&targets.next().unwrap(), line, i, TARGETS);
            }
            for (i, sent) in line["sent"].as_array().into_iter().flatten().enumerate() {
                let row = pulses.next().unwrap();
                assert_cells(&row, line, i, PULSES);
                let flags = [(i + 1).to_string(), (sent["probe"] == true).to_string()];
                assert_eq!([&row["pulse"], &row["probe"]], [&flags[0], &flags[1]]);
            }
        }
        assert!(positions.next().is_none() && targets.next().is_none() && pulses.next().is_none());

        let timings = table(&tables.join("timings.csv"));
        let of = report["timing_us"].as_object().unwrap();
        assert_eq!(timings.len(), of.len());
        for row in timings {
            assert_cells(&row, &of[&row["step"]], 0, "p50_us=/p50 p99_us=/p99 max_us=/max");
        }
    }
}

#[test]
fn killed_run_is_exported_as_far_as_it_went() {
    let folder = TempDir::new().unwrap();
    let run = folder.path().join("run");
    fs::create_dir(&run).unwrap();
    let text = fs::read_to_string(shared_run().join("journal.jsonl")).unwrap();
    let whole = text.lines().take(4).map(|line| format!("{line}\n")).collect::<String>();
    fs::write(run.join("journal.jsonl"), format!("{whole}{{\"type\":\"cyc")).unwrap();
    let (stdout, stderr) = status(&["export", run.to_str().unwrap(), "--csv", "--json"], 0);
    assert!(stderr.contains("half a line") && stderr.contains("no report.json"), "{stderr}");
    let summary: Value = serde_json::from_str(&stdout).unwrap();
    let beside = PathBuf::from(summary["folder"].as_str().unwrap());
    assert_eq!(beside.parent().unwrap(), run.canonicalize().unwrap().parent().unwrap());
    let rows = table(&beside.join("positions.csv"));
    let cycles = whole.lines().filter(|line| line.contains("\"type\":\"cycle\"")).count();
    assert_eq!(rows.len(), 2 * cycles, "two parts a cycle");
    assert!(rows.iter().all(|row| row["id"].is_empty() && !row["part"].is_empty()));
    assert_eq!(table(&beside.join("timings.csv")).len(), 0);
    assert_eq!(summary["files"].as_array().unwrap().len(), 5);
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
    let (_, stderr) = status(&["export", run.to_str().unwrap()], 2);
    assert_eq!(stderr, "upm: export: expected --csv, --parquet, --lerobot DIR or --mcap FILE, found none of them\n");
}

#[test]
fn parquet_tables_have_the_values_of_the_csv_tables() {
    use parquet::file::reader::{FileReader, SerializedFileReader};

    let folder = TempDir::new().unwrap();
    let to = folder.path().join("tables");
    status(&["export", shared_run().to_str().unwrap(), "--csv", "--parquet", "--to", to.to_str().unwrap()], 0);
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
        Field::Double(number) => json!(number).to_string(),
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
    let folder = TempDir::new().unwrap();
    let more = ["--seed", "11", "--faults", "part0:glued@3,camera:dark@5-6"];
    let faulty = run(folder.path(), &by_fields(folder.path()), &more);
    for run in [&RUNS[0].1, &RUNS[1].1, &faulty] {
        for line in journal(run) {
            assert_eq!(of_line.faults(&line), "", "{line}");
            types.insert(line["type"].as_str().unwrap().to_owned());
        }
        assert_eq!(of_report.faults(&report(run)), "");
    }
    assert!(types.contains("cycle") && types.contains("localised") && types.contains("event"), "{types:?}");
}
