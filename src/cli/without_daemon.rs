//! Stand-ins for the commands of the daemon, in a build without it.

use super::args::{Common, ServeArgs};
use super::client_args::ClientCommand;
use super::features::{DAEMON, lacking};
use super::output::Failure;

/// Does nothing: only a daemon handles SIGUSR1.
pub(super) fn hold_back_sigusr1() {}

pub(super) fn serve(_: &ServeArgs, _: Common) -> Result<u8, Failure> {
    Err(lacking(DAEMON, "upm serve"))
}

pub(super) fn client_command(command: &ClientCommand, _: Common) -> Result<u8, Failure> {
    Err(lacking(DAEMON, &format!("upm {}", command.name())))
}
