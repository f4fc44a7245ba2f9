use std::io::IsTerminal;
use std::time::Duration;

use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};

use super::args::Common;
use upm_control::{CycleFacts, EventLevel, LocalisedFacts, Sink};
use upm_core::time::{Clock, PlateTime};
use upm_runner::run::PacingStats;

/// Thousandths, so that a bar can stand for any fraction.
pub(super) const FULL: u64 = 1000;

/// A plate that is less than this behind real time is not reported as behind, s.
const LEAST_BEHIND_S: f64 = 0.1;

/// Work that takes no longer than this shows no progress; lines are this far apart.
const LATE: Duration = Duration::from_secs(2);

/// Shows a run as a bar on stderr; silent without a terminal.
pub(super) struct RunProgress<'a> {
    bar: ProgressBar,
    pacing: &'a PacingStats,
}

impl<'a> RunProgress<'a> {
    /// `pacing` is that of the run.
    pub fn new(common: Common, pacing: &'a PacingStats) -> Self {
        Self { bar: bar(is_hidden(common)), pacing }
    }

    pub fn finish(&self) {
        self.bar.finish_and_clear();
    }
}

impl Sink for RunProgress<'_> {
    fn localised(&mut self, facts: &LocalisedFacts<'_>) {
        self.bar.set_message(format!("table found, {} parts", facts.detections.len()));
    }

    fn cycle(&mut self, facts: &CycleFacts<'_>) {
        self.bar.set_position((facts.wanted.progress * FULL as f64) as u64);
        let behind = behind(self.pacing.behind().as_secs_f64());
        self.bar.set_message(format!("plate {:6.1} s{behind}  {}", facts.ended_at.secs(), facts.wanted.phase));
        let CycleFacts { index: cycle, plan_us, cycle_us, .. } = facts;
        let (pulses, continues) = (facts.plan.pulses.len(), facts.plan.continues);
        self.bar.suspend(|| tracing::debug!(cycle, pulses, continues, plan_us, cycle_us, "planned and played"));
    }

    fn event(&mut self, at: PlateTime, level: EventLevel, text: &str) {
        match level {
            EventLevel::Info => self.bar.suspend(|| tracing::info!("plate {at}: {text}")),
            EventLevel::Warning => self.bar.suspend(|| tracing::warn!("plate {at}: {text}")),
            EventLevel::Error => self.bar.suspend(|| tracing::error!("plate {at}: {text}")),
        }
    }
}

/// How far a plate is behind real time, to follow its time; empty where it hardly is.
pub(super) fn behind(behind_s: f64) -> String {
    if behind_s < LEAST_BEHIND_S { String::new() } else { format!(", {behind_s:.1} s behind real time") }
}

/// Where the progress of work that may take long goes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum ProgressMode {
    /// A bar, on a terminal.
    Bar,
    /// A line now and then, in a file or a pipe.
    Lines,
    /// Nowhere.
    Hidden,
}

impl ProgressMode {
    pub fn of(quiet: bool, is_terminal: bool) -> Self {
        match (quiet, is_terminal) {
            (true, _) => Self::Hidden,
            (false, true) => Self::Bar,
            (false, false) => Self::Lines,
        }
    }
}

/// Progress on stderr of work that has taken a while.
pub(super) struct LateProgress<C> {
    clock: C,
    mode: ProgressMode,
    bar: Option<ProgressBar>,
    /// When the last line was written.
    line_at: Duration,
}

impl<C: Clock> LateProgress<C> {
    pub fn new(mode: ProgressMode, clock: C) -> Self {
        let line_at = clock.elapsed();
        Self { clock, mode, bar: None, line_at }
    }

    pub fn show(&mut self, done: f64, message: impl FnOnce() -> String) {
        match self.mode {
            ProgressMode::Hidden => {}
            ProgressMode::Lines => {
                if let Some(line) = self.line(done, message) {
                    complain!("{line}");
                }
            }
            ProgressMode::Bar => {
                if self.bar.is_none() && self.clock.elapsed() < LATE {
                    return;
                }
                let bar = self.bar.get_or_insert_with(|| bar(false));
                bar.set_position((done * FULL as f64) as u64);
                bar.set_message(message());
            }
        }
    }

    /// The line to write now; `None` while the last one is recent.
    fn line(&mut self, done: f64, message: impl FnOnce() -> String) -> Option<String> {
        let now = self.clock.elapsed();
        if now < self.line_at + LATE {
            return None;
        }
        self.line_at = now;
        Some(format!("{:3.0} %  {}", 100.0 * done, message()))
    }

    /// Writes to stderr without the bar in between.
    pub fn suspend(&self, write: impl FnOnce()) {
        match &self.bar {
            Some(bar) => bar.suspend(write),
            None => write(),
        }
    }

    pub fn finish(&self) {
        if let Some(bar) = &self.bar {
            bar.finish_and_clear();
        }
    }
}

/// True where a bar shall not be drawn.
pub(super) fn is_hidden(common: Common) -> bool {
    common.quiet || !std::io::stderr().is_terminal()
}

/// A bar from 0 to [`FULL`] on stderr.
pub(super) fn bar(quiet: bool) -> ProgressBar {
    let target = if quiet { ProgressDrawTarget::hidden() } else { ProgressDrawTarget::stderr_with_hz(10) };
    let bar = ProgressBar::with_draw_target(Some(FULL), target);
    if let Ok(style) = ProgressStyle::with_template("[{bar:30.cyan}] {percent:>3} %  {msg}") {
        bar.set_style(style.progress_chars("=> "));
    }
    bar.enable_steady_tick(Duration::from_millis(200));
    bar
}

#[cfg(test)]
mod tests {
    use std::cell::Cell;

    use super::*;

    struct Hand<'a>(&'a Cell<u64>);

    impl Clock for Hand<'_> {
        fn elapsed(&self) -> Duration {
            Duration::from_millis(self.0.get())
        }
    }

    #[test]
    fn long_work_without_a_terminal_gets_a_line_every_two_seconds() {
        let now_ms = Cell::new(500);
        let mut progress = LateProgress::new(ProgressMode::of(false, false), Hand(&now_ms));
        let mut lines = Vec::new();
        for at_ms in (500..=7000).step_by(100) {
            now_ms.set(at_ms);
            lines.extend(progress.line(at_ms as f64 / 1e4, || format!("at {at_ms} ms")));
        }
        assert_eq!(lines, [" 25 %  at 2500 ms", " 45 %  at 4500 ms", " 65 %  at 6500 ms"]);
    }

    #[test]
    fn plate_behind_real_time_is_shown_from_a_tenth_of_a_second_on() {
        assert_eq!(
            [0.0, 0.09, 0.1, 8.04].map(behind),
            ["", "", ", 0.1 s behind real time", ", 8.0 s behind real time"]
        );
    }

    #[test]
    fn quiet_hides_progress_with_a_terminal_and_without() {
        assert_eq!([true, false].map(|terminal| ProgressMode::of(true, terminal)), [ProgressMode::Hidden; 2]);
        assert_eq!(ProgressMode::of(false, true), ProgressMode::Bar);
    }
}
