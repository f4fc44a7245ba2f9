//! The watchdog: sees that the run on a plate is alive, and says what is not.

use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::time::Duration;

use upm_core::time::PlateTime;
use upm_runner::config::WatchdogSpec;

/// How often the watchdog looks.
pub(super) const TICK: Duration = Duration::from_millis(10);
/// A look later than this after the one before says nothing: the whole program stood still, watchdog and all, and the
/// run comes to that by itself.
const STOOD_STILL: Duration = Duration::from_millis(100);
/// Missed deadlines are counted over this.
const SECOND: Duration = Duration::from_secs(1);

/// What the plate's thread leaves for the watchdog; writing it waits for nobody.
#[derive(Debug, Default)]
pub(super) struct Vitals {
    /// Wall time of the newest frame, ms, at least 1; 0 before the first.
    frame_ms: AtomicU64,
    /// Its plate time, and that of the newest one with a part in sight, ms.
    plate_ms: AtomicU64,
    seen_ms: AtomicU64,
    /// Wall time since which nothing can be told, ms; 0 while it can.
    untold_ms: AtomicU64,
    /// True from a frame that a plan starts from until the next one.
    planning: AtomicBool,
    /// True from control's last word on.
    over: AtomicBool,
}

impl Vitals {
    /// A run starts.
    pub fn clear(&self) {
        for each in [&self.frame_ms, &self.plate_ms, &self.seen_ms, &self.untold_ms] {
            each.store(0, Ordering::Relaxed);
        }
        self.over.store(false, Ordering::Release);
    }

    /// Control has said its last word: the plate rests, however long it takes to write down what there was.
    pub fn end(&self) {
        self.over.store(true, Ordering::Release);
    }

    /// True once it has.
    pub fn is_over(&self) -> bool {
        self.over.load(Ordering::Acquire)
    }

    /// A frame came, one that a plan starts from or another.
    pub fn frame(&self, now: Duration, at: PlateTime, part_in_sight: bool, starts_cycle: bool) {
        let plate_ms = at.nanos() / 1_000_000;
        self.plate_ms.store(plate_ms, Ordering::Relaxed);
        if part_in_sight {
            self.seen_ms.store(plate_ms, Ordering::Relaxed);
        }
        self.planning.store(starts_cycle, Ordering::Relaxed);
        self.over.store(false, Ordering::Release);
        self.frame_ms.store(ms(now).max(1), Ordering::Relaxed);
    }

    /// Something could be told, or could not.
    pub fn could_tell(&self, now: Duration, could: bool) {
        if could {
            self.untold_ms.store(0, Ordering::Relaxed);
        } else if self.untold_ms.load(Ordering::Relaxed) == 0 {
            self.untold_ms.store(ms(now).max(1), Ordering::Relaxed);
        }
    }
}

/// How the pacing of a run goes.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Deadlines {
    pub real_time: bool,
    pub misses: u64,
    pub worst_frames: u64,
}

/// Watches one plate.
#[derive(Debug)]
pub(super) struct Watchdog {
    spec: WatchdogSpec,
    memory: Memory,
}

/// What of one run it looks back to.
#[derive(Debug, Default)]
struct Memory {
    looked_at: Option<Duration>,
    /// When the program went on after it stood still.
    went_on: Duration,
    /// Begin of the present second, and the misses there were then.
    second: (Duration, u64),
}

impl Watchdog {
    pub fn new(spec: WatchdogSpec) -> Self {
        Self { spec, memory: Memory::default() }
    }

    /// Looks at a run. What is wrong with it, if anything is; nothing before its first frame.
    /// `unwritten_since` is when the journal began to wait for the disk, if it does.
    pub fn look(
        &mut self,
        now: Duration,
        vitals: &Vitals,
        deadlines: Deadlines,
        unwritten_since: Option<Duration>,
    ) -> Option<String> {
        let memory = &mut self.memory;
        let before = memory.looked_at.replace(now)?;
        if now.saturating_sub(before) > STOOD_STILL {
            (memory.went_on, memory.second) = (now, (now, deadlines.misses));
            return None;
        }
        if vitals.frame_ms.load(Ordering::Relaxed) == 0 {
            return None; // until then the deadlines are those of the run before
        }
        self.late(now, deadlines)
            .or_else(|| self.stuck(now, vitals, deadlines.real_time))
            .or_else(|| self.unwritten(now, unwritten_since?))
    }

    /// A run ended, or none is on the plate.
    pub fn rest(&mut self) {
        self.memory = Memory::default();
    }

    fn late(&mut self, now: Duration, deadlines: Deadlines) -> Option<String> {
        let (began, misses_then) = self.memory.second;
        if began == Duration::ZERO || now.saturating_sub(began) >= SECOND {
            self.memory.second = (now, deadlines.misses);
        }
        let misses = deadlines.misses.saturating_sub(misses_then);
        let counted = began != Duration::ZERO && misses > self.spec.misses_per_s;
        if deadlines.worst_frames > self.spec.late_frames {
            return Some(format!("control came {} frames late", deadlines.worst_frames));
        }
        counted.then(|| format!("{misses} deadlines were missed within a second"))
    }

