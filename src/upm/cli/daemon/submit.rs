use std::path::Path;

use super::client::{Client, ClientRefusal};
use super::job_id::short_id;
use super::watch;
use crate::cli::args::Common;
use crate::cli::client_args::SubmitArgs;
use crate::cli::output::{Failure, print_json};
use upm_core::document::parse;
use upm_core::job::Pace;
use upm_runner::config::{DiagnosticClass, JobFile, JobSpec, MOST_BYTES, Origin, RigSource, text_of};
use upm_server::api::Job;

pub(super) fn submit(args: &SubmitArgs, common: Common) -> Result<u8, Failure> {
    let mut job = sendable(&args.job)?;
    job.seed = args.seed.unwrap_or(job.seed);
    job.plate = args.plate.clone().or(job.plate);
    let body = body_of(&job, &args.job)?;
    let key = match &args.key {
        Some(key) => checked(key)?.to_owned(),
        None => format!("upm-submit-{}-{}", jiff::Timestamp::now().as_nanosecond(), std::process::id()),
    };
    let client = Client::new(&args.daemon)?;
    let queued = queue(&client, &body, args.pace, &key);
    let queued = queued.map_err(|refusal| {
        let may_be_queued = is_open(&refusal);
        let mut failure = refusal.into_failure(&args.job.display().to_string());
        failure.lines.extend(may_be_queued.then(|| format!("it may be queued: repeat the command with --key {key}")));
        failure
    })?;
    match (common.json, args.watch) {
        (true, true) => outln!("{}", serde_json::to_string(&queued).unwrap_or_default())?,
        (true, false) => print_json(&queued)?,
        (false, _) => outln!("{}", short_id(&queued.id.to_string(), &[]))?,
    }
    if args.watch { watch::follow(&client, &queued.id.to_string(), Some(0), common) } else { Ok(0) }
}

/// Queues the job exactly once: if the answer is lost or does not come in time, the request is repeated under the same
/// idempotency key.
pub(super) fn queue(client: &Client, body: &str, pace: Option<Pace>, key: &str) -> Result<Job, ClientRefusal> {
    let path = pace.map_or("/v1/jobs".to_owned(), |pace| format!("/v1/jobs?pace={}", pace.code()));
    let send = || client.post(&path, body, Some(key));
    send().or_else(|refusal| {
        if !is_open(&refusal) {
            return Err(refusal);
        }
        tracing::info!("{}; asking again", refusal.line());
        send()
    })
}

/// True when the job may be queued all the same.
fn is_open(refusal: &ClientRefusal) -> bool {
    matches!(refusal, ClientRefusal::Lost(_) | ClientRefusal::Problem { status: 500.., .. })
}

/// Checked job of the file with all drawings written out, so that it names no other file. The rig is written out, so
/// that a plate with another rig refuses the job, and without its library, which each plate sets itself.
fn sendable(file: &Path) -> Result<JobFile, Failure> {
    let (mut job, warnings): (JobFile, _) = match JobSpec::load(file) {
        Ok(job) => (serde_json::from_value(job.effective()).map_err(Failure::failed)?, job.warnings),
        // a job without a rig runs on that of the plate: the daemon, which knows it, checks the rest
        Err(faults) if faults.iter().all(|fault| fault.path == "rig" && fault.class == DiagnosticClass::Missing) => {
            let text = text_of(file).map_err(Failure::of_files)?;
            let job: JobFile = parse(&text, &file.display().to_string()).map_err(Failure::of_files)?;
            job.with_drawings_written_out(&Origin::of_file(file)).map_err(Failure::faults)?
        }
        Err(faults) => return Err(Failure::of_files(faults)),
    };
    warnings.iter().for_each(|warning| errln!("upm: warning: {warning}"));
    if let Some(RigSource::Inline(rig)) = &mut job.rig {
        rig.library = None;
    }
    Ok(job)
}

fn body_of(job: &JobFile, file: &Path) -> Result<String, Failure> {
    let body = serde_json::to_string(job).map_err(Failure::failed)?;
    if body.len() as u64 > MOST_BYTES {
        let (file, bytes) = (file.display(), body.len());
        let fault = format!("{file}: expected up to 1 MiB (1048576 bytes), found {bytes} bytes with the rig");
        return Err(Failure::bad_input(fault));
    }
    Ok(body)
}

fn checked(key: &str) -> Result<&str, Failure> {
    let is_key = (1..=255).contains(&key.len()) && key.bytes().all(|b| b.is_ascii_graphic());
    let wrong = || Failure::bad_input(format!("--key: expected 1 to 255 visible ASCII characters, found {key:?}"));
    is_key.then_some(key).ok_or_else(wrong)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_job_without_a_rig_is_read_like_any_other() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("job.json");
        let job = r#"{"name": "a", "seed": 2.0, "parts": [{"kind": "dime"}], "task": {"type": "hold"}}"#;
        std::fs::write(&file, format!("\u{feff}{job}")).unwrap();
        assert_eq!(sendable(&file).unwrap().seed, 2);
    }
}
