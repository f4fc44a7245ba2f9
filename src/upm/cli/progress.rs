use std::io::IsTerminal;
use std::time::Duration;

use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};

use super::args::Common;
use upm_control::{CycleFacts, EventFacts, EventKind, EventLevel, Found, LocalisedFacts, Sink};
use upm_core::time::{Clock, MonotonicClock};
use upm_runner::run::PacingStats;

/// Length of a bar: progress is counted in thousandths.
const FULL: u64 = 1000;

/// Least delay against real time that is reported, s.
const LEAST_BEHIND_S: f64 = 0.1;

/// Work that takes no longer than this writes no line.
const LATE: Duration = Duration::from_secs(2);

/// Time between two lines of progress.
const BETWEEN_LINES: Duration = Duration::from_secs(5);

/// Progress of a run on stderr: a bar on a terminal, elsewhere a line now and then.
pub(super) struct RunProgress<'a> {
    shown: LateProgress,
    pacing: &'a PacingStats,
    /// Findings already reported as warnings.
    warned: Vec<Found>,
}

impl<'a> RunProgress<'a> {
    /// Progress of the run that `pacing` belongs to.
    pub fn new(common: Common, pacing: &'a PacingStats) -> Self {
        Self { shown: LateProgress::new(common), pacing, warned: Vec::new() }
    }

    pub fn finish(&self) {
        self.shown.finish();
    }
}

impl Sink for RunProgress<'_> {
    fn localised(&mut self, facts: &LocalisedFacts<'_>) {
        self.shown.show(0.0, || format!("table found, {} parts", facts.detections.len()));
    }

    fn cycle(&mut self, facts: &CycleFacts) {
        let behind = behind(self.pacing.behind().as_secs_f64());
        let message = || format!("plate {:6.1} s{behind}  {}", facts.ended_at.secs(), facts.wanted.phase);
        self.shown.show(facts.wanted.progress, message);
        let CycleFacts { index: cycle, plan_us, cycle_us, .. } = facts;
        let (plan_us, cycle_us) = (plan_us.round() as u64, cycle_us.round() as u64);
        let (pulses, continues) = (facts.plan.pulses.len(), facts.plan.continues);
        self.shown.suspend(|| tracing::debug!(cycle, pulses, continues, plan_us, cycle_us, "planned and played"));
    }

    /// Reports a condition as a warning when it begins for the first time; its end and repetitions are information.
    fn event(&mut self, event: &EventFacts) {
        let EventFacts { at, text, .. } = event;
        let is_known = |found, ended_after: &Option<u64>| ended_after.is_some() || self.warned.contains(found);
        let level = match &event.kind {
            EventKind::Finding { found, ended_after, .. } if is_known(found, ended_after) => EventLevel::Info,
            EventKind::Finding { found, .. } => {
                self.warned.push(*found);
                EventLevel::Warning
            }
            _ => event.level,
        };
        match level {
            EventLevel::Info => self.shown.suspend(|| tracing::info!("plate {at}: {text}")),
            EventLevel::Warning => self.shown.suspend(|| tracing::warn!("plate {at}: {text}")),
            EventLevel::Error => self.shown.suspend(|| tracing::error!("plate {at}: {text}")),
        }
    }
}

/// Delay of a plate against real time, to be appended to its time; empty if it is small.
pub(super) fn behind(behind_s: f64) -> String {
    if behind_s < LEAST_BEHIND_S { String::new() } else { format!(", {behind_s:.1} s behind real time") }
}

/// Progress on stderr: a bar on a terminal, elsewhere lines for work that takes a while.
pub(super) struct LateProgress {
    /// Hidden where there are lines or nothing.
    bar: ProgressBar,
    /// Clock and earliest time of the next line; `None` without lines.
    lines: Option<(MonotonicClock, Duration)>,
}

