use super::client::{Client, ClientRefusal};
use crate::cli::output::Failure;
use crate::cli::run_folder::{LAST, only_one};
use upm_server::api::Job;

/// Number of hex digits in an id.
const DIGITS: usize = 32;
/// Number of its last digits that are shown: the first ones are the time, so that those of neighbours are alike.
const SHORT_DIGITS: usize = 6;
/// Newest jobs among which the last one is looked for first.
const NEWEST: u32 = 20;

/// Id of the job that `text` names: an id, the unique beginning or ending of one, the name of a job, the newest of
/// which is meant, or `last` for the last job that a person submitted.
pub(super) fn job_id(client: &Client, text: &str) -> Result<String, Failure> {
    let refusal = |rest: String| Failure::bad_input(format!("ID: expected {rest}"));
    let allowed = "a job's id as `upm jobs` lists it, its beginning or ending, a job's name, or last";
    let wrong = |found: &str| refusal(format!("{allowed}, found {found}"));
    if text == LAST {
        return last(client)?.ok_or_else(|| wrong("no jobs"));
    }
    let is_hex = text.bytes().all(|b| b.is_ascii_digit() || (b'a'..=b'f').contains(&b));
    if is_hex && text.len() == DIGITS {
        return Ok(text.to_owned());
    }
    let jobs = client.jobs(None, u32::MAX)?.jobs;
    if let Some(job) = jobs.iter().find(|job| job.name == text) {
        return Ok(job.id.to_string());
    }
    if !is_hex || text.is_empty() {
        return Err(wrong(&format!("{text:?}")));
    }
    let shown = |job: &Job| format!("{} ({}, {})", job.id, job.name, job.state.code());
    let fits = |id: &str| id.starts_with(text) || id.ends_with(text);
    match only_one(text, &jobs, |job| job.id.to_string(), fits, shown) {
        Ok(Some(job)) => Ok(job.id.to_string()),
        Ok(None) => Err(wrong(&format!("{text:?}, with which no job's id begins or ends"))),
        Err(several) => Err(refusal(format!("more digits of one of {several}; found {text:?}"))),
    }
}

/// Id of the last job that a person submitted: runs of standing jobs are passed over.
fn last(client: &Client) -> Result<Option<String>, ClientRefusal> {
    for most in [NEWEST, u32::MAX] {
        let page = client.jobs(None, most)?;
        if let Some(job) = page.jobs.iter().find(|job| !job.standing) {
            return Ok(Some(job.id.to_string()));
        }
        if page.next.is_none() {
            break;
        }
    }
    Ok(None)
}

/// The ending of an id that tells it from those of `others`, and is long enough to tell it from most.
pub(super) fn short_id(id: &str, others: &[String]) -> String {
    let ending = |digits: usize| id.get(id.len().saturating_sub(digits)..).unwrap_or(id);
    let tells = |digits: &usize| others.iter().all(|other| other == id || !other.ends_with(ending(*digits)));
    ending((SHORT_DIGITS..DIGITS).find(tells).unwrap_or(DIGITS)).to_owned()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn six_digits_are_shown_and_more_where_others_end_alike() {
        let ids = ["0", "10ab", "20ab", "21ab"].map(|end| format!("{end:0>32}"));
        assert_eq!(short_id(&ids[0], &ids[..1]), "000000");
        assert_eq!(short_id(&ids[1], &ids), "0010ab");
        let alike = ["1ffffff", "2ffffff"].map(|end| format!("{end:0>32}"));
        assert_eq!((short_id(&alike[0], &alike), short_id(&alike[0], &[])), ("1ffffff".into(), "ffffff".into()));
    }
}
