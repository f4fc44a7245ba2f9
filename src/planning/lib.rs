//! From where parts should go to the pulses that bring them there: [`cor_library`], [`task`], [`shapes`], [`planner`].

#![cfg_attr(test, allow(clippy::disallowed_methods))]

pub mod cor_library;
pub mod planner;
mod qp;
pub mod shapes;
pub mod task;