impl LateProgress {
    /// Progress on the stderr of this process; none with `--quiet`.
    pub fn new(common: Common) -> Self {
        let is_terminal = std::io::stderr().is_terminal();
        let lines = (!common.quiet && !is_terminal).then(|| (MonotonicClock::new(), LATE));
        Self { bar: if !common.quiet && is_terminal { bar() } else { ProgressBar::hidden() }, lines }
    }

    pub fn show(&mut self, done: f64, message: impl FnOnce() -> String) {
        if self.is_live() {
            self.bar.set_position((done * FULL as f64) as u64);
            self.bar.set_message(message());
        } else if let Some((clock, from)) = &mut self.lines
            && is_due(from, clock.elapsed())
        {
            errln!("{:3.0} %  {}", 100.0 * done, message());
        }
    }

    /// True on a terminal, where a message of several lines is shown in place.
    pub fn is_live(&self) -> bool {
        !self.bar.is_hidden()
    }

    /// Calls `write` with the bar removed from stderr.
    pub fn suspend(&self, write: impl FnOnce()) {
        self.bar.suspend(write);
    }

    pub fn finish(&self) {
        self.bar.finish_and_clear();
    }
}

/// True if a line is due at `now`; the next one is then due later.
fn is_due(from: &mut Duration, now: Duration) -> bool {
    (now >= *from).then(|| *from = now + BETWEEN_LINES).is_some()
}

/// A bar from 0 to [`FULL`] on stderr.
fn bar() -> ProgressBar {
    let bar = ProgressBar::with_draw_target(Some(FULL), ProgressDrawTarget::stderr_with_hz(10));
    if let Ok(style) = ProgressStyle::with_template("[{bar:30.cyan}] {percent:>3} %  {msg}") {
        bar.set_style(style.progress_chars("=> "));
    }
    bar.enable_steady_tick(Duration::from_millis(200));
    bar
}

#[cfg(test)]
mod tests {
    use tracing::level_filters::LevelFilter;

    use super::super::test_buffer::TestBuffer;
    use super::*;
    use upm_core::job::Finding;
    use upm_core::time::PlateTime;

    #[test]
    fn long_work_without_a_terminal_gets_a_line_after_two_seconds_and_then_every_five() {
        let mut from = LATE;
        let due = (0..=9000).step_by(100).filter(|&at_ms| is_due(&mut from, Duration::from_millis(at_ms)));
        assert_eq!(due.collect::<Vec<_>>(), [2000, 7000]);
    }

    #[test]
    fn condition_is_warned_of_once_and_its_end_is_information() {
        let page = TestBuffer::default();
        let writer = page.clone();
        let log = tracing_subscriber::fmt().with_max_level(LevelFilter::INFO).with_ansi(false).without_time();
        tracing::subscriber::with_default(log.with_writer(move || writer.clone()).finish(), || {
            let pacing = PacingStats::default();
            let mut progress = RunProgress::new(Common { json: false, verbose: 0, quiet: true }, &pacing);
            for (part, ended_after, text) in [
                (0, None, "part 0 is slow"),
                (0, Some(2), "no longer"),
                (1, None, "part 1 is slow"),
                (0, None, "part 0 is slow again"),
            ] {
                let (at, found) = (PlateTime::from_secs(1.0), Found { finding: Finding::PartSlow, about: Some(part) });
                let (level, reason) = (EventLevel::Warning, text.to_owned().into());
                let kind = EventKind::Finding { found, ended_after, reason };
                progress.event(&EventFacts { at, level, text: text.to_owned(), kind });
            }
        });
        let lines = page.lines();
        let levels: Vec<&str> = lines.iter().filter_map(|line| line.split_whitespace().next()).collect();
        assert_eq!(levels, ["WARN", "INFO", "WARN", "INFO"], "{lines:?}");
    }

    #[test]
    fn plate_behind_real_time_is_shown_from_a_tenth_of_a_second_on() {
        assert_eq!(
            [0.0, 0.09, 0.1, 8.04].map(behind),
            ["", "", ", 0.1 s behind real time", ", 8.0 s behind real time"]
        );
    }
}
