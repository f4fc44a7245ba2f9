use std::fs;
use std::io;
use std::path::{Path, PathBuf};
use std::sync::LazyLock;

use serde_json::{Value, json};

use super::table;
use crate::cli::args::Common;
use crate::cli::export::{ParquetFile, Table};
use crate::cli::output::{Failure, NOT_REACHED, print};
use upm_core::background::on_all_cores;
use upm_runner::campaign::{CampaignFolder, Figures, RunLine, Summary};

/// Shards that are read at once.
const SHARDS_AT_ONCE: usize = 16;

/// The table of runs: what each is, and the figures that do not depend on the computer.
static RUNS: LazyLock<Table> = LazyLock::new(|| {
    let columns = ["run", "cell", "seed"].map(|name| (name, "integer")).into_iter().chain([("success", "boolean")]);
    let columns = columns.chain(["key", "outcome", "code", "reason"].map(|name| (name, "string")));
    let columns: Vec<_> =
        columns.chain(figures().map(|name| (name, "number"))).map(|of| json!([of.0, of.1, ""])).collect();
    serde_json::from_value(json!({"name": "runs", "lines": [], "lists": [], "columns": columns})).unwrap_or_default()
});

fn figures() -> impl Iterator<Item = &'static str> {
    Figures::NAMES.iter().copied().filter(|name| *name != Figures::OF_COMPUTERS)
}

fn row(line: &RunLine) -> Vec<Value> {
    let RunLine { run, cell, seed, success, key, outcome, code, reason, .. } = line;
    let of_run =
        [json!(run), json!(cell), json!(seed), json!(success), json!(key), json!(outcome), json!(code), json!(reason)];
    let figures = line.figures.values().into_iter().zip(Figures::NAMES);
    let figures = figures.filter(|(_, name)| **name != Figures::OF_COMPUTERS).map(|(value, _)| json!(value));
    of_run.into_iter().chain(figures).collect()
}

/// Sums up folders of one campaign.
pub(super) fn merge(folders: &[PathBuf], expect: Option<usize>, common: Common) -> Result<u8, Failure> {
    let folders = folders.iter().map(|path| CampaignFolder::open(path)).collect::<Result<Vec<_>, _>>()?;
    merged(&folders, expect, common)
}

/// Writes `summary.json`, `runs.parquet` and a plot into the first of `folders`, and prints the summary. Status 1 if a
/// run is without success, or there are not as many as expected.
pub(super) fn merged(folders: &[CampaignFolder], expect: Option<usize>, common: Common) -> Result<u8, Failure> {
    let Some((first, others)) = folders.split_first() else { return Ok(0) };
    others.iter().try_for_each(|other| first.check_same(other))?;
    let (mut summary, mut twice) = (Summary::new(&first.facts), 0);
    let path = first.path().join("runs.parquet");
    let in_table = |error: io::Error| Failure::write(&path, error);
    let draft = path.with_extension("part");
    let mut table = ParquetFile::create(&draft, &RUNS).map_err(in_table)?;
    let shards: Vec<usize> = (0..first.facts.shards).collect();
    // lines are read on all cores, as many as fit into memory, and counted in their order
    for shards in shards.chunks(SHARDS_AT_ONCE) {
        for read in on_all_cores(shards, &|_| (), |&shard| first.lines_of(shard, others)) {
            let (lines, doubled) = read?;
            twice += doubled;
            for line in &lines {
                summary.add(line);
                table.row(row(line)).map_err(in_table)?;
            }
        }
    }
    let summary = summary.finish();
    table.finish().and_then(|()| fs::rename(&draft, &path)).map_err(in_table)?;
    let text = serde_json::to_string_pretty(&summary).map_err(Failure::failed)? + "\n";
    write(&first.path().join("summary.json"), &text)?;
    write(&first.path().join("plate_time_s.svg"), &upm_chart::svg(&table::plot(&summary)))?;
    print(common.json, &summary, || {
        table::lines(&summary).iter().try_for_each(|line| outln!("{line}"))?;
        outln!("  written: summary.json, runs.parquet and plate_time_s.svg in {}", first.path().display())
    })?;
    if twice > 0 && !common.quiet {
        errln!("upm: {twice} runs are in more than one folder; each counts once");
    }
    if let Some(expected) = expect.filter(|expected| *expected != summary.done) {
        errln!("upm: --expect: expected {expected} runs, found {}", summary.done);
        return Ok(NOT_REACHED);
    }
    Ok(if summary.successes < summary.done { NOT_REACHED } else { 0 })
}

fn write(path: &Path, text: &str) -> Result<(), Failure> {
    fs::write(path, text).map_err(|error| Failure::write(path, error))
}
