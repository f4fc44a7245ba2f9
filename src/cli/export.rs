//! `upm export`: writes a run as tables, for programs that do not read journals.

mod journal;
#[cfg(feature = "parquet")]
mod parquet_file;
mod table;
mod tables;

use std::fs::{self, File};
use std::io::{self, BufReader};
use std::path::{Path, PathBuf};

use serde_json::{Value, json};

use super::args::Common;
use super::features::PARQUET;
use super::output::{Failure, print};
use super::run_args::ExportArgs;
use super::run_folder::run_folder;
use journal::{ExportLine, JournalFault, Lines};
use table::{CsvFile, ExportTable, TableCell, TableFile};
use tables::{POSITIONS, PULSES, PartNames, TABLES, TARGETS, TIMINGS};
use upm_recording::Report;
use upm_runner::config::reason;

/// Largest report that is read, bytes; one of a thousand parts is far smaller.
const MOST_REPORT_BYTES: u64 = 16 << 20;

/// File name extensions of the table formats; that of Parquet is the name of its feature.
const CSV: &str = "csv";

/// Writes the tables of a run folder.
pub(super) fn export(args: &ExportArgs, common: Common) -> Result<u8, Failure> {
    if !args.csv && !args.parquet {
        return Err(Failure::bad_input("export: expected --csv, --parquet or both, found neither"));
    }
    let run = &run_folder(&args.run)?;
    let report = report_of(run)?;
    let folder = args.to.clone().unwrap_or_else(|| beside(run));
    let forms = [(args.csv, CSV), (args.parquet, PARQUET)];
    let journal = run.join("journal.jsonl");
    let lines = open_journal(&journal)?;
    let mut written =
        WrittenTable::create(&folder, forms.iter().filter(|(asked, _)| *asked).map(|(_, ending)| *ending))?;
    let parts = report.as_ref().map_or(&[][..], |report| &report.parts);
    write_journal(&journal, lines, &PartNames(parts), &mut written)?;
    match &report {
        Some(report) => tables::timings(&report.timing_us).try_for_each(|row| written.row(&TIMINGS, &row))?,
        None => tracing::warn!("{}: no report.json: no names of parts and no timings", run.display()),
    }
    let files = written.finish()?;
    let rows = files.iter().map(|(path, rows)| json!({ "file": path.display().to_string(), "rows": rows }));
    let result = json!({ "folder": folder.display().to_string(), "files": rows.collect::<Vec<Value>>() });
    print(common.json, &result, || files.iter().try_for_each(|(path, rows)| outln!("{}: {rows} rows", path.display())))
}

/// Default output folder, beside the run folder `run` and named after it.
fn beside(run: &Path) -> PathBuf {
    // resolves the name, also of `.`
    let run = run.canonicalize().unwrap_or_else(|_| run.to_owned());
    let mut name = run.file_name().unwrap_or_default().to_owned();
    name.push("-tables");
    run.with_file_name(name)
}

/// Report of the run; `None` for a run that never ended.
fn report_of(run: &Path) -> Result<Option<Report>, Failure> {
    let path = run.join("report.json");
    let file = match File::open(&path) {
        Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(None),
        opened => opened.map_err(|error| Failure::read_failed(&path, &error))?,
    };
    let report = serde_json::from_reader(BufReader::new(io::Read::take(file, MOST_REPORT_BYTES)));
    report.map(Some).map_err(|error| {
        let allowed = "what `upm run` left in a run folder";
        Failure::bad_input(format!("{}: expected {allowed}, found {error}", path.display()))
    })
}

fn open_journal(path: &Path) -> Result<Lines<BufReader<File>>, Failure> {
    let file = File::open(path).map_err(|error| read_failed(path, JournalFault::File(error)))?;
    Ok(Lines::of(BufReader::new(file)))
}

fn read_failed(path: &Path, fault: JournalFault) -> Failure {
    let (path, allowed) = (path.display(), "what `upm run` left in a run folder");
    Failure::bad_input(match fault {
        JournalFault::File(error) => format!("cannot read {path}: {}; expected {allowed}", reason(&error)),
        JournalFault::Line(number, error) => format!("{path}: line {number}: expected {allowed}, found {error}"),
    })
}

