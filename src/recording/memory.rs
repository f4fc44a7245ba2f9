use super::records::{CycleRecord, EventRecord, PulseRecord};
use upm_control::{CycleFacts, EventLevel, FrameFacts, MilestoneFacts, PulseFacts, Sink};
use upm_core::time::PlateTime;

/// A sink that keeps everything except the pictures, for tests.
#[derive(Clone, Debug, Default)]
pub struct MemorySink {
    /// Number of frames tracked.
    pub frames: u64,
    /// Every pulse.
    pub pulses: Vec<PulseRecord>,
    /// Every cycle.
    pub cycles: Vec<CycleRecord>,
    /// Every event.
    pub events: Vec<EventRecord>,
}

impl Sink for MemorySink {
    fn frame(&mut self, _facts: &FrameFacts<'_>) {
        self.frames += 1;
    }

    fn pulse(&mut self, facts: &PulseFacts<'_>) {
        self.pulses.push(facts.into());
    }

    fn cycle(&mut self, facts: &CycleFacts<'_>) {
        self.cycles.push(facts.into());
    }

    fn event(&mut self, at: PlateTime, level: EventLevel, text: &str) {
        self.events.push(EventRecord::new(at, level, text));
    }

    fn milestone(&mut self, facts: &MilestoneFacts<'_>) {
        self.events.push(facts.into());
    }
}
