//! The daemon: a job store, a supervisor of the plates that run jobs, the HTTP [`api`] on the server of
//! [`http`], and the [`daemon`] that joins them.

pub mod api;
pub mod daemon;
pub mod http;
pub mod states;
mod store;
mod supervisor;
