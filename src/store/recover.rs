use std::cell::Cell;
use std::fs;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::Path;

use rusqlite::{Connection, params};
use serde_json::Value;

use super::books::Books;
use super::columns::{At, JOB, job_of};
use super::ids::Ids;
use super::open::{Opening, RepairRecording};
use super::places::Places;
use super::salvage::{folders_of, from_folders, modified, text_of};
use super::{JobEnd, JobRow, JobState, Mended, RecordingKept, Recovery, StoreFault};
use crate::time::PlateTime;

/// Puts in order what the last daemon left: how its running jobs ended, recordings that were not closed, who stays
/// paused. Nothing else has the store as yet. Killed anywhere, doing it again comes to the same.
pub(super) fn recover(
    connection: &mut Connection,
    places: &Places,
    opening: &Opening<'_>,
    found: &mut Recovery,
) -> Result<(), StoreFault> {
    if found.damage.is_some() {
        from_folders(places, connection)?;
    }
    let left = left_open(connection)?;
    mark_partial(connection, places, &left)?;
    let mut ends = Vec::new();
    for job in left {
        let folder = job.folder.as_ref().map(|name| places.runs.join(name));
        let recording = folder.as_ref().map_or(job.recording, |folder| settle(folder, &job, opening.repair, found));
        let end = (job.state == JobState::Running).then(|| end_of(folder.as_deref(), recording));
        ends.push((job, folder, recording, end));
    }
    let tx = connection.transaction()?;
    let (ids, told) = (Ids::above(None), Cell::new(0));
    let books = Books { tx: &tx, ids: &ids, limits: opening.limits, now: (opening.now)(), told: &told };
    for (job, folder, recording, end) in &ends {
        tx.execute("UPDATE jobs SET recording = ?2 WHERE id = ?1", params![job.id, recording])?;
        let Some(end) = end else { continue };
        books.end(&job.id, JobState::Running, end)?;
        let at = folder.as_ref().and_then(|folder| last_sign(folder)).unwrap_or(books.now);
        let sql = "UPDATE jobs SET finished_at = ?2 WHERE id = ?1";
        tx.execute(sql, params![job.id, At(at.max(job.submitted_at))])?;
        let list = if end.state == JobState::Interrupted { &mut found.interrupted } else { &mut found.ended };
        list.push(job.id);
    }
    found.paused = pause(&tx, opening.plates, found.clean)?;
    let known = folders_of(&tx)?;
    let orphans = places.run_names()?.into_iter().filter(|name| !known.contains(name));
    // one that is empty was made for a job that did not come to begin
    let left = orphans.map(|name| places.runs.join(name)).filter(|folder| fs::remove_dir(folder).is_err());
    found.orphans = left.collect();
    tx.execute("UPDATE meta SET clean_shutdown = 0", [])?;
    tx.commit()?;
    ends.iter().filter_map(|(_, folder, ..)| folder.as_deref()).for_each(give_back_room);
    Ok(())
}

/// A journal that was not closed may still have room set aside beyond its end. It is no matter when that stays.
fn give_back_room(folder: &Path) {
    let journal = fs::OpenOptions::new().append(true).open(folder.join("journal.jsonl"));
    let _ = journal.and_then(|file| file.set_len(file.metadata()?.len()));
}

/// Jobs that were running, and those whose recording was not closed.
fn left_open(connection: &Connection) -> Result<Vec<JobRow>, StoreFault> {
    let sql = format!("SELECT {JOB} FROM jobs WHERE state = 'running' OR recording = 'partial' ORDER BY id");
    let mut statement = connection.prepare(&sql)?;
    Ok(statement.query_map([], job_of)?.collect::<Result<_, _>>()?)
}

