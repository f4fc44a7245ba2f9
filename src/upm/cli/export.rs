//! `upm export`: writes a run as tables, for programs that do not read journals.

mod parquet_file;
mod tables;

use std::fs::{self, File};
use std::io::{self, BufRead, BufReader, Read};
use std::path::{Path, PathBuf};

use serde_json::{Value, json};

use super::args::Common;
use super::output::{Failure, print};
use super::run_args::ExportArgs;
use super::run_folder::run_folder;
use parquet_file::ParquetFile;
use tables::{Column, TABLES, Table};
use upm_recording::Report;
use upm_runner::config::reason;

/// Largest report that is read, and longest line of a journal, bytes; a cycle of some hundred pulses is far shorter.
const MOST_REPORT_BYTES: u64 = 16 << 20;
const LONGEST_LINE: u64 = 16 << 20;

const EXPECTED: &str = "expected what `upm run` left in a run folder";

/// Writes the tables of a run folder.
pub(super) fn export(args: &ExportArgs, common: Common) -> Result<u8, Failure> {
    if !args.csv && !args.parquet {
        return Err(Failure::bad_input("export: expected --csv, --parquet or both, found neither"));
    }
    let run = run_folder(&args.run)?;
    let report = report_of(&run)?;
    let path = run.join("journal.jsonl");
    let journal = File::open(&path).map_err(|error| read_failed(&path, &error))?;
    let folder = args.to.clone().unwrap_or_else(|| beside(&run));
    let mut files = TableFiles::create(&folder, args)?;
    let parts = report.as_ref().map_or(Value::Null, |report| json!(report.parts));
    files.add_journal(&path, journal, &parts)?;
    match &report {
        Some(report) => {
            let timings: Vec<_> = json!(report.timing_us).as_object().into_iter().flatten().map(|t| json!(t)).collect();
            files.add("report", &json!({ "timings": timings }), Failure::failed)?;
        }
        None => tracing::warn!("{}: no report.json: no names of parts and no timings", run.display()),
    }
    let written = files.finish()?;
    let rows = written.iter().map(|(path, rows)| json!({ "file": path.display().to_string(), "rows": rows }));
    let result = json!({ "folder": folder.display().to_string(), "files": rows.collect::<Vec<Value>>() });
    let print_rows = || written.iter().try_for_each(|(path, rows)| outln!("{}: {rows} rows", path.display()));
    print(common.json, &result, print_rows)
}

/// Default output folder, beside the run folder `run` and named after it.
fn beside(run: &Path) -> PathBuf {
    // resolves the name, also of `.`
    let run = run.canonicalize().unwrap_or_else(|_| run.to_owned());
    let mut name = run.file_name().unwrap_or_default().to_owned();
    name.push("-tables");
    run.with_file_name(name)
}

fn read_failed(path: &Path, error: &io::Error) -> Failure {
    Failure::bad_input(format!("cannot read {}: {}; {EXPECTED}", path.display(), reason(error)))
}

/// Report of the run; `None` for a run that never ended.
fn report_of(run: &Path) -> Result<Option<Report>, Failure> {
    let path = run.join("report.json");
    let file = match File::open(&path) {
        Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(None),
        opened => opened.map_err(|error| Failure::read_failed(&path, &error))?,
    };
    let report = serde_json::from_reader(BufReader::new(file.take(MOST_REPORT_BYTES)));
    report.map(Some).map_err(|error| Failure::bad_input(format!("{}: {EXPECTED}, found {error}", path.display())))
}

/// File of a table in one format.
struct TableFile {
    table: &'static Table,
    path: PathBuf,
    writer: TableWriter,
    rows: u64,
}

enum TableWriter {
    /// Comma-separated values as in RFC 4180, with a header row.
    Csv(csv::Writer<File>),
    Parquet(ParquetFile),
}

struct TableFiles {
    files: Vec<TableFile>,
    drafts: Drafts,
}

/// Files that are not whole yet; those that are left are removed.
#[derive(Default)]
struct Drafts(Vec<PathBuf>);

impl Drop for Drafts {
    fn drop(&mut self) {
        self.0.iter().for_each(|draft| fs::remove_file(draft).unwrap_or_default());
    }
}

/// Name of the table file `path` until it is whole.
fn draft_of(path: &Path) -> PathBuf {
    path.with_added_extension("part")
}

