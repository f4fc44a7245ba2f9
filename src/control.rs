//! The cycle: look, ask the goal, plan, play, look again; and the supervisor that ends it in good order.

mod facts;

pub use facts::{CycleFacts, EventLevel, FrameFacts, LocalisedFacts, PulseFacts, Sink};
