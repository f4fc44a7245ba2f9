//! The watchdog: sees that the run on a plate is alive, and says what is not.

use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Duration;

use crate::time::PlateTime;

/// How often the watchdog looks.
pub(super) const TICK: Duration = Duration::from_millis(10);
/// A look later than this after the one before says nothing: the whole program stood still, watchdog and all, and the
/// run comes to that by itself.
const STOOD_STILL: Duration = Duration::from_millis(100);
/// Longest wall time without a frame: in real time, and as fast as the machine works, where a frame waits for plans.
const NO_FRAME_REAL_TIME: Duration = Duration::from_millis(500);
const NO_FRAME_MAX: Duration = Duration::from_secs(10);
/// Longest plate time in which no part is seen at all.
const NO_PART: Duration = Duration::from_millis(500);
/// Longest wall time in which nothing can be told.
const NOT_TOLD: Duration = Duration::from_millis(500);
/// A frame this many periods late ends the run, and so do more missed deadlines in a second than this.
const MOST_FRAMES_LATE: u64 = 5;
const MOST_MISSES: u64 = 10;
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
}

impl Vitals {
    /// A run starts.
    pub fn clear(&self) {
        for each in [&self.frame_ms, &self.plate_ms, &self.seen_ms, &self.untold_ms] {
            each.store(0, Ordering::Relaxed);
        }
    }

