use super::switch::RecordingSwitch;
use crate::control::{CycleFacts, EventLevel, FrameFacts, LocalisedFacts, PulseFacts, Sink};
use crate::time::PlateTime;

/// Passes everything on to `sinks` and tells them, as an event, when the recording ends before the run does.
pub struct Herald<'a> {
    sinks: &'a mut dyn Sink,
    recording: RecordingSwitch,
}

impl<'a> Herald<'a> {
    /// Tells `sinks` of `recording`.
    pub fn new(sinks: &'a mut dyn Sink, recording: &RecordingSwitch) -> Self {
        Self { sinks, recording: recording.clone() }
    }

    /// Tells what is new of the recording.
    pub fn tell(&mut self, at: PlateTime) {
        if let Some(text) = self.recording.news() {
            self.sinks.event(at, EventLevel::Warning, &text);
        }
    }
}

impl Sink for Herald<'_> {
    fn localised(&mut self, facts: &LocalisedFacts<'_>) {
        self.sinks.localised(facts);
    }

    fn frame(&mut self, facts: &FrameFacts<'_>) {
        self.sinks.frame(facts);
        self.tell(facts.frame.exposed_at);
    }

    fn pulse(&mut self, facts: &PulseFacts<'_>) {
        self.sinks.pulse(facts);
    }

    fn cycle(&mut self, facts: &CycleFacts<'_>) {
        self.sinks.cycle(facts);
    }

    fn event(&mut self, at: PlateTime, level: EventLevel, text: &str) {
        self.sinks.event(at, level, text);
    }
}
