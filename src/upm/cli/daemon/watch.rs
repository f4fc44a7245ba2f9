mod follow;
mod job_display;
#[cfg(test)]
mod tests;

use super::client::{Client, job_path};
use super::job_id::job_id;
use super::jobs::plate_line;
use crate::cli::args::Common;
use crate::cli::client_args::JobArgs;
use crate::cli::output::{Failure, INTERRUPTED, NOT_REACHED, reader_left};
use crate::cli::signals;
use follow::{StreamFollower, StreamItem, job_of};
use job_display::{note, show, show_end};
use upm_server::api::{Job, Plates};
use upm_server::states::JobState;

pub(super) fn watch(args: &JobArgs, common: Common) -> Result<u8, Failure> {
    let client = Client::new(&args.daemon)?;
    follow(&client, &job_id(&client, &args.id)?, None, common)
}

/// Shows the events of a job from byte `after` of its journal on until it ends; `None` for what comes from now on. The
/// exit status is the job's; Ctrl-C ends the process.
pub(super) fn follow(client: &Client, id: &str, after: Option<u64>, common: Common) -> Result<u8, Failure> {
    let path = job_path(id);
    let left = format!("no longer watching; the job goes on (upm watch {id}, upm cancel {id})");
    let interrupted = left.clone();
    signals::attend(signals::ending(), move || {
        note(&interrupted, common);
        std::process::exit(i32::from(INTERRUPTED));
    });
    let mut follower = StreamFollower::new(client.clone(), format!("{path}/events"), after);
    while let Some(item) = follower.next() {
        match item {
            StreamItem::Event(event) => {
                show(&event, common)?;
                if let Some(job) = job_of(&event).filter(|job| job.state == JobState::Queued) {
                    let plates = client.get::<Plates>("/v1/plates").map(|plates| plates.plates).unwrap_or_default();
                    let plate = plates.iter().find(|plate| plate.name == job.plate);
                    plate.into_iter().for_each(|plate| note(&plate_line(plate), common));
                }
            }
            StreamItem::Lost(why) => note(&format!("{why}; trying again"), common),
            StreamItem::Refused(refusal) => return Err(refusal.into()),
        }
        if reader_left() {
            note(&left, common);
            return Ok(INTERRUPTED);
        }
    }
    let job: Job = client.get(&path)?;
    show_end(&job, common)?;
    Ok(if job.state == JobState::Completed { 0 } else { NOT_REACHED })
}
