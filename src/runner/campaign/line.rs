use std::collections::BTreeSet;

use serde::{Deserialize, Serialize};
use serde_json::{Map, Value, json};

use upm_core::job::{Evidence, Outcome};
use upm_recording::Report;

/// Longest line of a run, bytes: systems append so much in one piece.
const LONGEST_LINE: usize = 4096;
/// Longest text in a line, characters, and most findings and violations.
const LONGEST_TEXT: usize = 300;
const MOST_NAMED: usize = 6;

/// The result of a run, on one line.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct RunLine {
    /// Number of the run in its campaign, from 1.
    pub run: usize,
    /// Hash of the effective job, and that of the program: what has been run.
    pub key: String,
    /// Number of its cell, from 0.
    pub cell: usize,
    /// Seed of the run.
    pub seed: u64,
    /// How it ended: an outcome, or `refused`.
    pub outcome: String,
    /// True for a run that reached its goal, in truth, too; where there is a judge, for one without violations.
    pub success: bool,
    /// Code of the cause of its end, where it has one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub code: Option<String>,
    /// Why, in words; left out for a success.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub reason: String,
    /// Codes of the findings of the run.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub findings: Vec<String>,
    /// Violations that a judge has found.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub violations: Vec<String>,
    /// Figures of its report.
    #[serde(default)]
    pub figures: Figures,
    /// How near the run came to the findings that rest on chance.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub evidence: Option<Evidence>,
    /// Run folder, relative to the campaign's, if it was kept.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub folder: Option<String>,
}

macro_rules! figures {
    ($($name:ident: $text:literal,)*) => {
        /// Figures of a report; `None` where the run does not have one.
        #[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
        #[serde(default)]
        pub struct Figures {
            $(#[doc = $text] #[serde(skip_serializing_if = "Option::is_none")] pub $name: Option<f64>,)*
        }

        impl Figures {
            /// Names of all figures, as in reports.
            pub const NAMES: &'static [&'static str] = &[$(stringify!($name)),*];

            /// The one that is the computer's, which no summary has.
            pub const OF_COMPUTERS: &'static str = "wall_time_s";

            /// The figures in the order of their names.
            pub fn values(&self) -> [Option<f64>; Self::NAMES.len()] {
                [$(self.$name),*]
            }
        }
    };
}

figures! {
    plate_time_s: "The experiment's own time, s.",
    cycles: "Cycles ended.",
    pulses: "Pulses played.",
    laps: "Laps completed.",
    collisions: "Contacts between parts.",
    lost_parts: "Parts that were missing for so long that the run ended.",
    max_error_mm: "Largest true distance of a part from its target at the end, mm.",
    cross_track_rms_mm: "Root mean square distance from the path, mm.",
    cross_track_max_mm: "Its maximum, mm.",
    travel_ratio: "Distance gone over the length of path advanced.",
    phase_error_max: "Largest difference of a part's phase from its reference, laps.",
    speed_asked_mm_s: "Speed asked of the part that held the least share of it, mm/s.",
    speed_held_mm_s: "Speed that it held, mm/s.",
    sensing_rms_error_mm: "Root mean square distance of measured from true positions, mm.",
    wall_time_s: "Duration by the computer's clock, s; no summary has it.",
}

impl RunLine {
    /// Takes outcome, figures and findings from the report of the run.
    pub(super) fn with_report(mut self, report: &Report) -> Self {
        self.outcome = report.outcome.code().to_owned();
        self.success = report.reached_goal();
        self.code = report.stop.as_ref().map(|stop| stop.code.code().to_owned());
        let is_false = report.outcome == Outcome::Completed && !self.success;
        let false_success = "completed, but a part is truly not at its target";
        self.reason = if is_false { false_success } else { &report.reason }.to_owned();
        let findings: BTreeSet<&String> = report.incidents.guards.iter().map(|guard| &guard.code).collect();
        self.findings = findings.into_iter().cloned().collect();
        let members: Map<String, Value> = json!(report).as_object().cloned().unwrap_or_default();
        let known = members.into_iter().filter(|(key, _)| Figures::NAMES.contains(&key.as_str())).collect();
        self.figures = serde_json::from_value(Value::Object(known)).unwrap_or_default();
        self.evidence = report.evidence;
        self
    }

    /// The line in a file, its end included, short enough to be appended in one piece.
    pub(super) fn to_text(&self) -> String {
        let mut line = self.clone();
        let cut = |text: &mut String| text.truncate(text.floor_char_boundary(LONGEST_TEXT));
        cut(&mut line.reason);
        line.findings.truncate(MOST_NAMED);
        line.violations.truncate(MOST_NAMED);
        line.violations.iter_mut().for_each(cut);
        loop {
            let text = json!(line).to_string() + "\n";
            if text.len() <= LONGEST_LINE || line.violations.pop().is_none() {
                return text;
            }
        }
    }
}
