use upm_control::{
    ConditionFacts, ConfirmedFacts, CycleFacts, EventLevel, FrameFacts, LocalisedFacts, MilestoneFacts, PulseFacts,
    Sink,
};
use upm_core::time::PlateTime;

/// Several sinks as one: each is told everything, in order.
#[derive(Default)]
pub struct Fanout<'a>(Vec<&'a mut dyn Sink>);

impl<'a> Fanout<'a> {
    /// Tells nobody as yet.
    pub fn new() -> Self {
        Self::default()
    }

    /// Tells `sink` as well.
    pub fn with(mut self, sink: &'a mut dyn Sink) -> Self {
        self.0.push(sink);
        self
    }
}

impl Sink for Fanout<'_> {
    fn localised(&mut self, facts: &LocalisedFacts<'_>) {
        self.0.iter_mut().for_each(|sink| sink.localised(facts));
    }

    fn confirmed(&mut self, facts: &ConfirmedFacts<'_>) {
        self.0.iter_mut().for_each(|sink| sink.confirmed(facts));
    }

    fn frame(&mut self, facts: &FrameFacts<'_>) {
        self.0.iter_mut().for_each(|sink| sink.frame(facts));
    }

    fn pulse(&mut self, facts: &PulseFacts<'_>) {
        self.0.iter_mut().for_each(|sink| sink.pulse(facts));
    }

    fn cycle(&mut self, facts: &CycleFacts<'_>) {
        self.0.iter_mut().for_each(|sink| sink.cycle(facts));
    }

    fn event(&mut self, at: PlateTime, level: EventLevel, text: &str) {
        self.0.iter_mut().for_each(|sink| sink.event(at, level, text));
    }

    fn milestone(&mut self, facts: &MilestoneFacts<'_>) {
        self.0.iter_mut().for_each(|sink| sink.milestone(facts));
    }

    fn condition(&mut self, facts: &ConditionFacts<'_>) {
        self.0.iter_mut().for_each(|sink| sink.condition(facts));
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::MemorySink;

    #[test]
    fn tells_every_sink() {
        let (mut a, mut b) = (MemorySink::default(), MemorySink::default());
        Fanout::new().with(&mut a).with(&mut b).event(PlateTime::ZERO, EventLevel::Info, "hello");
        assert_eq!(a.events, b.events);
        assert_eq!(a.events.len(), 1);
    }
}