/// Writes the rows of all lines of the journal at `path`.
fn write_journal(
    path: &Path,
    mut lines: Lines<BufReader<File>>,
    parts: &PartNames<'_>,
    written: &mut WrittenTable,
) -> Result<(), Failure> {
    while let Some(line) = lines.next().map_err(|fault| read_failed(path, fault))? {
        match line {
            ExportLine::Cycle(cycle) => {
                tables::positions(&cycle, parts).try_for_each(|row| written.row(&POSITIONS, &row))?;
                tables::targets(&cycle, parts).try_for_each(|row| written.row(&TARGETS, &row))?;
                tables::pulses(cycle.cycle, &cycle.sent).try_for_each(|row| written.row(&PULSES, &row))?;
            }
            ExportLine::UnfinishedCycle(unfinished) => {
                tables::pulses(unfinished.cycle, &unfinished.sent).try_for_each(|row| written.row(&PULSES, &row))?;
            }
            ExportLine::Other => {}
        }
    }
    if lines.cut_short {
        tracing::warn!("{}: ends in half a line: the run was killed", path.display());
    }
    Ok(())
}

/// Table files being written.
struct WrittenTable(Vec<Open>);

struct Open {
    table: &'static str,
    path: PathBuf,
    file: Box<dyn TableFile>,
    rows: u64,
}

impl WrittenTable {
    /// Creates a file for every table in each format of `endings`.
    fn create(folder: &Path, endings: impl Iterator<Item = &'static str> + Clone) -> Result<Self, Failure> {
        if endings.clone().any(|ending| ending == PARQUET) {
            check_parquet()?;
        }
        fs::create_dir_all(folder).map_err(|error| Failure::write(folder, error))?;
        let open = |table: &ExportTable, ending| {
            let path = folder.join(format!("{}.{ending}", table.name));
            let file = if ending == CSV { create_csv(&path, table) } else { create_parquet(&path, table) };
            let file = file.map_err(|error| Failure::write(&path, error))?;
            Ok(Open { table: table.name, path, file, rows: 0 })
        };
        let files = endings.flat_map(|ending| TABLES.map(|table| open(table, ending)));
        files.collect::<Result<_, _>>().map(Self)
    }

    fn row(&mut self, table: &ExportTable, row: &[TableCell<'_>]) -> Result<(), Failure> {
        for open in self.0.iter_mut().filter(|open| open.table == table.name) {
            open.file.row(row).map_err(|error| Failure::write(&open.path, error))?;
            open.rows += 1;
        }
        Ok(())
    }

    /// Closes the files; their paths and numbers of rows.
    fn finish(self) -> Result<Vec<(PathBuf, u64)>, Failure> {
        let finish = |Open { path, file, rows, .. }: Open| match file.finish() {
            Ok(()) => Ok((path, rows)),
            Err(error) => Err(Failure::write(&path, error)),
        };
        self.0.into_iter().map(finish).collect()
    }
}

fn create_csv(path: &Path, table: &ExportTable) -> io::Result<Box<dyn TableFile>> {
    Ok(Box::new(CsvFile::create(path, table)?))
}

#[cfg(feature = "parquet")]
fn create_parquet(path: &Path, table: &ExportTable) -> io::Result<Box<dyn TableFile>> {
    Ok(Box::new(parquet_file::ParquetFile::create(path, table)?))
}

#[cfg(feature = "parquet")]
fn check_parquet() -> Result<(), Failure> {
    Ok(())
}

#[cfg(not(feature = "parquet"))]
fn create_parquet(_: &Path, _: &ExportTable) -> io::Result<Box<dyn TableFile>> {
    Err(io::ErrorKind::Unsupported.into())
}

#[cfg(not(feature = "parquet"))]
fn check_parquet() -> Result<(), Failure> {
    Err(super::features::lacking(PARQUET, "upm export --parquet"))
}
