mod unfinished;

use std::cell::Cell;
use std::fs;

use rusqlite::{Connection, OptionalExtension, params};

use super::ages::Uptime;
use super::columns::{JOB, Micros, job_of, rows};
use super::ids::Ids;
use super::layout::DataDir;
use super::options::OpenOptions;
use super::salvage::{folders_of, from_folders, have_begun};
use super::write_tx::WriteTx;
use super::{JobRow, JobState, RecordingStatus, RecoveryReport, StoreFault};
use unfinished::{end_of, last_write, repair_recording};

/// Recovers the state that the last daemon left: ends of its running jobs, recordings that were not closed, paused
/// plates. Runs before the store is shared. Idempotent: safe to repeat after a crash at any point.
pub(super) fn recover(
    connection: &mut Connection,
    dir: &DataDir,
    options: &OpenOptions<'_>,
    found: &mut RecoveryReport,
) -> Result<(), StoreFault> {
    have_begun(dir, connection)?;
    if found.damage.is_some() {
        from_folders(dir, connection)?;
    }
    let left = left_open(connection, dir)?;
    // whatever the last daemon recorded: it did not complete the end of these
    found.clean &= left.iter().all(|job| job.state != JobState::Running);
    mark_partial(connection, dir, &left)?;
    let mut ends = Vec::new();
    for job in left {
        let folder = job.folder.as_ref().map(|name| dir.runs.join(name));
        let recording =
            folder.as_ref().map_or(job.recording, |folder| repair_recording(folder, &job, options.repair, found));
        let end = (job.state == JobState::Running).then(|| end_of(folder.as_deref(), recording));
        ends.push((job, folder, recording, end));
    }
    let tx = connection.transaction()?;
    let (ids, uncounted, now) = (Ids::above(None), Cell::new(0), (options.clocks.wall)());
    let uptime = uptime(&tx)?;
    let write = WriteTx {
        connection: &tx,
        ids: &ids,
        limits: options.limits,
        runs: &dir.runs,
        now,
        uptime,
        uncounted: &uncounted,
    };
    for (job, folder, recording, end) in &ends {
        tx.execute("UPDATE jobs SET recording = ?2 WHERE id = ?1", params![job.id, recording])?;
        let Some(end) = end else { continue };
        write.end(&job.id, JobState::Running, end)?;
        let at = folder.as_ref().and_then(|folder| last_write(folder)).unwrap_or(write.now);
        let sql = "UPDATE jobs SET finished_at = ?2 WHERE id = ?1";
        tx.execute(sql, params![job.id, Micros(at.max(job.started_at.unwrap_or(job.submitted_at)))])?;
        let list = if end.state == JobState::Interrupted { &mut found.interrupted } else { &mut found.ended };
        list.push(job.id);
    }
    found.known = if found.damage.is_some() { options.plates.to_vec() } else { known(&tx)? };
    found.paused_after = paused_after(&tx, options.plates)?;
    found.paused = pause(&tx, options.plates, found.clean)?;
    let owned = folders_of(&tx)?;
    let orphans = dir.run_names()?.into_iter().filter(|name| !owned.contains(name));
    // an empty folder was made for a job that did not begin
    let left = orphans.map(|name| dir.runs.join(name)).filter(|folder| fs::remove_dir(folder).is_err());
    found.orphans = left.collect();
    tx.execute("UPDATE meta SET clean_shutdown = 0", [])?;
    tx.commit()?;
    Ok(())
}

/// Jobs that were running, and jobs whose recording still needs repair.
fn left_open(connection: &Connection, dir: &DataDir) -> Result<Vec<JobRow>, StoreFault> {
    let sql =
        format!("SELECT {JOB} FROM jobs WHERE state = 'running' OR recording IN ('partial', 'failed') ORDER BY id");
    let mut left = rows(connection, &sql, [], job_of)?;
    left.retain(|job| job.recording != RecordingStatus::Failed || has_part(dir, job));
    Ok(left)
}

/// True when a job's run folder holds a recording that was not closed.
fn has_part(dir: &DataDir, job: &JobRow) -> bool {
    let part = |name: &String| dir.runs.join(name).join("run.rrd.part");
    job.folder.as_ref().is_some_and(|name| fs::symlink_metadata(part(name)).is_ok())
}

/// Marks the recordings that are about to be repaired: a start that is killed after a repair must still know of it.
fn mark_partial(connection: &mut Connection, dir: &DataDir, left: &[JobRow]) -> Result<(), StoreFault> {
    let tx = connection.transaction()?;
    for job in left.iter().filter(|job| has_part(dir, job)) {
        tx.execute("UPDATE jobs SET recording = 'partial' WHERE id = ?1", [job.id])?;
    }
    Ok(tx.commit()?)
}

/// Time that the store was open before this start.
pub(super) fn uptime(connection: &Connection) -> rusqlite::Result<Uptime> {
    connection.query_row("SELECT uptime FROM clock", [], |row| row.get(0))
}

/// Plates that earlier starts had configured.
fn known(tx: &Connection) -> rusqlite::Result<Vec<String>> {
    rows(tx, "SELECT name FROM plates ORDER BY name", [], |row| row.get(0))
}

/// The newest ended job of each of `plates` that are paused.
fn paused_after(tx: &Connection, plates: &[String]) -> rusqlite::Result<Vec<JobRow>> {
    let sql = format!(
        "SELECT {JOB} FROM jobs WHERE plate = ?1 AND finished_at IS NOT NULL
             AND EXISTS (SELECT 1 FROM plates WHERE name = ?1 AND paused) ORDER BY finished_at DESC LIMIT 1"
    );
    let mut statement = tx.prepare(&sql)?;
    let last = plates.iter().map(|plate| statement.query_row([plate], job_of).optional());
    last.filter_map(Result::transpose).collect()
}

/// Pauses every plate that has queued jobs or was paused already, and after anything except an orderly shutdown every
/// plate. Returns the paused ones of `plates`.
fn pause(tx: &Connection, plates: &[String], clean: bool) -> rusqlite::Result<Vec<String>> {
    for plate in plates {
        let sql =
            "INSERT INTO plates VALUES (?1, ?2 OR EXISTS (SELECT 1 FROM jobs WHERE plate = ?1 AND state = 'queued'))
                   ON CONFLICT (name) DO UPDATE SET paused = paused OR excluded.paused";
        tx.execute(sql, params![plate, !clean])?;
    }
    let paused: Vec<String> = rows(tx, "SELECT name FROM plates WHERE paused", [], |row| row.get(0))?;
    Ok(plates.iter().filter(|plate| paused.contains(plate)).cloned().collect())
}
