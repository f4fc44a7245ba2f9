//! The daemon's assembly: store, plates and the HTTP service in front of them, plus the parts for unattended operation:
//! metrics, readiness and the operator page.

mod backend;
mod convert;
mod estop;
mod estop_socket;
mod files;
mod health;
mod metrics;
mod prepare;
mod recovery_log;
mod start;
mod state;
mod status;
mod submit;
mod systemd;
#[cfg(test)]
mod tests;

pub use estop_socket::{ESTOP_SOCKET, EmergencyStops, LocalStop, LocalStopAnswer, LocalStopRequest, stop_locally};
pub use prepare::{Prepared, keep_files_private, prepare};
pub use start::{Daemon, ExitReport, StartFault};
