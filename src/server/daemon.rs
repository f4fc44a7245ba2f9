//! The daemon's assembly: store, plates and the HTTP service in front of them, and what it tells the service manager.

mod estop_socket;
mod prepare;
mod start;
#[cfg(test)]
mod tests;

pub use crate::store::StoreError;
pub use estop_socket::{ESTOP_SOCKET, EmergencyStops, LocalStopAnswer, LocalStopRequest, stop_locally};
pub use prepare::{Prepared, keep_files_private, prepare};
pub use start::{Daemon, ExitReport, StartError};
