use rusqlite::{OptionalExtension, params};

use super::books::Books;
use super::columns::At;
use super::{JobId, NewJob};

/// What is known of a key.
#[derive(Debug)]
pub(super) enum Seen {
    /// It came with the same body, for this job.
    Same(JobId),
    /// It came with another body.
    Other,
}

impl Books<'_> {
    /// What is known of a job's key; nothing when it has none, or it came too long ago.
    pub fn seen(&self, job: &NewJob) -> rusqlite::Result<Option<Seen>> {
        let Some(key) = &job.key else { return Ok(None) };
        let sql = "SELECT body_sha256, job FROM keys WHERE key = ?1 AND uptime >= ?2";
        let oldest = self.ages.cutoff(self.limits.keys_kept);
        let known = self.tx.query_row(sql, params![key, oldest], |row| Ok((row.get::<_, [u8; 32]>(0)?, row.get(1)?)));
        let seen = |(body, id)| if body == job.body_sha256 { Seen::Same(id) } else { Seen::Other };
        Ok(known.optional()?.map(seen))
    }

    /// Remembers a key, in place of one that came too long ago.
    pub fn remember(&self, key: &str, body_sha256: &[u8; 32], id: &JobId) -> rusqlite::Result<()> {
        let sql = "INSERT OR REPLACE INTO keys (key, body_sha256, job, at, uptime) VALUES (?1, ?2, ?3, ?4, ?5)";
        self.tx.execute(sql, params![key, body_sha256, id, At(self.now), self.ages.now]).map(|_| ())
    }

    /// Forgets keys that came too long ago.
    pub fn forget_keys(&self) -> rusqlite::Result<()> {
        let oldest = self.ages.cutoff(self.limits.keys_kept);
        self.tx.execute("DELETE FROM keys WHERE uptime < ?1", [oldest]).map(|_| ())
    }
}
