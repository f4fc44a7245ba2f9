//! The commands of the daemon: `upm serve`, its client commands, the support bundle.

mod bundle;
mod client;
mod jobs;
mod local_stop;
mod serve;
mod signals;
mod stop;
mod submit;
mod watch;

pub(super) use bundle::support_bundle;
pub(super) use client::command as client;
pub(super) use serve::serve;
pub(super) use signals::hold_back as hold_back_signals;
