use super::report::RecordingReport;
use super::switch::RecordingSwitch;
use upm_control::{
    ConditionFacts, ConfirmedFacts, CycleFacts, EventLevel, FrameFacts, LocalisedFacts, Milestone, MilestoneFacts,
    PulseFacts, Sink,
};
use upm_core::time::PlateTime;

/// Passes everything on to `sinks`, and after each frame looks whether there is something to tell them that comes from
/// outside the run: `then`, with the frame's time.
pub struct Herald<'a, F> {
    sinks: &'a mut dyn Sink,
    then: F,
}

impl<'a, F: FnMut(&mut dyn Sink, PlateTime)> Herald<'a, F> {
    /// Has `then` look on behalf of `sinks`.
    pub fn new(sinks: &'a mut dyn Sink, then: F) -> Self {
        Self { sinks, then }
    }
}

/// Tells `sinks`, once, when a recording has ended before its run did.
pub fn tell_recording(recording: &RecordingSwitch, sinks: &mut dyn Sink, at: PlateTime) {
    if let Some(RecordingReport { code, text }) = recording.news() {
        let milestone = Milestone::RecordingEnded(code);
        sinks.milestone(&MilestoneFacts { at, level: EventLevel::Warning, milestone, text: &text });
    }
}

impl<F: FnMut(&mut dyn Sink, PlateTime)> Sink for Herald<'_, F> {
    fn localised(&mut self, facts: &LocalisedFacts<'_>) {
        self.sinks.localised(facts);
    }

    fn confirmed(&mut self, facts: &ConfirmedFacts<'_>) {
        self.sinks.confirmed(facts);
    }

    fn frame(&mut self, facts: &FrameFacts<'_>) {
        self.sinks.frame(facts);
        (self.then)(self.sinks, facts.frame.exposed_at);
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

    fn milestone(&mut self, facts: &MilestoneFacts<'_>) {
        self.sinks.milestone(facts);
    }

    fn condition(&mut self, facts: &ConditionFacts<'_>) {
        self.sinks.condition(facts);
    }
}
