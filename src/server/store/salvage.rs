use std::collections::BTreeSet;
use std::fs;
use std::path::Path;

use rusqlite::{Connection, Row, params};
use serde_json::Value;

use super::columns::{JOB, Micros, job_of, rows};
use super::connection::reading;
use super::history::audit_row_of;
use super::ids::Ids;
use super::layout::DataDir;
use super::run_file::{modified, text_of};
use super::{JobId, JobRow, JobState, NewJob, Pace, StoreFault, jobs};

/// Copies the readable data of the damaged store `old`: jobs, idempotency keys (also of deleted jobs), the audit log.
/// Events are left behind; their numbers are not reused.
pub(super) fn from_store(old: &Path, new: &Connection) -> Result<(), StoreFault> {
    let Ok(old) = reading(old) else { return Ok(()) };
    let tx = new.unchecked_transaction()?;
    let (mut seen, mut lines) = (BTreeSet::new(), Vec::new());
    // from both ends, since nothing is readable after a broken page
    for order in ["", "DESC"] {
        let sql = format!("SELECT {JOB} FROM jobs NOT INDEXED ORDER BY rowid {order}");
        for job in readable_rows(&old, &sql, job_of) {
            if seen.insert(job.id) {
                copy_job(&old, &tx, job)?;
            }
        }
        let sql =
            format!("SELECT id, at, plate, act, operator, reason, remote, token_name FROM audit ORDER BY id {order}");
        lines.extend(readable_rows(&old, &sql, audit_row_of));
    }
    lines.sort_by_key(|line| line.id);
    lines.dedup_by_key(|line| line.id);
    for line in lines {
        let entry = line.entry;
        let sql = "INSERT INTO audit VALUES (?1, ?2, ?3, ?4, ?5, ?6, ?7, ?8)";
        let (plate, act, operator, reason) = (entry.plate, entry.act, entry.operator, entry.reason);
        let values = params![line.id, Micros(line.at), plate, act, operator, reason, entry.remote, entry.token_name];
        tx.execute(sql, values)?;
    }
    let key = |row: &Row<'_>| Ok((row.get::<_, String>(0)?, row.get::<_, [u8; 32]>(1)?, row.get(2)?));
    let keys: Vec<(_, _, JobId)> = readable_rows(&old, "SELECT key, body_sha256, job FROM keys", key);
    for (key, body_sha256, job) in keys.into_iter().filter(|(_, _, job)| seen.contains(job)) {
        let sql = "INSERT OR IGNORE INTO keys (key, body_sha256, job, uptime) VALUES (?1, ?2, ?3, 0)";
        tx.execute(sql, params![key, body_sha256, job])?;
    }
    let spent: Vec<String> = readable_rows(&old, "SELECT key FROM spent_keys", |row| row.get(0));
    for key in spent {
        tx.execute("INSERT OR IGNORE INTO spent_keys (key, uptime) VALUES (?1, 0)", [key])?;
    }
    Ok(tx.commit()?)
}

/// The rows before the first unreadable one.
fn readable_rows<T>(old: &Connection, sql: &str, made: impl Fn(&Row<'_>) -> rusqlite::Result<T>) -> Vec<T> {
    let Ok(mut statement) = old.prepare(sql) else { return Vec::new() };
    let Ok(rows) = statement.query_map([], made) else { return Vec::new() };
    rows.map_while(Result::ok).collect()
}

/// Copies a job. A queued job without its text cannot run any more.
fn copy_job(old: &Connection, tx: &Connection, mut job: JobRow) -> rusqlite::Result<()> {
    let sql = "SELECT spec FROM specs WHERE job = ?1";
    let spec: Option<String> = old.query_row(sql, [job.id], |row| row.get(0)).ok();
    if job.state == JobState::Queued && spec.is_none() {
        job.state = JobState::Interrupted;
        job.finished_at = Some(job.submitted_at);
        job.reason = "its text was lost with the damaged store".to_owned();
    }
    let taken = "SELECT count(*) FROM jobs WHERE folder = ?1";
    let taken: i64 = tx.query_row(taken, [&job.folder], |row| row.get(0))?;
    if taken > 0 {
        job.folder = None;
    }
    jobs::insert(tx, &job, spec.as_deref())
}

/// Marks queued jobs with a non-empty run folder as running: they had begun, and the store lost that record. Their end
/// is determined as after any crash; they are not run again.
pub(super) fn have_begun(dir: &DataDir, connection: &Connection) -> Result<(), StoreFault> {
    let tx = connection.unchecked_transaction()?;
    let (names, known) = (dir.run_names()?, folders_of(&tx)?);
    for job in rows(&tx, &format!("SELECT {JOB} FROM jobs WHERE state = 'queued'"), [], job_of)? {
        let name = job.run_folder();
        let folder = dir.runs.join(&name);
        if names.binary_search(&name).is_err() || is_empty(&folder) {
            continue;
        }
        let started_at = modified(&folder.join("effective.json")).unwrap_or(job.submitted_at).max(job.submitted_at);
        // another row may name the folder, made from it by an earlier start
        let folder = (!known.contains(&name)).then_some(name);
        let sql = "UPDATE jobs SET state = 'running', started_at = ?2, folder = ?3 WHERE id = ?1";
        tx.execute(sql, params![job.id, Micros(started_at), folder])?;
    }
    Ok(tx.commit()?)
}

/// True for a folder made for a job that did not begin.
fn is_empty(folder: &Path) -> bool {
    fs::read_dir(folder).is_ok_and(|mut entries| entries.next().is_none())
}

/// Makes running jobs of the run folders without a job: their end is determined as after any crash.
pub(super) fn from_folders(dir: &DataDir, new: &Connection) -> Result<(), StoreFault> {
    let tx = new.unchecked_transaction()?;
    let known = folders_of(&tx)?;
    let mut found: Vec<JobRow> = dir
        .run_names()?
        .into_iter()
        .filter(|name| !known.contains(name))
        .filter_map(|name| job_in(&dir.runs.join(&name), name))
        .collect();
    found.sort_by_key(|job| job.submitted_at);
    let ids = Ids::above(None);
    for job in found {
        let id = ids.next(job.submitted_at);
        jobs::insert(&tx, &JobRow { id, ..job }, None)?;
    }
    Ok(tx.commit()?)
}

/// Names of the run folders that belong to a job.
pub(super) fn folders_of(connection: &Connection) -> rusqlite::Result<BTreeSet<String>> {
    let sql = "SELECT folder FROM jobs WHERE folder IS NOT NULL";
    Ok(rows(connection, sql, [], |row| row.get(0))?.into_iter().collect())
}

/// The job of the `effective.json` in a run folder.
fn job_in(folder: &Path, name: String) -> Option<JobRow> {
    let effective = folder.join("effective.json");
    let started_at = modified(&effective)?;
    let value: Value = serde_json::from_str(&text_of(&effective)?).ok()?;
    let job = value.get("job")?;
    let text = |key: &str| job.get(key).and_then(Value::as_str).unwrap_or_default().to_owned();
    let job = NewJob {
        name: text("name"),
        plate: text("plate"),
        seed: job.get("seed").and_then(Value::as_u64).unwrap_or_default(),
        pace: Pace::RealTime,
        spec_json: String::new(),
        rig_fingerprint: String::new(),
        body_sha256: [0; 32],
        key: None,
    };
    let row = job.row(JobId::from_bytes([0; 16]), started_at);
    Some(JobRow { state: JobState::Running, started_at: Some(started_at), folder: Some(name), ..row })
}
