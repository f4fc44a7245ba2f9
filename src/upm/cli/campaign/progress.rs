use parking_lot::Mutex;

use super::table;
use crate::cli::args::Common;
use crate::cli::progress::LateProgress;
use upm_core::time::{Clock, MonotonicClock};
use upm_runner::campaign::{FolderFacts, RunLine};

/// Cells that the live table has room for.
const MOST_ROWS: usize = 16;

/// Progress of a campaign on stderr: runs, failures and time left; on a terminal a row for each cell, too.
pub(super) struct CampaignProgress(Mutex<State>);

struct State {
    shown: LateProgress,
    clock: MonotonicClock,
    all: usize,
    /// Runs that were there.
    known: usize,
    made: usize,
    failed: usize,
    /// Name, runs, successes and sum of their plate times, s, of each cell.
    cells: Vec<(String, usize, usize, f64)>,
}

impl CampaignProgress {
    /// Progress of `all` runs of a campaign.
    pub fn new(facts: &FolderFacts, all: usize, common: Common) -> Self {
        let cells = facts.cells.iter().map(|name| (name.clone(), 0, 0, 0.0)).collect();
        let (shown, clock) = (LateProgress::new(common), MonotonicClock::new());
        Self(Mutex::new(State { shown, clock, all, known: 0, made: 0, failed: 0, cells }))
    }

    /// Counts a run.
    pub fn show(&self, line: Option<&RunLine>) {
        let mut state = self.0.lock();
        match line {
            None => state.known += 1,
            Some(line) => {
                state.made += 1;
                state.failed += usize::from(!line.success);
                if let Some((_, runs, successes, sum_s)) = state.cells.get_mut(line.cell) {
                    *runs += 1;
                    *successes += usize::from(line.success);
                    *sum_s += line.figures.plate_time_s.filter(|_| line.success).unwrap_or_default();
                }
            }
        }
        let State { all, known, made, failed, .. } = *state;
        let left_s = state.clock.elapsed().as_secs_f64() * (all - known - made) as f64 / made.max(1) as f64;
        let rows = state.rows();
        let failed = if failed > 0 { format!(", {failed} without success") } else { String::new() };
        let message = || format!("{} of {all} runs{failed}, {} left{rows}", known + made, time(left_s));
        state.shown.show((known + made) as f64 / all.max(1) as f64, message);
    }

    /// Takes it off the terminal.
    pub fn finish(&self) {
        self.0.lock().shown.finish();
    }
}

impl State {
    /// The live table; empty where there is no room for it.
    fn rows(&self) -> String {
        if !self.shown.is_live() || !(2..=MOST_ROWS).contains(&self.cells.len()) {
            return String::new();
        }
        let row = |(name, runs, successes, sum_s): &(String, usize, usize, f64)| {
            let mean = if *successes > 0 { format!("{:.1}", sum_s / *successes as f64) } else { "-".into() };
            vec![name.clone(), runs.to_string(), successes.to_string(), mean]
        };
        let heads = ["", "runs", "success", "mean s"].map(str::to_owned).to_vec();
        let rows: Vec<_> = std::iter::once(heads).chain(self.cells.iter().map(row)).collect();
        table::aligned(&rows).map(|line| format!("\n{line}")).collect()
    }
}

/// A time in words, as far as it can be foreseen.
fn time(seconds: f64) -> String {
    match seconds {
        s if s < 90.0 => format!("{s:.0} s"),
        s if s < 5400.0 => format!("{:.0} min", s / 60.0),
        s => format!("{:.1} h", s / 3600.0),
    }
}
