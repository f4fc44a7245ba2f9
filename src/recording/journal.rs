mod fixed;
mod lines;

use std::io::{self, Write};
use std::sync::Arc;

use self::fixed::{Fixed, fixed_pair, mm, point_mm, points_mm, seconds};
use self::lines::{DetailPart, FoundPart, JournalLine, PlanPart, PlannedPart, SentLine, WantedPart, status_of};
use upm_control::{ConfirmedFacts, CycleFacts, EventFacts, EventKind, LocalisedFacts, PulseFacts, Sink};
use upm_planning::cor_library::Library;

pub use lines::{RECORDING_FAILED, journal_schema};

/// Writes `journal.jsonl`: one JSON object per line, each with a `type`.
///
/// `localised`: table and parts located without prior knowledge. `confirmed`: the same at the places where they were
/// tracked, with the differences, before a task counts as completed. `cycle`: observed, wanted, planned, sent to the
/// motors, read back from the accelerometers, predicted and measured. `event`: level and text; for a lasting condition
/// also its code and whether it began or ended; for the end of the run its outcome and the code of its cause; for a
/// recording that ended early a code. `unfinished_cycle`: pulses sent in a cycle that never ended. Lengths are
/// millimetres to 1e-4, times seconds to 1e-6, counts to 1e-3. Wall time does not enter, so equal seeds give equal
/// bytes.
///
/// The first failed write is kept and returned by [`Journal::finish`]; nothing is written after it.
#[derive(Debug)]
pub struct Journal<W: Write> {
    out: W,
    library: Arc<Library>,
    sent: Vec<SentLine>,
    sent_in_cycle: u64,
    line: Vec<u8>,
    fault: Option<io::Error>,
}

impl<W: Write> Journal<W> {
    /// A journal that writes to `out`, one line per write; `library` gives the centres of rotation.
    pub fn new(out: W, library: Arc<Library>) -> Self {
        Self { out, library, sent: Vec::new(), sent_in_cycle: 0, line: Vec::new(), fault: None }
    }

    /// Writes the pending lines, flushes and returns the writer. `Err` with the first write that failed during the run.
    pub fn finish(mut self) -> io::Result<W> {
        self.put_unfinished();
        match self.fault {
            Some(fault) => Err(fault),
            None => self.out.flush().map(|()| self.out),
        }
    }

    fn put(&mut self, line: &JournalLine<'_>) {
        if self.fault.is_some() {
            return;
        }
        self.line.clear();
        let written = serde_json::to_writer(&mut self.line, line).map_err(io::Error::from).and_then(|()| {
            self.line.push(b'\n');
            self.out.write_all(&self.line)
        });
        self.fault = written.err();
    }

    /// Writes the line for the pulses of a cycle that was broken off.
    fn put_unfinished(&mut self) {
        if !self.sent.is_empty() {
            let sent = std::mem::take(&mut self.sent);
            self.put(&JournalLine::UnfinishedCycle { cycle: self.sent_in_cycle, sent: &sent });
        }
    }
}

impl<W: Write> Sink for Journal<W> {
    fn localised(&mut self, facts: &LocalisedFacts<'_>) {
        let parts = facts.detections.iter().map(|part| FoundPart {
            kind: part.kind,
            center_px: fixed_pair(part.center_px),
            radius_px: Fixed(part.radius_px),
            position_mm: point_mm(part.position_m),
            score: Fixed(part.score),
        });
        self.put(&JournalLine::Localised {
            at_s: seconds(facts.frame.exposed_at),
            corners_px: facts.table.corners_px.map(fixed_pair),
            side_px: Fixed(facts.table.side_px),
            rotation_deg: Fixed(facts.table.rotation_rad.to_degrees()),
            parts: parts.collect(),
        });
    }

    fn confirmed(&mut self, facts: &ConfirmedFacts<'_>) {
        self.put(&JournalLine::Confirmed {
            at_s: seconds(facts.at),
            corner_px: Fixed(facts.corner_px),
            part_mm: mm(facts.part_m),
            parts_mm: points_mm(facts.parts_m),
        });
    }

    fn pulse(&mut self, facts: &PulseFacts) {
        if facts.cycle != self.sent_in_cycle {
            self.put_unfinished();
            self.sent_in_cycle = facts.cycle;
        }
        self.sent.push(SentLine::new(facts, &self.library));
    }

    fn cycle(&mut self, facts: &CycleFacts) {
        if facts.index != self.sent_in_cycle {
            self.put_unfinished();
        }
        let (sent, CycleFacts { wanted, plan, .. }) = (std::mem::take(&mut self.sent), facts);
        let pulses = plan.pulses.iter().map(|pulse| PlannedPart::new(pulse, &self.library)).collect();
        self.put(&JournalLine::Cycle {
            cycle: facts.index,
            observed_at_s: seconds(facts.observed_at),
            observed_mm: points_mm(&facts.observed_m),
            wanted: WantedPart {
                phase: &wanted.phase,
                progress: Fixed(wanted.progress),
                laps: wanted.laps,
                subgoals_mm: points_mm(&wanted.subgoals_m),
                targets_mm: points_mm(&wanted.targets_m),
                cross_track_mm: wanted.cross_track_m.iter().copied().map(mm).collect(),
            },
            plan: PlanPart {
                status: status_of(plan),
                candidates: plan.candidates.len(),
                continues: plan.continues,
                pulses,
            },
            sent: &sent,
            predicted_mm: plan.predicted_m.last().map(|predicted_m| points_mm(predicted_m)),
            ended_at_s: seconds(facts.ended_at),
            result_mm: points_mm(&facts.result_m),
        });
    }

