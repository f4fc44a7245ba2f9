//! The members of a journal's lines that the tables use; all others are ignored.

use std::io::{self, BufRead};

use serde::Deserialize;

/// Longest line that is read, bytes; a cycle of some hundred pulses is far shorter.
const LONGEST_LINE: u64 = 16 << 20;

/// Point in millimetres; a coordinate that was not finite is `None`.
pub(super) type ExportPointMm = [Option<f64>; 2];

#[derive(Debug, Deserialize)]
#[serde(tag = "type", rename_all = "snake_case")]
pub(super) enum ExportLine {
    Cycle(Box<ExportCycle>),
    UnfinishedCycle(OpenCycle),
    #[serde(other)]
    Other,
}

#[derive(Debug, Deserialize)]
pub(super) struct ExportCycle {
    pub cycle: u64,
    pub observed_at_s: f64,
    pub observed_mm: Vec<ExportPointMm>,
    pub wanted: ExportSetpoints,
    pub sent: Vec<Sent>,
    pub predicted_mm: Option<Vec<ExportPointMm>>,
    pub ended_at_s: f64,
    pub result_mm: Vec<ExportPointMm>,
}

#[derive(Debug, Deserialize)]
pub(super) struct ExportSetpoints {
    pub phase: String,
    pub subgoals_mm: Vec<ExportPointMm>,
    pub targets_mm: Vec<ExportPointMm>,
    pub cross_track_mm: Vec<Option<f64>>,
}

#[derive(Debug, Deserialize)]
pub(super) struct OpenCycle {
    pub cycle: u64,
    pub sent: Vec<Sent>,
}

/// A pulse sent to the motors.
#[derive(Debug, Deserialize)]
pub(super) struct Sent {
    pub started_at_s: f64,
    #[serde(default)]
    pub probe: bool,
    pub base_hz: f64,
    pub attack_s: f64,
    pub sustain_s: f64,
    pub rest_s: f64,
    pub read: JournalContents,
}

/// Measurements of a pulse by the accelerometers.
#[derive(Debug, Deserialize)]
pub(super) struct JournalContents {
    pub pump_mm_s: Option<[Option<f64>; 2]>,
    pub pump_rad_s: Option<f64>,
    pub cor_mm: Option<ExportPointMm>,
    pub rotation: Option<i64>,
    pub direction: Option<[Option<f64>; 2]>,
    pub residual_m_s2: Option<f64>,
    pub off_asked: Option<f64>,
    pub fault: Option<String>,
}

/// Reason why a journal cannot be read.
#[derive(Debug)]
pub(super) enum JournalFault {
    File(io::Error),
    /// Number of an invalid line, from 1, and what is wrong with it.
    Line(usize, String),
}

/// Reader of a journal, line by line. An incomplete last line, as a killed run leaves it, counts as the end.
pub(super) struct Lines<R> {
    journal: R,
    number: usize,
    bytes: Vec<u8>,
    /// True if the journal ended in an incomplete line.
    pub cut_short: bool,
}

impl<R: BufRead> Lines<R> {
    pub fn of(journal: R) -> Self {
        Self { journal, number: 0, bytes: Vec::new(), cut_short: false }
    }

    /// The next complete line.
    pub fn next(&mut self) -> Result<Option<ExportLine>, JournalFault> {
        self.bytes.clear();
        self.number += 1;
        let read = io::Read::take(&mut self.journal, LONGEST_LINE).read_until(b'\n', &mut self.bytes);
        if read.map_err(JournalFault::File)? == 0 {
            return Ok(None);
        }
        let is_long = self.bytes.len() as u64 == LONGEST_LINE;
        if self.bytes.pop() != Some(b'\n') {
            self.cut_short = true;
            let too_long = || JournalFault::Line(self.number, format!("more than {LONGEST_LINE} bytes"));
            return if is_long { Err(too_long()) } else { Ok(None) };
        }
        let line = serde_json::from_slice(&self.bytes);
        line.map(Some).map_err(|error| JournalFault::Line(self.number, error.to_string()))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn journal_that_ends_in_half_a_line_is_read_up_to_there() {
        let text =
            "{\"type\":\"event\",\"text\":\"x\"}\n{\"type\":\"unfinished_cycle\",\"cycle\":3,\"sent\":[]}\n{\"type";
        let mut lines = Lines::of(text.as_bytes());
        assert!(matches!(lines.next().unwrap(), Some(ExportLine::Other)));
        assert!(matches!(lines.next().unwrap(), Some(ExportLine::UnfinishedCycle(OpenCycle { cycle: 3, .. }))));
        assert!(lines.next().unwrap().is_none() && lines.cut_short);
    }

    #[test]
    fn invalid_journal_line_is_reported_by_its_number() {
        for text in
            ["{\"type\":\"event\"}\nnonsense\n", "{\"type\":\"event\"}\n\n", "{}\n{\"type\":\"cycle\",\"cycle\":0}\n"]
        {
            let mut lines = Lines::of(text.as_bytes());
            let fault = loop {
                match lines.next() {
                    Ok(Some(_)) => {}
                    found => break found,
                }
            };
            let number = if text.starts_with("{}") { 1 } else { 2 };
            assert!(matches!(fault, Err(JournalFault::Line(at, _)) if at == number), "{text}: {fault:?}");
        }
    }

    #[test]
    fn null_coordinate_is_read_as_missing() {
        let text = r#"{"type":"cycle","cycle":1,"observed_at_s":0.5,"observed_mm":[[1.5,null]],"wanted":{"phase":"p",
            "subgoals_mm":[],"targets_mm":[],"cross_track_mm":[]},"sent":[],"predicted_mm":null,"ended_at_s":1,
            "result_mm":[]}"#;
        let one_line = text.replace('\n', "") + "\n";
        let Some(ExportLine::Cycle(cycle)) = Lines::of(one_line.as_bytes()).next().unwrap() else { panic!("no cycle") };
        assert_eq!(cycle.observed_mm, [[Some(1.5), None]]);
    }
}