/// Notes which recordings are about to be repaired: a start that is killed after a repair must still know of it.
fn mark_partial(connection: &mut Connection, places: &Places, left: &[JobRow]) -> Result<(), StoreFault> {
    let tx = connection.transaction()?;
    for job in left {
        let part = job.folder.as_ref().map(|name| places.runs.join(name).join("run.rrd.part"));
        if part.is_some_and(|part| part.exists()) {
            tx.execute("UPDATE jobs SET recording = 'partial' WHERE id = ?1", [job.id])?;
        }
    }
    Ok(tx.commit()?)
}

/// Repairs the recording in a run folder where that is needed, and tells what there is of it now.
fn settle(folder: &Path, job: &JobRow, repair: RepairRecording<'_>, found: &mut Recovery) -> RecordingKept {
    let (part, whole) = (folder.join("run.rrd.part"), folder.join("run.rrd"));
    if !part.exists() {
        return match (whole.exists(), job.recording) {
            (true, RecordingKept::Partial) => RecordingKept::Recovered,
            (true, RecordingKept::None) => RecordingKept::Whole,
            (true, kept) => kept,
            (false, _) => RecordingKept::None,
        };
    }
    // what reads damaged files may stumble over them; a start must not
    let repaired = catch_unwind(AssertUnwindSafe(|| repair(&part, &whole)));
    let repaired = repaired.unwrap_or_else(|_| Err("the repair failed on it".to_owned()));
    let kept = match &repaired {
        Ok(Mended { was_whole: true, .. }) => RecordingKept::Whole,
        Ok(_) => RecordingKept::Recovered,
        Err(reason) => {
            tracing::warn!("{}: not repaired: {reason}", part.display());
            RecordingKept::Partial
        }
    };
    if repaired.is_ok() && part.exists() {
        // repaired into another file; one that stays is repaired once more
        let _ = fs::remove_file(&part);
    }
    found.repaired.push((whole, repaired));
    kept
}

/// How a job ended that was running: as its report says, if it had come so far.
fn end_of(folder: Option<&Path>, recording: RecordingKept) -> JobEnd {
    let report_json = folder.and_then(|folder| text_of(&folder.join("report.json")));
    let report: Option<Value> = report_json.as_deref().and_then(|text| serde_json::from_str(text).ok());
    let text = |key: &str| report.as_ref().and_then(|report| report.get(key)).and_then(Value::as_str);
    let at_s = report.as_ref().and_then(|report| report.get("plate_time_s")).and_then(Value::as_f64);
    let at = PlateTime::from_secs(at_s.unwrap_or_default());
    match text("outcome").and_then(JobState::of_name).filter(|state| state.is_final()) {
        Some(state) => {
            JobEnd { at, state, reason: text("reason").unwrap_or_default().to_owned(), report_json, recording }
        }
        None => JobEnd {
            at,
            state: JobState::Interrupted,
            reason: "the daemon ended while it ran".to_owned(),
            report_json: None,
            recording,
        },
    }
}

/// When a run last wrote anything that is known to come late.
fn last_sign(folder: &Path) -> Option<jiff::Timestamp> {
    ["report.json", "journal.jsonl", "effective.json"].iter().find_map(|name| modified(&folder.join(name)))
}

/// Pauses every plate that has work waiting, that was paused, or, after anything but an orderly end, any. Told are
/// those of `plates`.
fn pause(tx: &Connection, plates: &[String], clean: bool) -> rusqlite::Result<Vec<String>> {
    for plate in plates {
        let sql =
            "INSERT INTO plates VALUES (?1, ?2 OR EXISTS (SELECT 1 FROM jobs WHERE plate = ?1 AND state = 'queued'))
                   ON CONFLICT (name) DO UPDATE SET paused = paused OR excluded.paused";
        tx.execute(sql, params![plate, !clean])?;
    }
    let mut statement = tx.prepare("SELECT name FROM plates WHERE paused")?;
    let paused = statement.query_map([], |row| row.get(0))?.collect::<Result<Vec<String>, _>>()?;
    Ok(plates.iter().filter(|plate| paused.contains(plate)).cloned().collect())
}
