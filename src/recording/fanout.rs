use upm_control::{ConfirmedFacts, CycleFacts, EventFacts, FrameFacts, LocalisedFacts, PulseFacts, Sink};
use upm_core::time::PlateTime;
use upm_planning::task::Setpoints;

/// Several sinks as one: each receives every fact, in order.
#[derive(Default)]
pub struct Fanout<'a> {
    /// The sinks; each receives every fact after those before it.
    pub sinks: Vec<&'a mut dyn Sink>,
    /// Called after each frame, once all sinks have received it: a check for events from outside the run.
    pub after_frame: Option<&'a mut AfterFrame<'a>>,
}

/// Receives the sinks to report to and the frame's time.
type AfterFrame<'a> = dyn FnMut(&mut dyn Sink, PlateTime) + 'a;

impl Sink for Fanout<'_> {
    fn localised(&mut self, facts: &LocalisedFacts<'_>) {
        self.sinks.iter_mut().for_each(|sink| sink.localised(facts));
    }

    fn confirmed(&mut self, facts: &ConfirmedFacts<'_>) {
        self.sinks.iter_mut().for_each(|sink| sink.confirmed(facts));
    }

    fn setpoints(&mut self, at: PlateTime, wanted: &Setpoints) {
        self.sinks.iter_mut().for_each(|sink| sink.setpoints(at, wanted));
    }

    fn frame(&mut self, facts: &FrameFacts<'_>) {
        self.sinks.iter_mut().for_each(|sink| sink.frame(facts));
        if let Some(hook) = self.after_frame.take() {
            hook(self, facts.frame.exposed_at);
            self.after_frame = Some(hook);
        }
    }

    fn pulse(&mut self, facts: &PulseFacts) {
        self.sinks.iter_mut().for_each(|sink| sink.pulse(facts));
    }

    fn cycle(&mut self, facts: &CycleFacts) {
        self.sinks.iter_mut().for_each(|sink| sink.cycle(facts));
    }

    fn event(&mut self, event: &EventFacts) {
        self.sinks.iter_mut().for_each(|sink| sink.event(event));
    }
}
