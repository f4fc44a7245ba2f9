use super::client::Client;
use crate::cli::output::Failure;
use crate::cli::run_folder::{LAST, by_prefix};
use upm_server::api::Job;

/// Number of hex digits in an id.
const DIGITS: usize = 32;

/// Id of the job that `text` names: an id, a unique prefix of one, or `last` for the job submitted last.
pub(super) fn job_id(client: &Client, text: &str) -> Result<String, Failure> {
    let wrong = |found: &str| {
        let allowed = "32 hex digits, as `upm jobs` lists them, a unique prefix, or last";
        Failure::bad_input(format!("ID: expected {allowed}, found {found}"))
    };
    if text == LAST {
        let newest = client.jobs(None, 1)?.jobs.into_iter().next();
        return newest.map(|job| job.id.to_string()).ok_or_else(|| wrong("no jobs"));
    }
    let is_hex = text.bytes().all(|b| b.is_ascii_digit() || (b'a'..=b'f').contains(&b));
    if !is_hex || !(1..=DIGITS).contains(&text.len()) {
        return Err(wrong(&format!("{text:?}")));
    }
    if text.len() == DIGITS {
        return Ok(text.to_owned());
    }
    let jobs = client.jobs(None, u32::MAX)?.jobs;
    let shown = |job: &Job| format!("{} ({}, {})", job.id, job.name, job.state.code());
    match by_prefix(text, &jobs, |job| job.id.to_string(), shown) {
        Ok(Some(job)) => Ok(job.id.to_string()),
        Ok(None) => Err(wrong(&format!("{text:?}, which no job's id begins with"))),
        Err(several) => {
            Err(Failure::bad_input(format!("ID: expected more digits of one of {several}; found {text:?}")))
        }
    }
}
