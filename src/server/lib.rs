//! The daemon: a job [`store`], [`plates`] that run jobs, the HTTP [`service`], and the [`daemon`] that joins them.

pub mod daemon;
pub mod plates;
pub mod service;
pub mod states;
pub mod store;