    /// A frame came.
    pub fn frame(&self, now: Duration, at: PlateTime, part_in_sight: bool) {
        let plate_ms = at.nanos() / 1_000_000;
        self.plate_ms.store(plate_ms, Ordering::Relaxed);
        if part_in_sight {
            self.seen_ms.store(plate_ms, Ordering::Relaxed);
        }
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
#[derive(Debug, Default)]
pub(super) struct Watchdog {
    looked_at: Option<Duration>,
    /// When the program went on after it stood still.
    went_on: Duration,
    /// Begin of the present second, and the misses there were then.
    second: (Duration, u64),
}

impl Watchdog {
    /// Looks at a run. What is wrong with it, if anything is.
    pub fn look(&mut self, now: Duration, vitals: &Vitals, deadlines: Deadlines) -> Option<String> {
        let before = self.looked_at.replace(now)?;
        if now.saturating_sub(before) > STOOD_STILL {
            (self.went_on, self.second) = (now, (now, deadlines.misses));
            return None;
        }
        self.late(now, deadlines).or_else(|| self.stuck(now, vitals, deadlines.real_time))
    }

    /// A run ended, or none is on the plate.
    pub fn rest(&mut self) {
        *self = Self::default();
    }

    fn late(&mut self, now: Duration, deadlines: Deadlines) -> Option<String> {
        let (began, misses_then) = self.second;
        if began == Duration::ZERO || now.saturating_sub(began) >= SECOND {
            self.second = (now, deadlines.misses);
        }
        let misses = deadlines.misses.saturating_sub(misses_then);
        let counted = began != Duration::ZERO && misses > MOST_MISSES;
        if deadlines.worst_frames > MOST_FRAMES_LATE {
            return Some(format!("control came {} frames late", deadlines.worst_frames));
        }
        counted.then(|| format!("{misses} deadlines were missed within a second"))
    }

    fn stuck(&self, now: Duration, vitals: &Vitals, real_time: bool) -> Option<String> {
        let read = |value: &AtomicU64| value.load(Ordering::Relaxed);
        let since = |then_ms: u64| Duration::from_millis(ms(now).saturating_sub(then_ms.max(ms(self.went_on))));
        let (frame_ms, untold_ms) = (read(&vitals.frame_ms), read(&vitals.untold_ms));
        if frame_ms == 0 {
            return None;
        }
        let longest = if real_time { NO_FRAME_REAL_TIME } else { NO_FRAME_MAX };
        let unseen = Duration::from_millis(read(&vitals.plate_ms).saturating_sub(read(&vitals.seen_ms)));
        if since(frame_ms) > longest {
            Some(format!("no frame came for {:.1} s", since(frame_ms).as_secs_f64()))
        } else if unseen > NO_PART {
            Some(format!("no part was seen for {:.1} s of plate time", unseen.as_secs_f64()))
        } else if untold_ms != 0 && since(untold_ms) > NOT_TOLD {
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
            Some((now_ms, dog.look(at(now_ms), &state, deadlines(now_ms))?))
        })
    }

    fn frames_until(last_ms: u64) -> impl Fn(u64, &Vitals) {
        move |now_ms, vitals| {
            if now_ms <= last_ms {
                vitals.frame(at(now_ms), PlateTime::from_secs(now_ms as f64 * 1e-3), true);
            }
        }
    }

    #[test]
    fn a_run_that_goes_on_is_left_alone() {
        let mut dog = Watchdog::default();
        assert_eq!(first_found(&mut dog, 1000, 20_000, frames_until(u64::MAX), |_| REAL_TIME), None);
        let mut dog = Watchdog::default();
        assert_eq!(first_found(&mut dog, 1000, 20_000, |_, _| {}, |_| REAL_TIME), None, "it has not begun");
    }

    #[test]
    fn frames_that_stay_away_are_told() {
        let mut dog = Watchdog::default();
        let found = first_found(&mut dog, 1000, 9000, frames_until(2000), |_| REAL_TIME);
        assert_eq!(found, Some((2510, "no frame came for 0.5 s".into())));
        let mut dog = Watchdog::default();
        let at_max = |_| Deadlines::default();
        assert_eq!(first_found(&mut dog, 1000, 12_000, frames_until(2000), at_max), None, "it may be planning");
    }

    #[test]
    fn parts_that_nobody_sees_are_told() {
        let mut dog = Watchdog::default();
        let blind = |now_ms: u64, vitals: &Vitals| {
            vitals.frame(at(now_ms), PlateTime::from_secs(now_ms as f64 * 1e-3), now_ms < 3000);
        };
        let found = first_found(&mut dog, 1000, 9000, blind, |_| REAL_TIME);
        assert_eq!(found, Some((3500, "no part was seen for 0.5 s of plate time".into())));
    }

    #[test]
    fn late_control_is_told() {
        let late = |worst_frames| {
            move |now_ms| Deadlines { worst_frames: if now_ms < 3000 { 0 } else { worst_frames }, ..REAL_TIME }
        };
        let mut dog = Watchdog::default();
        assert_eq!(first_found(&mut dog, 1000, 9000, frames_until(u64::MAX), late(5)), None);
        let mut dog = Watchdog::default();
        let found = first_found(&mut dog, 1000, 9000, frames_until(u64::MAX), late(6));
        assert_eq!(found, Some((3000, "control came 6 frames late".into())));

        let often = |per_s: u64| move |now_ms: u64| Deadlines { misses: 7 + per_s * now_ms / 1000, ..REAL_TIME };
        let mut dog = Watchdog::default();
        assert_eq!(first_found(&mut dog, 1000, 9000, frames_until(u64::MAX), often(10)), None);
        let mut dog = Watchdog::default();
        let (_, found) = first_found(&mut dog, 1000, 9000, frames_until(u64::MAX), often(20)).unwrap();
        assert_eq!(found, "11 deadlines were missed within a second");
    }

    #[test]
    fn a_crier_that_hangs_is_told() {
        let mut dog = Watchdog::default();
        let hangs = |now_ms: u64, vitals: &Vitals| {
            vitals.frame(at(now_ms), PlateTime::from_secs(now_ms as f64 * 1e-3), true);
            vitals.could_tell(at(now_ms), !(2000..2400).contains(&now_ms) && now_ms < 4000);
        };
        let found = first_found(&mut dog, 1000, 9000, hangs, |_| REAL_TIME);
        assert_eq!(found, Some((4510, "nothing could be told for 0.5 s".into())));
    }

    #[test]
    fn a_program_that_stood_still_is_nobodys_fault() {
        let (mut dog, vitals) = (Watchdog::default(), Vitals::default());
        vitals.frame(at(1000), PlateTime::ZERO, true);
        assert_eq!(dog.look(at(1000), &vitals, REAL_TIME), None);
        assert_eq!(dog.look(at(61_000), &vitals, REAL_TIME), None);
        let later = (61_010..).step_by(10).find(|&ms| dog.look(at(ms), &vitals, REAL_TIME).is_some());
        assert_eq!(later, Some(61_510), "but then frames should come again");
        dog.rest();
        assert_eq!(dog.look(at(61_520), &vitals, REAL_TIME), None, "a first look only looks");
    }
}
