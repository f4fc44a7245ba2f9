mod events;
mod follow;
mod job_display;
#[cfg(test)]
mod tests;

use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, RecvTimeoutError, sync_channel};
use std::thread;
use std::time::Duration;

use super::client::{Client, job_path};
use super::job_id::job_id;
use super::jobs::plate_line;
use crate::cli::args::Common;
use crate::cli::client_args::JobArgs;
use crate::cli::output::{Failure, INTERRUPTED, NOT_REACHED, reader_left, stop_on_interrupt};
use follow::{StreamFollower, StreamItem};
use job_display::{JobDisplay, job_of};
use upm_server::api::{Job, Plates};
use upm_server::states::JobState;

/// Capacity of the queue of events to be shown.
const WAITING: usize = 64;

/// Interval at which Ctrl-C is polled.
const POLL_INTERVAL: Duration = Duration::from_millis(100);

pub(super) fn watch(args: &JobArgs, common: Common) -> Result<u8, Failure> {
    let client = Client::new(&args.daemon)?;
    follow(&client, &job_id(&client, &args.id)?, None, common)
}

/// Shows the events of a job from byte `after` of its journal on until it ends; `None` for what comes from now on. The
/// exit status is the job's.
pub(super) fn follow(client: &Client, id: &str, after: Option<u64>, common: Common) -> Result<u8, Failure> {
    let path = job_path(id)?;
    let stop = stop_on_interrupt();
    let mut screen = JobDisplay::new(id, common);
    let heard = listen(StreamFollower::new(client.clone(), format!("{path}/events"), after))?;
    let ended = show(client, &heard, &mut screen, &stop);
    screen.finish();
    let Some(()) = ended? else {
        screen.note(&format!("no longer watching; the job goes on (upm watch {id}, upm cancel {id})"));
        return Ok(INTERRUPTED);
    };
    let job: Job = client.get(&path)?;
    screen.ended(&job)?;
    Ok(if job.state == JobState::Completed { 0 } else { NOT_REACHED })
}

/// Starts a thread that runs the follower and returns the channel of its messages, so that this thread can poll Ctrl-C.
fn listen(mut follower: StreamFollower) -> Result<Receiver<StreamItem>, Failure> {
    let (sender, receiver) = sync_channel(WAITING);
    let listen = move || while follower.next().is_some_and(|heard| sender.send(heard).is_ok()) {};
    let thread = thread::Builder::new().name("events".to_owned()).spawn(listen);
    thread.map(|_| receiver).map_err(|error| Failure::failed(format!("no thread for events: {error}")))
}

/// Shows all messages; `None` if Ctrl-C came first, or the reader of stdout has gone.
fn show(
    client: &Client,
    heard: &Receiver<StreamItem>,
    screen: &mut JobDisplay,
    stop: &AtomicBool,
) -> Result<Option<()>, Failure> {
    while !stop.load(Ordering::Relaxed) && !reader_left() {
        match heard.recv_timeout(POLL_INTERVAL) {
            Ok(StreamItem::Event(event)) => {
                screen.show(&event)?;
                if let Some(job) = job_of(&event).filter(|job| job.state == JobState::Queued) {
                    note_plate(client, &job, screen);
                }
            }
            Ok(StreamItem::Lost(why)) => screen.note(&format!("{why}; trying again")),
            Ok(StreamItem::Refused(refusal)) => return Err(refusal.into()),
            Err(RecvTimeoutError::Timeout) => {}
            Err(RecvTimeoutError::Disconnected) => return Ok(Some(())),
        }
    }
    Ok(None)
}

/// Shows the plate that a queued job waits for, with what an operator can do.
fn note_plate(client: &Client, job: &Job, screen: &JobDisplay) {
    let plates = client.get::<Plates>("/v1/plates").map(|plates| plates.plates).unwrap_or_default();
    if let Some(plate) = plates.iter().find(|plate| plate.name == job.plate) {
        screen.note(&plate_line(plate));
    }
}
