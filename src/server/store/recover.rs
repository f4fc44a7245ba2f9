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
use super::{JobRow, JobState, RecoveryReport, StoreFault};
use unfinished::{end_of, last_write};

/// Recovers the state that the last daemon left: ends of its running jobs, paused plates. Runs before the store is
/// shared. Idempotent: safe to repeat after a crash at any point.
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
    let left = rows(connection, &format!("SELECT {JOB} FROM jobs WHERE state = 'running' ORDER BY id"), [], job_of)?;
    // whatever the last daemon recorded: it did not complete the end of these
    found.clean &= left.is_empty();
    let mut ends = Vec::new();
    for job in left {
        let folder = job.folder.as_ref().map(|name| dir.runs.join(name));
        let end = end_of(folder.as_deref());
        ends.push((job, folder, end));
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
    for (job, folder, end) in &ends {
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
