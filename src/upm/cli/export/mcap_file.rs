//! `upm export --mcap`: the tables of runs as channels of JSON messages, a row a message, at plate time.

use std::collections::BTreeMap;
use std::fs::{self, File};
use std::io::{BufWriter, Write};
use std::path::{Path, PathBuf};

use mcap::records::{MessageHeader, Metadata};
use mcap::{McapResult, WriteOptions};
use serde_json::{Map, json};

use super::files::{Drafts, draft_of, provenance, read_lines};
use super::tables::{Column, TABLES, Table, text};
use crate::cli::output::Failure;

/// Writes `runs` into the file `path`; the number of messages. It has its name once it is whole.
pub(super) fn write(path: &Path, runs: &[PathBuf], mut show: impl FnMut(f64, &Path)) -> Result<u64, Failure> {
    let failed = |error| Failure::write(path, error);
    let _draft = Drafts(vec![draft_of(path)]);
    let file = File::create(draft_of(path)).map_err(|error| Failure::write(path, error))?;
    let options = WriteOptions::new().compression(None).library(concat!("upm ", env!("CARGO_PKG_VERSION")));
    let mut file = options.create(BufWriter::new(file)).map_err(failed)?;
    // the first time in a row is that of its message
    let is_time = |column: &Column| column.0.ends_with("at_s");
    for (index, run) in runs.iter().enumerate() {
        show(index as f64 / runs.len() as f64, run);
        let name = format!("/episode-{index:06}");
        let facts = provenance(run)?.as_object().cloned().unwrap_or_default();
        let metadata = facts.iter().map(|(key, value)| (key.clone(), text(value))).collect();
        file.write_metadata(&Metadata { name: format!("upm{name}"), metadata }).map_err(failed)?;
        let prefix = if runs.len() == 1 { "" } else { &name };
        let mut channel = |table: &'static Table| {
            let types = table.columns.iter().map(|Column(name, kind, _)| (name.clone(), json!({ "type": kind })));
            let schema = json!({ "type": "object", "properties": types.collect::<Map<_, _>>() }).to_string();
            let schema = file.add_schema(&format!("upm.{}", table.name), "jsonschema", schema.as_bytes())?;
            Ok((file.add_channel(schema, &format!("{prefix}/{}", table.name), "json", &BTreeMap::new())?, table))
        };
        let timed = TABLES.iter().filter(|table| table.columns.iter().any(is_time));
        let channels = timed.map(&mut channel).collect::<McapResult<Vec<_>>>().map_err(failed)?;
        read_lines(run, |line| {
            for &(channel_id, table) in channels.iter().filter(|(_, table)| table.lines.contains(&line.kind)) {
                for row in table.rows(&line.content).map_err(|found| line.fault(found))? {
                    let cells = table.columns.iter().zip(row);
                    let at_s = cells.clone().find_map(|(column, value)| value.as_f64().filter(|_| is_time(column)));
                    let log_time = (at_s.unwrap_or_default() * 1e9).round() as u64;
                    let present = cells.filter(|(_, value)| !value.is_null());
                    let message: Map<_, _> = present.map(|(Column(name, ..), value)| (name.clone(), value)).collect();
                    let header = MessageHeader { channel_id, sequence: 0, log_time, publish_time: log_time };
                    file.write_to_known_channel(&header, json!(message).to_string().as_bytes()).map_err(failed)?;
                }
            }
            Ok(())
        })?;
    }
    let summary = file.finish().map_err(failed)?;
    file.into_inner().flush().and_then(|()| fs::rename(draft_of(path), path)).map_err(|e| Failure::write(path, e))?;
    Ok(summary.stats.map_or(0, |stats| stats.message_count))
}