impl TableFiles {
    /// Creates a file for every table in each format that `args` name. They have their names once all are whole.
    fn create(folder: &Path, args: &ExportArgs) -> Result<Self, Failure> {
        fs::create_dir_all(folder).map_err(|error| Failure::write(folder, error))?;
        let mut drafts = Drafts::default();
        let mut create = |table: &'static Table, ending| {
            let path = folder.join(format!("{}.{ending}", table.name));
            drafts.0.push(draft_of(&path));
            let writer = TableWriter::create(&draft_of(&path), table, ending);
            let writer = writer.map_err(|error| Failure::write(&path, error))?;
            Ok(TableFile { table, path, writer, rows: 0 })
        };
        let endings = [(args.csv, "csv"), (args.parquet, "parquet")].into_iter().filter(|(is_asked, _)| *is_asked);
        let tables = endings.flat_map(|(_, ending)| TABLES.iter().map(move |table| (table, ending)));
        let files = tables.map(|(table, ending)| create(table, ending)).collect::<Result<_, Failure>>()?;
        Ok(Self { files, drafts })
    }

    /// Writes the rows of all lines of `journal`. An incomplete last line, as a killed run leaves it, counts as its
    /// end.
    fn add_journal(&mut self, path: &Path, journal: File, parts: &Value) -> Result<(), Failure> {
        let mut journal = BufReader::new(journal);
        let mut bytes = Vec::new();
        for number in 1.. {
            bytes.clear();
            let read = journal.by_ref().take(LONGEST_LINE).read_until(b'\n', &mut bytes);
            let read = read.map_err(|error| read_failed(path, &error))?;
            let fault = |found: String| {
                Failure::bad_input(format!("{}: line {number}: {EXPECTED}, found {found}", path.display()))
            };
            if read as u64 == LONGEST_LINE && !bytes.ends_with(b"\n") {
                return Err(fault(format!("more than {LONGEST_LINE} bytes")));
            }
            if !bytes.ends_with(b"\n") {
                if read > 0 {
                    tracing::warn!("{}: ends in half a line: the run was killed", path.display());
                }
                break;
            }
            let mut line: Value = serde_json::from_slice(&bytes).map_err(|error| fault(error.to_string()))?;
            let Some(kind) = line.get("type").and_then(Value::as_str).map(str::to_owned) else {
                return Err(fault("no type".to_owned()));
            };
            line["parts"] = parts.clone();
            self.add(&kind, &line, fault)?;
        }
        Ok(())
    }

    /// Adds the rows of a line of this type to all tables; `fault` is for what the line lacks.
    fn add(&mut self, kind: &str, line: &Value, fault: impl Fn(String) -> Failure) -> Result<(), Failure> {
        self.files.iter_mut().filter(|file| file.table.lines.iter().any(|of| of == kind)).try_for_each(|file| {
            let rows = file.table.rows(line).map_err(&fault)?;
            file.rows += rows.len() as u64;
            rows.iter().try_for_each(|row| file.writer.row(row)).map_err(|error| Failure::write(&file.path, error))
        })
    }

    /// Closes the files and gives them their names; their paths and numbers of rows.
    fn finish(self) -> Result<Vec<(PathBuf, u64)>, Failure> {
        let finish = |TableFile { path, writer, rows, .. }| match writer.finish() {
            Ok(()) => Ok((path, rows)),
            Err(error) => Err(Failure::write(&path, error)),
        };
        let whole: Vec<(PathBuf, u64)> = self.files.into_iter().map(finish).collect::<Result<_, _>>()?;
        let name =
            |(path, _): &(PathBuf, u64)| fs::rename(draft_of(path), path).map_err(|error| Failure::write(path, error));
        whole.iter().try_for_each(name)?;
        drop(self.drafts);
        Ok(whole)
    }
}

impl TableWriter {
    fn create(path: &Path, table: &'static Table, ending: &str) -> io::Result<Self> {
        if ending == "parquet" {
            return Ok(Self::Parquet(ParquetFile::create(path, table)?));
        }
        let mut file = csv::Writer::from_writer(File::create(path)?);
        file.write_record(table.columns.iter().map(|Column(name, ..)| name))?;
        Ok(Self::Csv(file))
    }

    /// Appends a row with one value per column.
    fn row(&mut self, row: &[Value]) -> io::Result<()> {
        match self {
            Self::Csv(file) => Ok(file.write_record(row.iter().map(text))?),
            Self::Parquet(file) => file.row(row),
        }
    }

    /// Writes buffered rows and closes the file.
    fn finish(self) -> io::Result<()> {
        match self {
            Self::Csv(mut file) => file.flush(),
            Self::Parquet(file) => file.finish(),
        }
    }
}

fn text(value: &Value) -> String {
    match value {
        Value::Null => String::new(),
        Value::String(text) => text.clone(),
        other => other.to_string(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Exports a journal of this text as CSV; the rows of its pulses, or the fault.
    fn exported(text: &str) -> Result<u64, String> {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("journal.jsonl");
        fs::write(&path, text).unwrap();
        let run = crate::cli::run_args::RunFolderArgs { run: folder.path().into(), out: "runs".into() };
        let args = ExportArgs { run, csv: true, parquet: true, to: None };
        let mut files = TableFiles::create(&folder.path().join("tables"), &args).unwrap();
        let added = files.add_journal(&path, File::open(&path).unwrap(), &Value::Null);
        added.map_err(|failure| failure.lines.join("\n"))?;
        Ok(files.finish().unwrap()[2].1)
    }

    #[test]
    fn journal_that_ends_in_half_a_line_is_read_up_to_there() {
        let pulse = r#"{"started_at_s":1,"read":{"cor_mm":[1.5,null]}}"#;
        let whole =
            format!("{{\"type\":\"event\"}}\n{{\"type\":\"unfinished_cycle\",\"cycle\":3,\"sent\":[{pulse}]}}\n");
        assert_eq!(exported(&format!("{whole}{{\"type")), Ok(1));
    }

    #[test]
    fn invalid_journal_line_is_reported_by_its_number() {
        let event = "{\"type\":\"event\"}\n";
        let odd = "{\"type\":\"unfinished_cycle\",\"cycle\":true,\"sent\":[{}]}\n";
        for line in ["nonsense\n", "\n", "{}\n", "{\"type\":\"cycle\",\"cycle\":0}\n", odd] {
            let fault = exported(&format!("{event}{line}")).unwrap_err();
            assert!(fault.contains(": line 2: expected what `upm run` left"), "{line}: {fault}");
        }
    }
}