    fn event(&mut self, event: &EventFacts) {
        let detail = match &event.kind {
            EventKind::Note => None,
            EventKind::Finding { found, ended_after, reason } => {
                let change = if ended_after.is_none() { "began" } else { "ended" };
                let (code, runner_up) = (found.finding.code(), reason.runner_up.as_ref());
                Some(DetailPart::Finding { code, change, times: *ended_after, runner_up })
            }
            EventKind::RunEnded { outcome, cause } => Some(DetailPart::RunEnded { outcome: *outcome, code: *cause }),
            EventKind::RecordingEnded => Some(DetailPart::RecordingEnded { code: RECORDING_FAILED }),
        };
        self.put(&JournalLine::Event { at_s: seconds(event.at), level: event.level, text: &event.text, detail });
    }
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;
    use upm_control::{EventLevel, Found, Reason};
    use upm_core::job::{Finding, RunnerUp};
    use upm_core::time::PlateTime;
    use upm_fixtures::{rig, synthetic_run};

    fn written(run: impl FnOnce(&mut Journal<&mut Vec<u8>>)) -> String {
        let mut bytes = Vec::new();
        let mut journal = Journal::new(&mut bytes, Arc::new(rig::library()));
        run(&mut journal);
        journal.finish().unwrap();
        String::from_utf8(bytes).unwrap()
    }

    /// `UPM_REMAKE_GOLDEN=1` rewrites the file.
    #[test]
    fn golden_bytes() {
        let text = written(|journal| {
            let mut run = synthetic_run::SyntheticRun::new(2);
            run.localise(journal);
            run.cycle(journal);
            let text = "part 1 \"lost\" for 3 frames";
            journal.event(&EventFacts::note(PlateTime::from_secs(1.5), EventLevel::Warning, text));
        });
        let file = concat!(env!("CARGO_MANIFEST_DIR"), "/journal/golden.jsonl");
        if std::env::var_os("UPM_REMAKE_GOLDEN").is_some() {
            std::fs::write(file, &text).unwrap();
        }
        assert_eq!(text, std::fs::read_to_string(file).unwrap());
    }

    #[test]
    fn fields_are_written_as_their_harmonics() {
        let text = written(|journal| {
            let mut run = synthetic_run::SyntheticRun::new(2);
            run.plans_fields = true;
            run.cycle(journal);
        });
        let line: serde_json::Value = serde_json::from_str(&text).unwrap();
        let second = |scale: f64| {
            let scaled = |values: [f64; 2]| values.map(|value| (value * scale * 1e3).round() / 1e3);
            json!({
                "cos_mm_s": scaled([125.0, -62.5]), "sin_mm_s": scaled([62.5, 125.0]),
                "cos_rad_s": 0.75 * scale, "sin_rad_s": -0.5 * scale,
            })
        };
        let planned = &line["plan"]["pulses"][0];
        assert_eq!(planned["harmonics"].as_array().unwrap().len(), 3);
        assert_eq!((&planned["harmonics"][1], &planned["base_hz"]), (&second(1.0), &json!(60.0)));
        assert_eq!((&planned["sustain_s"], &planned["entry"]), (&json!(0.04), &json!(null)));
        let read = &line["sent"][0]["read"];
        assert_eq!((&read["residual_m_s2"], &read["off_asked"]), (&json!(0.9), &json!(0.1)));
        assert_eq!(read["harmonics"][1]["sin_mm_s"], second(1.1)["sin_mm_s"]);
    }

    #[test]
    fn conditions_are_events_with_a_code() {
        let text = written(|journal| {
            let found = Found { finding: Finding::PartSlow, about: Some(1) };
            let (at, reason) = (PlateTime::from_secs(2.0), "slow");
            let runner_up = Some(RunnerUp { what: "accelerometer channel y2".into(), odds: 20 });
            let event = |ended_after, text: &str| {
                let reason = Reason { text: reason.to_owned(), runner_up: runner_up.clone() };
                let kind = EventKind::Finding { found, ended_after, reason };
                EventFacts { kind, ..EventFacts::note(at, EventLevel::Warning, text) }
            };
            journal.event(&event(None, "slow"));
            journal.event(&event(Some(3), "no longer"));
        });
        let lines: Vec<serde_json::Value> = text.lines().map(|line| serde_json::from_str(line).unwrap()).collect();
        let began = json!({
            "type": "event", "at_s": 2.0, "level": "warning", "text": "slow", "code": "part_slow", "change": "began",
            "runner_up": {"what": "accelerometer channel y2", "odds": 20},
        });
        let ended = json!({
            "type": "event", "at_s": 2.0, "level": "warning", "text": "no longer", "code": "part_slow",
            "change": "ended", "times": 3, "runner_up": {"what": "accelerometer channel y2", "odds": 20},
        });
        assert_eq!(lines, [began, ended]);
    }
}
