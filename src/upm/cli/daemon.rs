//! Commands of the daemon: `upm serve`, the client commands.

mod client;
mod job_id;
mod jobs;
mod local_stop;
mod serve;
mod stop;
mod submit;
mod watch;

use super::args::Common;
use super::client_args::ClientCommand;
use super::output::Failure;

pub(super) use serve::{hold_back_sigusr1, serve};

/// Runs a client command.
pub(super) fn client_command(command: &ClientCommand, common: Common) -> Result<u8, Failure> {
    match command {
        ClientCommand::Submit(args) => submit::submit(args, common),
        ClientCommand::Jobs(args) => jobs::jobs(args, common),
        ClientCommand::Show(args) => jobs::show(args, common),
        ClientCommand::Watch(args) => watch::watch(args, common),
        ClientCommand::RunNext(args) => jobs::run_next(args, common),
        ClientCommand::Cancel(args) => jobs::cancel(args, common),
        ClientCommand::Plates(args) => jobs::plates(args, common),
        ClientCommand::Estop(args) => stop::estop(args, common),
        ClientCommand::Reset(args) => stop::reset(args, common),
        ClientCommand::Resume(args) => stop::resume(args, common),
    }
}
