use std::cell::Cell;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use serde_json::json;

use super::paced::PaceClock;
use super::{PacingStats, RunSetup, play};
use crate::config::{DeadlinePolicy, Diagnostic, JobSpec, Origin, RigSpec};
use upm_control::{FrameFacts, Sink};
use upm_cor_library::Library;
use upm_core::rig::Interlock;
use upm_core::time::Clock;

/// Largest delay that counts as keeping up, s a minute: one short stall in a check of two seconds.
const TOLERATED_S_PER_MINUTE: f64 = 1.0;

/// Speed of this computer against a plate in real time, measured with one penny.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PaceCheck {
    /// Frame period of the camera, s.
    pub period_s: f64,
    /// Computing time of simulation and control per frame, median, s.
    pub loop_p50_s: f64,
    /// Computing time per frame, 99th percentile, s.
    pub loop_p99_s: f64,
    /// Increase of the delay of plate time against the clock, s a minute.
    pub behind_s_per_minute: f64,
}

impl PaceCheck {
    /// True if the computer keeps up.
    pub fn keeps_up(&self) -> bool {
        self.behind_s_per_minute < TOLERATED_S_PER_MINUTE
    }
}

/// Runs a plus sign on a simulated `rig` in real time for so long, in memory, and measures the computing time and the
/// delay. `sleep` parks the thread. `Err` in one line if such a job cannot be run on that rig.
pub fn check_pace(
    rig: &RigSpec,
    library: &Arc<Library>,
    clock: &dyn Clock,
    sleep: &dyn Fn(Duration),
    lasting: Duration,
) -> Result<PaceCheck, String> {
    let job = json!({
        "name": "pace-check", "parts": [{"kind": "penny"}], "task": {"type": "plus_sign", "laps": 0},
        "limits": {"plate_time_s": lasting.as_secs_f64() + 10.0},
    });
    let origin = Origin::of_request("pace check");
    let job = JobSpec::from_json(&job.to_string(), &origin, Some(rig)).map_err(|faults| one_line(&faults))?;
    let mut setup = RunSetup::new(&job, library).map_err(|fault| fault.to_string())?;
    let (stats, interlock, napped) = (PacingStats::default(), Interlock::default(), Cell::new(Duration::ZERO));
    let timed_sleep = |time| {
        let from = clock.elapsed();
        sleep(time);
        napped.set(napped.get() + clock.elapsed().saturating_sub(from));
    };
    let frame_hz = setup.model.frame_hz;
    let deadlines = DeadlinePolicy::Relaxed;
    let pace = PaceClock { clock, sleep: &timed_sleep, stats: &stats, interlock: &interlock, frame_hz, deadlines };
    let stop = AtomicBool::new(false);
    let mut loops =
        LoopTimes { clock, napped: &napped, stats: &stats, lasting, stop: &stop, begin: None, loops: vec![] };
    let finish = play(&mut setup, library, Some(pace), &mut loops, clock, &stop, &AtomicBool::new(false));
    loops.result(1.0 / frame_hz).ok_or(finish.ending.reason)
}

fn one_line(faults: &[Diagnostic]) -> String {
    faults.iter().map(ToString::to_string).collect::<Vec<_>>().join("; ")
}

/// Readings of the clocks at a frame.
#[derive(Clone, Copy)]
struct ClockReadings {
    at: Duration,
    napped: Duration,
    behind: Duration,
}

/// Sink that measures the time from frame to frame without the naps, and stops the run after the given time.
struct LoopTimes<'a> {
    clock: &'a dyn Clock,
    napped: &'a Cell<Duration>,
    stats: &'a PacingStats,
    lasting: Duration,
    stop: &'a AtomicBool,
    /// The first frame and the latest one.
    begin: Option<(ClockReadings, ClockReadings)>,
    loops: Vec<Duration>,
}

impl LoopTimes<'_> {
    /// Result; `None` with less than two frames.
    fn result(mut self, period_s: f64) -> Option<PaceCheck> {
        let (first, newest) = self.begin?;
        self.loops.sort_unstable();
        let last = self.loops.len().checked_sub(1)?;
        let percentile = |share: f64| self.loops[(share * last as f64).round() as usize].as_secs_f64();
        let minutes = (newest.at - first.at).as_secs_f64() / 60.0;
        let behind_s = (newest.behind - first.behind).as_secs_f64();
        Some(PaceCheck {
            period_s,
            loop_p50_s: percentile(0.5),
            loop_p99_s: percentile(0.99),
            behind_s_per_minute: if minutes > 0.0 { behind_s / minutes } else { 0.0 },
        })
    }
}

impl Sink for LoopTimes<'_> {
    fn frame(&mut self, _: &FrameFacts<'_>) {
        let now = ClockReadings { at: self.clock.elapsed(), napped: self.napped.get(), behind: self.stats.behind() };
        let (first, before) = *self.begin.get_or_insert((now, now));
        if now.at > before.at || now.napped > before.napped {
            self.loops.push((now.at - before.at).saturating_sub(now.napped - before.napped));
        }
        self.begin = Some((first, now));
        if now.at - first.at >= self.lasting {
            self.stop.store(true, Ordering::Relaxed);
        }
    }
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use super::*;

    /// A computer on which every reading of the clock takes a given time, and all else none.
    #[derive(Default)]
    struct Computer {
        now: Cell<Duration>,
        takes: Duration,
    }

    impl Clock for Computer {
        fn elapsed(&self) -> Duration {
            self.now.set(self.now.get() + self.takes);
            self.now.get()
        }
    }

    fn checked(takes: Duration) -> PaceCheck {
        let root = Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../.."));
        let rig = RigSpec::load(&root.join("configs/rigs/upm-1.json")).unwrap();
        let library = Arc::new(Library::load(&root.join("assets/libraries/upm-1.json")).unwrap());
        let computer = Computer { takes, ..Computer::default() };
        let sleep = |time| computer.now.set(computer.now.get() + time);
        check_pace(&rig, &library, &computer, &sleep, Duration::from_millis(500)).unwrap()
    }

    #[test]
    fn computer_that_takes_no_time_keeps_up() {
        let pace = checked(Duration::ZERO);
        assert_eq!((pace.loop_p99_s, pace.behind_s_per_minute), (0.0, 0.0));
        assert!(pace.keeps_up() && (pace.period_s - 1.0 / 60.0).abs() < 1e-9, "{pace:?}");
    }

    #[test]
    fn slow_computer_falls_behind_by_its_excess_loop_time() {
        let pace = checked(Duration::from_millis(10));
        assert!(!pace.keeps_up() && pace.loop_p50_s > pace.period_s && pace.loop_p99_s >= pace.loop_p50_s, "{pace:?}");
        let expected = 60.0 * (1.0 - pace.period_s / pace.loop_p50_s);
        assert!((pace.behind_s_per_minute - expected).abs() < 10.0, "{pace:?}, {expected}");
    }
}
