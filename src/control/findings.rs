//! Lasting findings: each is reported once when it begins and once when it ends, with the number of cycles in which
//! it held.

use super::found::{Found, Reason};
use super::{EventFacts, EventKind, EventLevel, Sink};
use upm_core::job::{Effect, Finding};
use upm_core::time::PlateTime;

/// Number of consecutive cycles without a finding after which it has ended: a plan that fails every other cycle is
/// one finding.
const QUIET_CYCLES: u64 = 20;
/// Time after which a finding of the camera that no longer holds has ended, s.
const QUIET_S: f64 = 0.5;

/// The findings of a run that hold at present.
#[derive(Clone, Debug, Default)]
pub(super) struct Findings {
    active: Vec<Active>,
    cycle: u64,
}

#[derive(Clone, Debug)]
struct Active {
    found: Found,
    /// The reason reported at its beginning, without the remedy.
    reason: Reason,
    began_at: PlateTime,
    last_at: PlateTime,
    last_cycle: u64,
    times: u64,
}

impl Active {
    /// True for a finding that has not held for a while. One of the camera is noted in every frame while it holds.
    fn is_over(&self, at: PlateTime, cycle: u64) -> bool {
        let finding = self.found.finding;
        let is_of_sight = finding.effect() == Effect::Waits && finding != Finding::TableMissing;
        self.last_cycle + QUIET_CYCLES <= cycle || is_of_sight && at - self.last_at > QUIET_S
    }
}

impl Findings {
    /// True while `found` is reported as begun and not as ended.
    pub fn holds(&self, found: Found) -> bool {
        self.active.iter().any(|active| active.found == found)
    }

    /// Notes that `found` holds in the present cycle. If it has just begun, reports it to `sink` with `reason` and
    /// its remedy.
    pub fn note(&mut self, at: PlateTime, found: impl Into<Found>, reason: impl Into<Reason>, sink: &mut dyn Sink) {
        let (found, reason) = (found.into(), reason.into());
        let cycle = self.cycle;
        match self.active.iter_mut().find(|active| active.found == found) {
            Some(active) if active.last_cycle == cycle => active.last_at = at,
            Some(active) => (active.last_at, active.last_cycle, active.times) = (at, cycle, active.times + 1),
            None => {
                let text = format!("{reason}; {}", found.finding.check());
                let kind = EventKind::Finding { found, ended_after: None, reason: reason.clone() };
                sink.event(&EventFacts { at, level: EventLevel::Warning, text, kind });
                self.active.push(Active { found, reason, began_at: at, last_at: at, last_cycle: cycle, times: 1 });
            }
        }
    }

    /// Ends the present cycle. Reports to `sink` the findings that have not held for a while as ended.
    pub fn end_cycle(&mut self, at: PlateTime, sink: &mut dyn Sink) {
        self.end(at, "no longer", sink, Active::is_over);
        self.cycle += 1;
    }

    /// Ends the run. Reports to `sink` every finding that held until now as ended.
    pub fn end_run(&mut self, at: PlateTime, sink: &mut dyn Sink) {
        self.end(at, "no longer", sink, Active::is_over);
        self.end(at, "until the end", sink, |_, _, _| true);
    }

    fn end(&mut self, at: PlateTime, until: &str, sink: &mut dyn Sink, is_over: fn(&Active, PlateTime, u64) -> bool) {
        let cycle = self.cycle;
        for active in self.active.extract_if(.., |active| is_over(active, at, cycle)) {
            let Active { found, reason, began_at, last_at, times, .. } = active;
            let cycles = if times == 1 { "cycle" } else { "cycles" };
            let text = format!("{until}: {reason} (in {times} {cycles} over {:.1} s)", last_at - began_at);
            let kind = EventKind::Finding { found, ended_after: Some(times), reason };
            sink.event(&EventFacts { at, level: EventLevel::Warning, text, kind });
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A sink that keeps the reported changes.
    #[derive(Default)]
    struct RecordedChanges(Vec<(f64, &'static str, Option<u64>, String)>);

    impl Sink for RecordedChanges {
        fn event(&mut self, event: &EventFacts) {
            let EventKind::Finding { found, ended_after, .. } = event.kind else { panic!("{event:?}") };
            assert_eq!(event.level, EventLevel::Warning);
            self.0.push((event.at.secs(), found.finding.code(), ended_after, event.text.clone()));
        }
    }

    /// Runs cycles of 1 s; `holds` gives the findings that hold in each.
    fn recorded(cycles: u32, holds: impl Fn(u32) -> Vec<Found>) -> RecordedChanges {
        let (mut findings, mut recorded) = (Findings::default(), RecordedChanges::default());
        for cycle in 0..cycles {
            let at = PlateTime::from_secs(f64::from(cycle));
            for found in holds(cycle) {
                findings.note(at, found, format!("reason of cycle {cycle}"), &mut recorded);
            }
            findings.end_cycle(at, &mut recorded);
        }
        findings.end_run(PlateTime::from_secs(f64::from(cycles)), &mut recorded);
        recorded
    }

    #[test]
    fn lasting_finding_is_reported_at_begin_and_end_with_its_count() {
        let RecordedChanges(recorded) =
            recorded(40, |cycle| if (3..20).contains(&cycle) { vec![Finding::StepsMeetParts.into()] } else { vec![] });
        assert_eq!(recorded.len(), 2, "{recorded:?}");
        let (at_s, code, ended_after, text) = &recorded[0];
        assert_eq!((*at_s, *code, *ended_after), (3.0, "steps_meet_parts", None));
        assert!(text.starts_with("reason of cycle 3; ") && text.contains("more room"), "{text}");
        let (at_s, code, ended_after, text) = &recorded[1];
        assert_eq!((*at_s, *code), (39.0, "steps_meet_parts"), "twenty quiet cycles after cycle 19");
        assert_eq!(*ended_after, Some(17));
        assert_eq!(text, "no longer: reason of cycle 3 (in 17 cycles over 16.0 s)");
    }

    #[test]
    fn finding_of_sight_ends_soon_after_it_was_last_noted() {
        let (mut findings, mut recorded) = (Findings::default(), RecordedChanges::default());
        let at = |tenths: u32| PlateTime::from_secs(0.1 * f64::from(tenths));
        for tenths in 0..=20 {
            findings.note(at(tenths), Finding::ViewHidden, "hidden".to_owned(), &mut recorded);
        }
        findings.end_cycle(at(22), &mut recorded);
        assert_eq!(recorded.0.len(), 1, "it may come back");
        findings.end_cycle(at(30), &mut recorded);
        assert_eq!(recorded.0[1].3, "no longer: hidden (in 1 cycle over 2.0 s)");
    }

    #[test]
    fn finding_that_comes_and_goes_is_one_until_it_stays_away() {
        let now_and_then = |every: u32| {
            recorded(60, move |cycle| [Found::from(Finding::SolverFails)].repeat((cycle % every == 0).into()))
        };
        assert_eq!(now_and_then(4).0.len(), 2);
        assert_eq!(now_and_then(25).0.len(), 6, "each of three is told twice");
    }

    #[test]
    fn findings_of_several_parts_are_separate_and_end_with_the_run() {
        let RecordedChanges(recorded) =
            recorded(2, |_| [0, 1, 0].map(|part| Found::about(Finding::PartBlocked, part)).to_vec());
        let ends: Vec<Option<u64>> = recorded.iter().map(|(_, _, ended_after, _)| *ended_after).collect();
        assert_eq!(ends, [None, None, Some(2), Some(2)]);
        assert!(recorded[2].3.starts_with("until the end: "), "{recorded:?}");
    }
}
