//! The daemon's assembly: store, plates and the HTTP service in front of them, and what it tells the service manager.

mod estop_socket;
mod prepare;
mod recovery_log;
mod start;
mod systemd;
#[cfg(test)]
mod tests;

pub use estop_socket::{ESTOP_SOCKET, EmergencyStops, LocalStop, LocalStopAnswer, LocalStopRequest, stop_locally};
pub use prepare::{Prepared, keep_files_private, prepare};
pub use start::{Daemon, ExitReport, StartFault};