    fn unwritten(&self, now: Duration, since: Duration) -> Option<String> {
        let waited = now.saturating_sub(since.max(self.memory.went_on));
        (waited > self.spec.blocked)
            .then(|| format!("the journal could not be written for {:.1} s", waited.as_secs_f64()))
    }

    fn stuck(&self, now: Duration, vitals: &Vitals, real_time: bool) -> Option<String> {
        let Self { spec, memory } = self;
        let read = |value: &AtomicU64| value.load(Ordering::Relaxed);
        let since = |then_ms: u64| Duration::from_millis(ms(now).saturating_sub(then_ms.max(ms(memory.went_on))));
        let (unframed, untold_ms) = (since(read(&vitals.frame_ms)), read(&vitals.untold_ms));
        // without a clock to keep up with, all that happens between two frames may take as long as a plan
        let (longest, what) = match (vitals.planning.load(Ordering::Relaxed), real_time) {
            (true, _) => (spec.planning, "no plan came"),
            (false, true) => (spec.no_frame, "no frame came"),
            (false, false) => (spec.planning, "no frame came"),
        };
        let unseen_s = read(&vitals.plate_ms).saturating_sub(read(&vitals.seen_ms)) as f64 * 1e-3;
        if unframed > longest {
            Some(format!("{what} for {:.1} s", unframed.as_secs_f64()))
        } else if unseen_s > spec.no_part_s {
            Some(format!("no part was seen for {unseen_s:.1} s of plate time"))
        } else if untold_ms != 0 && since(untold_ms) > spec.blocked {
            Some(format!("nothing could be told for {:.1} s", since(untold_ms).as_secs_f64()))
        } else {
            None
        }
    }
}

pub(super) fn ms(time: Duration) -> u64 {
    u64::try_from(time.as_millis()).unwrap_or(u64::MAX)
}

#[cfg(test)]
mod tests {
    use super::*;

    const REAL_TIME: Deadlines = Deadlines { real_time: true, misses: 0, worst_frames: 0 };

    const SPEC: WatchdogSpec = WatchdogSpec {
        no_frame: Duration::from_millis(500),
        planning: Duration::from_secs(5),
        no_part_s: 0.5,
        blocked: Duration::from_millis(500),
        late_frames: 5,
        misses_per_s: 10,
    };

    fn at(ms: u64) -> Duration {
        Duration::from_millis(ms)
    }

    /// Looks every tick from `from_ms` on; when and what was found first.
    fn first_found(
        dog: &mut Watchdog,
        from_ms: u64,
        until_ms: u64,
        vitals: impl Fn(u64, &Vitals),
        deadlines: impl Fn(u64) -> Deadlines,
    ) -> Option<(u64, String)> {
        let state = Vitals::default();
        (from_ms..until_ms).step_by(10).find_map(|now_ms| {
            vitals(now_ms, &state);
            Some((now_ms, dog.look(at(now_ms), &state, deadlines(now_ms), None)?))
        })
    }

    fn frames_until(last_ms: u64) -> impl Fn(u64, &Vitals) {
        move |now_ms, vitals| {
            if now_ms <= last_ms {
                vitals.frame(at(now_ms), PlateTime::from_secs(now_ms as f64 * 1e-3), true, false);
            }
        }
    }

    #[test]
    fn a_run_that_goes_on_is_left_alone() {
        let mut dog = Watchdog::new(SPEC);
        assert_eq!(first_found(&mut dog, 1000, 20_000, frames_until(u64::MAX), |_| REAL_TIME), None);
        let mut dog = Watchdog::new(SPEC);
        assert_eq!(first_found(&mut dog, 1000, 20_000, |_, _| {}, |_| REAL_TIME), None, "it has not begun");
    }

    #[test]
    fn frames_that_stay_away_are_told() {
        let mut dog = Watchdog::new(SPEC);
        let found = first_found(&mut dog, 1000, 9000, frames_until(2000), |_| REAL_TIME);
        assert_eq!(found, Some((2510, "no frame came for 0.5 s".into())));
        let mut dog = Watchdog::new(SPEC);
        let found = first_found(&mut dog, 1000, 9000, frames_until(2000), |_| Deadlines::default());
        assert_eq!(found, Some((7010, "no frame came for 5.0 s".into())), "as fast as the machine works");
    }

