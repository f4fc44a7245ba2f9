//! The daemon as a subprocess, with the client commands and with raw sockets.
#![cfg(target_os = "linux")]
#![allow(clippy::unwrap_used, clippy::panic)] // a test that cannot go on shall say so
#![allow(clippy::disallowed_methods)] // how long the daemon takes is seen on a clock

#[path = "daemon/auth.rs"]
mod auth;
#[path = "daemon/bad_input.rs"]
mod bad_input;
#[path = "daemon/client.rs"]
mod client;
#[path = "daemon/daemon_process.rs"]
mod daemon_process;
#[path = "daemon/fail_safe.rs"]
mod fail_safe;
#[path = "daemon/http.rs"]
mod http;
#[path = "daemon/ids.rs"]
mod ids;
#[path = "daemon/keys.rs"]
mod keys;
#[path = "daemon/local_stop.rs"]
mod local_stop;
#[path = "daemon/recovery.rs"]
mod recovery;
#[path = "daemon/shutdown.rs"]
mod shutdown;
#[path = "daemon/standing.rs"]
mod standing;
