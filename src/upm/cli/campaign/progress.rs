use parking_lot::Mutex;

use super::table;
use crate::cli::args::Common;
use crate::cli::progress::LateProgress;
use upm_core::time::{Clock, MonotonicClock};
use upm_runner::campaign::{FolderFacts, RunLine};

/// Cells that the live table has room for.
const MOST_ROWS: usize = 16;

/// Progress of a campaign on stderr: runs, failures and time left; on a terminal a row for each cell, too.
pub(super) struct CampaignProgress {
    all: usize,
    cells: Vec<String>,
    clock: MonotonicClock,
    state: Mutex<State>,
}

struct State {
    shown: LateProgress,
    /// Runs that were there.
    known: usize,
    made: usize,
    failed: usize,
    /// Runs, successes and sum of their plate times, s, of each cell.
    of_cells: Vec<(usize, usize, f64)>,
}

impl CampaignProgress {
    /// Progress of `all` runs of a campaign.
    pub fn new(facts: &FolderFacts, all: usize, common: Common) -> Self {
        let of_cells = vec![(0, 0, 0.0); facts.cells.len()];
        let state = State { shown: LateProgress::new(common), known: 0, made: 0, failed: 0, of_cells };
        Self { all, cells: facts.cells.clone(), clock: MonotonicClock::new(), state: Mutex::new(state) }
    }

    /// Counts a run.
    pub fn show(&self, line: Option<&RunLine>) {
        let mut state = self.state.lock();
        match line {
            None => state.known += 1,
            Some(line) => {
                state.made += 1;
                state.failed += usize::from(!line.success);
                if let Some(cell) = state.of_cells.get_mut(line.cell) {
                    cell.0 += 1;
                    cell.1 += usize::from(line.success);
                    cell.2 += line.figures.plate_time_s.filter(|_| line.success).unwrap_or_default();
                }
            }
        }
        let State { known, made, failed, .. } = *state;
        let left = self.all - known - made;
        let left_s = self.clock.elapsed().as_secs_f64() * left as f64 / made.max(1) as f64;
        let has_rows = state.shown.is_live() && (2..=MOST_ROWS).contains(&self.cells.len());
        let rows = if has_rows { self.rows(&state.of_cells) } else { String::new() };
        let failed = if failed > 0 { format!(", {failed} without success") } else { String::new() };
        let message = || format!("{} of {} runs{failed}, {} left{rows}", known + made, self.all, time(left_s));
        state.shown.show((known + made) as f64 / self.all.max(1) as f64, message);
    }

    fn rows(&self, of_cells: &[(usize, usize, f64)]) -> String {
        let row = |(name, &(runs, successes, sum_s)): (&String, &(usize, usize, f64))| {
            let mean = if successes > 0 { format!("{:.1}", sum_s / successes as f64) } else { "-".into() };
            vec![name.clone(), runs.to_string(), successes.to_string(), mean]
        };
        let rows: Vec<_> = self.cells.iter().zip(of_cells).map(row).collect();
        let lines = table::aligned(&["", "runs", "success", "mean s"].map(str::to_owned), &rows);
        lines.into_iter().map(|line| format!("\n{line}")).collect()
    }

    /// Takes it off the terminal.
    pub fn finish(&self) {
        self.state.lock().shown.finish();
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
