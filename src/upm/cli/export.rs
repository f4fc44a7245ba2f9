//! `upm export`: writes runs as tables, data sets and logs, for programs that do not read journals.

mod dataset;
mod files;
mod mcap_file;
mod parquet_file;
mod tables;

use std::fs::{self, File};
use std::io;
use std::path::{Path, PathBuf};

use serde_json::{Value, json};

use super::args::Common;
use super::output::{Failure, check_ending, print};
use super::progress::LateProgress;
use super::run_args::{ExportArgs, RunFolderArgs};
use super::run_folder::run_folder;
use files::{JOURNAL, draft_of, read_failed, read_lines, report_of};
use tables::{Column, TABLES, text};

pub(super) use dataset::{differing_files, episodes_in};
pub(super) use files::Drafts;
pub(super) use parquet_file::ParquetFile;
pub(super) use tables::Table;

/// Writes run folders in the forms that are asked for.
pub(super) fn export(args: &ExportArgs, common: Common) -> Result<u8, Failure> {
    let has_tables = args.csv || args.parquet;
    let refusal = |text: &str| Err(Failure::bad_input(format!("export: expected {text}")));
    if !has_tables && args.lerobot.is_none() && args.mcap.is_none() {
        return refusal("--csv, --parquet, --lerobot DIR or --mcap FILE, found none of them");
    }
    if has_tables && args.runs.len() > 1 {
        return refusal(&format!("one RUN for --csv and --parquet, found {}", args.runs.len()));
    }
    args.mcap.iter().try_for_each(|file| check_ending("--mcap", file, &["mcap"]))?;
    let of = |run: &PathBuf| run_folder(&RunFolderArgs { run: run.clone(), out: args.out.clone() });
    let runs = args.runs.iter().map(of).collect::<Result<Vec<_>, _>>()?;
    let mut progress = LateProgress::new(common);
    let mut show = |done, run: &Path| progress.show(done, || run.display().to_string());
    let (mut result, mut written) = (json!({}), Vec::new());
    if let (true, [run]) = (has_tables, &*runs) {
        let folder = args.to.clone().unwrap_or_else(|| beside(run));
        written.extend(tables(run, &folder, args)?);
        result["folder"] = folder.display().to_string().into();
    }
    if let Some(folder) = &args.lerobot {
        written.push((folder.clone(), dataset::write(folder, &runs, &mut show)?));
    }
    if let Some(file) = &args.mcap {
        written.push((file.clone(), mcap_file::write(file, &runs, &mut show)?));
    }
    progress.finish();
    let rows = written.iter().map(|(path, rows)| json!({ "file": path.display().to_string(), "rows": rows }));
    result["files"] = rows.collect();
    let print_rows = || written.iter().try_for_each(|(path, rows)| outln!("{}: {rows} rows", path.display()));
    print(common.json, &result, print_rows)
}

/// Writes the tables of the run folder `run` into `folder`; their paths and numbers of rows.
fn tables(run: &Path, folder: &Path, args: &ExportArgs) -> Result<Vec<(PathBuf, u64)>, Failure> {
    let report = report_of(run)?;
    // nothing is created without a journal
    File::open(run.join(JOURNAL)).map_err(|error| read_failed(&run.join(JOURNAL), &error))?;
    fs::create_dir_all(folder).map_err(|error| Failure::write(folder, error))?;
    let (mut drafts, mut files) = (Drafts::default(), Vec::new());
    let endings = [(args.csv, "csv"), (args.parquet, "parquet")].into_iter().filter(|(is_asked, _)| *is_asked);
    for (table, ending) in endings.flat_map(|(_, ending)| TABLES.iter().map(move |table| (table, ending))) {
        let path = folder.join(format!("{}.{ending}", table.name));
        drafts.0.push(draft_of(&path));
        let create = if ending == "csv" { csv_file } else { parquet_file };
        let write = create(&draft_of(&path), table).map_err(|error| Failure::write(&path, error))?;
        files.push(TableFile { table, path, rows: 0, write });
    }
    let mut add = |kind: &str, line: &Value, fault: &dyn Fn(String) -> Failure| {
        files.iter_mut().filter(|file| file.table.lines.iter().any(|of| of == kind)).try_for_each(|file| {
            let rows = file.table.rows(line).map_err(fault)?;
            rows.into_iter().try_for_each(|row| file.put(Some(row)))
        })
    };
    read_lines(run, |line| add(&line.kind, &line.content, &|found| line.fault(found)))?;
    match &report {
        Some(report) => {
            let timings: Vec<_> = json!(report.timing_us).as_object().into_iter().flatten().map(|t| json!(t)).collect();
            add("report", &json!({ "timings": timings }), &|found| Failure::failed(found))?;
        }
        None => tracing::warn!("{}: no report.json: no names of parts and no timings", run.display()),
    }
    files.iter_mut().try_for_each(|file| file.put(None))?;
    for TableFile { path, .. } in &files {
        fs::rename(draft_of(path), path).map_err(|error| Failure::write(path, error))?;
    }
    Ok(files.into_iter().map(|file| (file.path, file.rows)).collect())
}

/// Default output folder, beside the run folder `run` and named after it.
fn beside(run: &Path) -> PathBuf {
    // resolves the name, also of `.`
    let run = run.canonicalize().unwrap_or_else(|_| run.to_owned());
    let mut name = run.file_name().unwrap_or_default().to_owned();
    name.push("-tables");
    run.with_file_name(name)
}

/// Appends a row with one value per column; `None` writes what is buffered and ends the file.
type WriteRow = Box<dyn FnMut(Option<Vec<Value>>) -> io::Result<()>>;

/// File of a table in one format, which has its name once it is whole.
struct TableFile {
    table: &'static Table,
    path: PathBuf,
    rows: u64,
    write: WriteRow,
}

impl TableFile {
    fn put(&mut self, row: Option<Vec<Value>>) -> Result<(), Failure> {
        self.rows += u64::from(row.is_some());
        (self.write)(row).map_err(|error| Failure::write(&self.path, error))
    }
}

/// Comma-separated values as in RFC 4180, with a header row.
fn csv_file(path: &Path, table: &'static Table) -> io::Result<WriteRow> {
    let mut file = csv::Writer::from_writer(File::create(path)?);
    file.write_record(table.columns.iter().map(|Column(name, ..)| name))?;
    Ok(Box::new(move |row| match row {
        Some(row) => Ok(file.write_record(row.iter().map(text))?),
        None => file.flush(),
    }))
}

fn parquet_file(path: &Path, table: &'static Table) -> io::Result<WriteRow> {
    let mut file = ParquetFile::create(path, table)?;
    Ok(Box::new(move |row| match row {
        Some(row) => file.row(row),
        None => file.finish(),
    }))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Exports a journal of this text as CSV; the rows of its pulses, or the fault.
    fn exported(text: &str) -> Result<u64, String> {
        let folder = tempfile::tempdir().unwrap();
        fs::write(folder.path().join("journal.jsonl"), text).unwrap();
        let runs = vec![folder.path().into()];
        let args =
            ExportArgs { runs, out: "runs".into(), csv: true, parquet: true, to: None, lerobot: None, mcap: None };
        let written = tables(folder.path(), &folder.path().join("tables"), &args);
        written.map(|files| files[2].1).map_err(|failure| failure.lines.join("\n"))
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
