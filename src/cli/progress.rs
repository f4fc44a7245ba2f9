use std::time::Duration;

use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};

use upm_control::calibration::CalibrationProgress;
use upm_control::{CycleFacts, EventLevel, LocalisedFacts, Sink};
use upm_core::time::{Clock, MonotonicClock, PlateTime};

/// Thousandths, so that a bar can stand for any fraction.
pub(super) const FULL: u64 = 1000;

/// Work that takes no longer than this is done without a bar.
const LATE: Duration = Duration::from_secs(2);

/// Shows a run as a bar on stderr; silent without a terminal.
pub(super) struct RunProgress {
    bar: ProgressBar,
}

impl RunProgress {
    pub fn new(quiet: bool) -> Self {
        Self { bar: bar(quiet) }
    }

    pub fn finish(&self) {
        self.bar.finish_and_clear();
    }
}

impl Sink for RunProgress {
    fn localised(&mut self, facts: &LocalisedFacts<'_>) {
        self.bar.set_message(format!("table found, {} parts", facts.detections.len()));
    }

    fn cycle(&mut self, facts: &CycleFacts<'_>) {
        self.bar.set_position((facts.wanted.progress * FULL as f64) as u64);
        self.bar.set_message(format!("plate {:6.1} s  {}", facts.ended_at.secs(), facts.wanted.phase));
        let CycleFacts { index: cycle, plan_us, cycle_us, .. } = facts;
        let pulses = facts.plan.pulses.len();
        self.bar.suspend(|| tracing::debug!(cycle, pulses, plan_us, cycle_us, "planned and played"));
    }

    fn event(&mut self, at: PlateTime, level: EventLevel, text: &str) {
        match level {
            EventLevel::Info => self.bar.suspend(|| tracing::info!("plate {at}: {text}")),
            EventLevel::Warning => self.bar.suspend(|| tracing::warn!("plate {at}: {text}")),
            EventLevel::Error => self.bar.suspend(|| tracing::error!("plate {at}: {text}")),
        }
    }
}

/// Shows a calibration as a bar on stderr.
pub(super) struct StageProgress {
    bar: ProgressBar,
}

impl StageProgress {
    pub fn new(quiet: bool) -> Self {
        Self { bar: bar(quiet) }
    }

    pub fn show(&self, progress: CalibrationProgress) {
        let CalibrationProgress { stage, done, total, plate_time_s } = progress;
        self.bar.set_position(FULL * done as u64 / total.max(1) as u64);
        self.bar.set_message(format!("plate {plate_time_s:6.1} s  {stage} {done} of {total}"));
    }

    pub fn finish(&self) {
        self.bar.finish_and_clear();
    }
}

/// A bar on stderr that appears once work has taken a while.
pub(super) struct LateProgress {
    clock: MonotonicClock,
    quiet: bool,
    bar: Option<ProgressBar>,
}

impl LateProgress {
    pub fn new(quiet: bool) -> Self {
        Self { clock: MonotonicClock::new(), quiet, bar: None }
    }

    /// Shows that this part of the work is done, 0 to 1.
    pub fn show(&mut self, done: f64, message: impl FnOnce() -> String) {
        if self.bar.is_none() && self.clock.elapsed() < LATE {
            return;
        }
        let quiet = self.quiet;
        let bar = self.bar.get_or_insert_with(|| bar(quiet));
        bar.set_position((done * FULL as f64) as u64);
        bar.set_message(message());
    }

    pub fn finish(&self) {
        if let Some(bar) = &self.bar {
            bar.finish_and_clear();
        }
    }
}

/// Where a bar is drawn.
pub(super) fn target(quiet: bool) -> ProgressDrawTarget {
    if quiet { ProgressDrawTarget::hidden() } else { ProgressDrawTarget::stderr_with_hz(10) }
}

/// A bar from 0 to [`FULL`] on stderr.
pub(super) fn bar(quiet: bool) -> ProgressBar {
    let bar = ProgressBar::with_draw_target(Some(FULL), target(quiet));
    if let Ok(style) = ProgressStyle::with_template("[{bar:30.cyan}] {percent:>3} %  {msg}") {
        bar.set_style(style.progress_chars("=> "));
    }
    bar.enable_steady_tick(Duration::from_millis(200));
    bar
}
