//! The daemon's assembly: store, plates and the HTTP service in front of them, plus the parts for unattended operation:
//! metrics, readiness, the operator page and the support bundle.

mod answers;
mod bundle;
mod data_watch;
mod desk;
mod estop_socket;
mod files;
mod health;
mod metrics;
mod observed;
mod page;
mod prepare;
mod recovered;
mod start;
mod state;
mod stops;
mod submit;
mod systemd;
#[cfg(test)]
mod tests;

pub use bundle::{Bundle, BundleSources, bundle};
pub use estop_socket::{ESTOP_SOCKET, EmergencyStops, LocalStop, LocalStopAnswer, LocalStopRequest, stop_locally};
pub use prepare::{Prepared, keep_files_private, prepare};
pub use start::{Daemon, Ended, StartFault, TokenReload};
pub use systemd::{Notice, ServiceManager, SignsOfLife};