    #[test]
    fn a_plan_may_take_longer_than_a_frame() {
        let mut dog = Watchdog::new(SPEC);
        let plans = |now_ms: u64, vitals: &Vitals| {
            if now_ms <= 2000 || (6500..=6600).contains(&now_ms) {
                vitals.frame(at(now_ms), PlateTime::from_secs(2.0), true, now_ms >= 2000);
            }
        };
        let found = first_found(&mut dog, 1000, 19_000, plans, |_| REAL_TIME);
        assert_eq!(found, Some((11_610, "no plan came for 5.0 s".into())));
    }

    #[test]
    fn a_run_is_over_with_its_last_word_unless_frames_come_after_it() {
        let vitals = Vitals::default();
        assert!(!vitals.is_over());
        vitals.end();
        assert!(vitals.is_over());
        vitals.frame(at(10), PlateTime::ZERO, true, false);
        assert!(!vitals.is_over());
        vitals.end();
        vitals.clear();
        assert!(!vitals.is_over(), "the next one begins");
    }

    #[test]
    fn the_deadlines_of_the_run_before_are_not_held_against_a_new_one() {
        let mut dog = Watchdog::new(SPEC);
        let late = |_| Deadlines { worst_frames: 9, ..REAL_TIME };
        assert_eq!(first_found(&mut dog, 1000, 9000, |_, _| {}, late), None);
    }

    #[test]
    fn parts_that_nobody_sees_are_told() {
        let mut dog = Watchdog::new(SPEC);
        let blind = |now_ms: u64, vitals: &Vitals| {
            vitals.frame(at(now_ms), PlateTime::from_secs(now_ms as f64 * 1e-3), now_ms < 3000, false);
        };
        let found = first_found(&mut dog, 1000, 9000, blind, |_| REAL_TIME);
        assert_eq!(found, Some((3500, "no part was seen for 0.5 s of plate time".into())));
    }

    #[test]
    fn late_control_is_told() {
        let late = |worst_frames| {
            move |now_ms| Deadlines { worst_frames: if now_ms < 3000 { 0 } else { worst_frames }, ..REAL_TIME }
        };
        let mut dog = Watchdog::new(SPEC);
        assert_eq!(first_found(&mut dog, 1000, 9000, frames_until(u64::MAX), late(5)), None);
        let mut dog = Watchdog::new(SPEC);
        let found = first_found(&mut dog, 1000, 9000, frames_until(u64::MAX), late(6));
        assert_eq!(found, Some((3000, "control came 6 frames late".into())));

        let often = |per_s: u64| move |now_ms: u64| Deadlines { misses: 7 + per_s * now_ms / 1000, ..REAL_TIME };
        let mut dog = Watchdog::new(SPEC);
        assert_eq!(first_found(&mut dog, 1000, 9000, frames_until(u64::MAX), often(10)), None);
        let mut dog = Watchdog::new(SPEC);
        let (_, found) = first_found(&mut dog, 1000, 9000, frames_until(u64::MAX), often(20)).unwrap();
        assert_eq!(found, "11 deadlines were missed within a second");
    }

    #[test]
    fn a_crier_that_hangs_is_told() {
        let mut dog = Watchdog::new(SPEC);
        let hangs = |now_ms: u64, vitals: &Vitals| {
            vitals.frame(at(now_ms), PlateTime::from_secs(now_ms as f64 * 1e-3), true, false);
            vitals.could_tell(at(now_ms), !(2000..2400).contains(&now_ms) && now_ms < 4000);
        };
        let found = first_found(&mut dog, 1000, 9000, hangs, |_| REAL_TIME);
        assert_eq!(found, Some((4510, "nothing could be told for 0.5 s".into())));
    }

    #[test]
    fn a_journal_that_waits_for_the_disk_is_told() {
        let vitals = Vitals::default();
        let first = |since_ms: u64| {
            let mut dog = Watchdog::new(SPEC);
            (2000..4000).step_by(10).find_map(|now_ms| {
                vitals.frame(at(now_ms), PlateTime::ZERO, true, false);
                Some((now_ms, dog.look(at(now_ms), &vitals, REAL_TIME, Some(at(now_ms.min(since_ms))))?))
            })
        };
        assert_eq!(first(u64::MAX), None);
        assert_eq!(first(3000), Some((3510, "the journal could not be written for 0.5 s".into())));
    }

    #[test]
    fn a_program_that_stood_still_is_nobodys_fault() {
        let (mut dog, vitals) = (Watchdog::new(SPEC), Vitals::default());
        vitals.frame(at(1000), PlateTime::ZERO, true, false);
        assert_eq!(dog.look(at(1000), &vitals, REAL_TIME, None), None);
        assert_eq!(dog.look(at(61_000), &vitals, REAL_TIME, None), None);
        let later = (61_010..).step_by(10).find(|&ms| dog.look(at(ms), &vitals, REAL_TIME, None).is_some());
        assert_eq!(later, Some(61_510), "but then frames should come again");
        dog.rest();
        assert_eq!(dog.look(at(61_520), &vitals, REAL_TIME, None), None, "a first look only looks");
    }
}
