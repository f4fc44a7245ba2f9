mod events;
mod follow;
mod screen;
#[cfg(test)]
mod tests;

use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, RecvTimeoutError, sync_channel};
use std::thread;
use std::time::Duration;

use super::client::{Client, job_path};
use super::job_id::job_id;
use crate::cli::args::Common;
use crate::cli::client_args::JobArgs;
use crate::cli::output::{Failure, INTERRUPTED, NOT_REACHED, stop_on_interrupt};
use follow::{Follower, Heard};
use screen::Screen;
use upm_server::service::{Job, JobState};

/// Events that wait to be shown.
const WAITING: usize = 64;

/// How often Ctrl-C is looked at.
const LOOK: Duration = Duration::from_millis(100);

pub(super) fn watch(args: &JobArgs, common: Common) -> Result<u8, Failure> {
    let client = Client::new(&args.daemon)?;
    follow(&client, &job_id(&client, &args.id)?, None, common)
}

/// Shows what happens to a job until it ends, what comes after the event `after` first. The exit status is the job's.
pub(super) fn follow(client: &Client, id: &str, after: Option<u64>, common: Common) -> Result<u8, Failure> {
    let path = job_path(id)?;
    let stop = stop_on_interrupt();
    let mut screen = Screen::new(id, common);
    let heard = listen(Follower::new(client.clone(), format!("{path}/events"), after))?;
    let ended = show(&heard, &mut screen, &stop);
    screen.finish();
    let Some(()) = ended? else {
        screen.note(&format!("no longer watching; the job goes on (upm watch {id}, upm cancel {id})"));
        return Ok(INTERRUPTED);
    };
    let job: Job = client.get(&path)?;
    screen.ended(&job)?;
    Ok(if job.state == JobState::Completed { 0 } else { NOT_REACHED })
}

/// Messages of the follower, which runs on another thread: this one polls Ctrl-C.
fn listen(mut follower: Follower) -> Result<Receiver<Heard>, Failure> {
    let (sender, receiver) = sync_channel(WAITING);
    let listen = move || while follower.next().is_some_and(|heard| sender.send(heard).is_ok()) {};
    let thread = thread::Builder::new().name("events".to_owned()).spawn(listen);
    thread.map(|_| receiver).map_err(|error| Failure::failed(format!("no thread for events: {error}")))
}

/// Shows all that is heard; `None` when Ctrl-C came first.
fn show(heard: &Receiver<Heard>, screen: &mut Screen, stop: &AtomicBool) -> Result<Option<()>, Failure> {
    while !stop.load(Ordering::Relaxed) {
        match heard.recv_timeout(LOOK) {
            Ok(Heard::Event(event)) => screen.show(&event)?,
            Ok(Heard::Lost(why)) => screen.note(&format!("{why}; trying again")),
            Ok(Heard::Refused(refusal)) => return Err(refusal.into()),
            Err(RecvTimeoutError::Timeout) => {}
            Err(RecvTimeoutError::Disconnected) => return Ok(Some(())),
        }
    }
    Ok(None)
}
