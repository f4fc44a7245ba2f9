use super::*;

const STRICT: WatchdogDeadlines =
    WatchdogDeadlines { policy: DeadlinePolicy::Strict, real_time: true, misses: 0, worst_frames: 0 };
const RELAXED: WatchdogDeadlines = WatchdogDeadlines { policy: DeadlinePolicy::Relaxed, ..STRICT };
const AT_MAX_PACE: WatchdogDeadlines = WatchdogDeadlines { real_time: false, ..STRICT };

const SPEC: WatchdogSpec = WatchdogSpec {
    hung: Duration::from_secs(30),
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

/// Checks every tick from `from_ms` on; the time and the fault of the first that is found.
fn first_found(
    watchdog: &mut Watchdog,
    from_ms: u64,
    until_ms: u64,
    beat: impl Fn(u64, &Heartbeat),
    deadlines: impl Fn(u64) -> WatchdogDeadlines,
) -> Option<(u64, ExternalStop)> {
    let heartbeat = Heartbeat::default();
    (from_ms..until_ms).step_by(10).find_map(|now_ms| {
        beat(now_ms, &heartbeat);
        Some((now_ms, watchdog.check(at(now_ms), &heartbeat, deadlines(now_ms), None)?))
    })
}

/// The fault of a run that is too slow for strict deadlines.
fn slow(at_ms: u64, what: &str) -> Option<(u64, ExternalStop)> {
    let advice = "this computer was too busy: `--pace max` would do, or `\"deadlines\": \"relaxed\"` in the job";
    fault(at_ms, StopCause::DeadlineMissed, &format!("{what}; {advice}"))
}

/// Any other fault of a run.
fn fault(at_ms: u64, cause: StopCause, what: &str) -> Option<(u64, ExternalStop)> {
    let reason = format!("{what}; {}", cause.remedy().unwrap());
    Some((at_ms, ExternalStop { cause, reason }))
}

fn frames_until(last_ms: u64) -> impl Fn(u64, &Heartbeat) {
    move |now_ms, heartbeat| {
        if now_ms <= last_ms {
            heartbeat.frame(at(now_ms), PlateTime::from_secs(now_ms as f64 * 1e-3), true, false);
        }
    }
}

#[test]
fn a_run_that_goes_on_is_left_alone() {
    let mut watchdog = Watchdog::new(SPEC);
    assert_eq!(first_found(&mut watchdog, 1000, 20_000, frames_until(u64::MAX), |_| STRICT), None);
    let mut watchdog = Watchdog::new(SPEC);
    assert_eq!(first_found(&mut watchdog, 1000, 20_000, |_, _| {}, |_| STRICT), None, "it has not begun");
}

#[test]
fn frames_that_stay_away_are_reported() {
    let mut watchdog = Watchdog::new(SPEC);
    let found = first_found(&mut watchdog, 1000, 9000, frames_until(2000), |_| STRICT);
    assert_eq!(found, slow(2510, "no frame came for 0.5 s"));
    let mut watchdog = Watchdog::new(SPEC);
    let found = first_found(&mut watchdog, 1000, 9000, frames_until(2000), |_| AT_MAX_PACE);
    let (found_ms, ExternalStop { cause, reason }) = found.unwrap();
    assert_eq!((found_ms, cause), (7010, StopCause::DeadlineMissed), "as fast as the machine works");
    let would_do = "this computer was too busy: `\"deadlines\": \"relaxed\"` in the job would do";
    let remedy = StopCause::DeadlineMissed.remedy().unwrap();
    assert_eq!(reason, format!("no frame came for 5.0 s; {would_do}; {remedy}"));
}

#[test]
fn a_plan_may_take_longer_than_a_frame() {
    let mut watchdog = Watchdog::new(SPEC);
    let plans = |now_ms: u64, heartbeat: &Heartbeat| {
        if now_ms <= 2000 || (6500..=6600).contains(&now_ms) {
            heartbeat.frame(at(now_ms), PlateTime::from_secs(2.0), true, now_ms >= 2000);
        }
    };
    let found = first_found(&mut watchdog, 1000, 19_000, plans, |_| STRICT);
    assert_eq!(found, slow(11_610, "no plan came for 5.0 s"));
}

#[test]
fn run_is_over_at_its_end_unless_frames_follow() {
    let heartbeat = Heartbeat::default();
    assert!(!heartbeat.is_over());
    heartbeat.end();
    assert!(heartbeat.is_over());
    heartbeat.frame(at(10), PlateTime::ZERO, true, false);
    assert!(!heartbeat.is_over());
    heartbeat.end();
    heartbeat.clear();
    assert!(!heartbeat.is_over(), "the next one begins");
}

#[test]
fn the_deadlines_of_the_run_before_are_not_held_against_a_new_one() {
    let mut watchdog = Watchdog::new(SPEC);
    let late = |_| WatchdogDeadlines { worst_frames: 9, ..STRICT };
    assert_eq!(first_found(&mut watchdog, 1000, 9000, |_, _| {}, late), None);
}

#[test]
fn unseen_parts_are_reported() {
    let mut watchdog = Watchdog::new(SPEC);
    let blind = |now_ms: u64, heartbeat: &Heartbeat| {
        heartbeat.frame(at(now_ms), PlateTime::from_secs(now_ms as f64 * 1e-3), now_ms < 3000, false);
    };
    let found = first_found(&mut watchdog, 1000, 9000, blind, |_| STRICT);
    assert_eq!(found, fault(3500, StopCause::NoPartSeen, "no part was seen for 0.5 s of plate time"));
}

#[test]
fn late_control_is_reported() {
    let late = |worst_frames| {
        move |now_ms| WatchdogDeadlines { worst_frames: if now_ms < 3000 { 0 } else { worst_frames }, ..STRICT }
    };
    let mut watchdog = Watchdog::new(SPEC);
    assert_eq!(first_found(&mut watchdog, 1000, 9000, frames_until(u64::MAX), late(5)), None);
    let mut watchdog = Watchdog::new(SPEC);
    let found = first_found(&mut watchdog, 1000, 9000, frames_until(u64::MAX), late(6));
    assert_eq!(found, slow(3000, "control came 6 frames late"));

    let often = |per_s: u64| move |now_ms: u64| WatchdogDeadlines { misses: 7 + per_s * now_ms / 1000, ..STRICT };
    let mut watchdog = Watchdog::new(SPEC);
    assert_eq!(first_found(&mut watchdog, 1000, 9000, frames_until(u64::MAX), often(10)), None);
    let mut watchdog = Watchdog::new(SPEC);
    let found = first_found(&mut watchdog, 1000, 9000, frames_until(u64::MAX), often(20));
    assert_eq!(found, slow(found.as_ref().unwrap().0, "11 deadlines were missed within a second"));
}

#[test]
fn stalled_publisher_trips_watchdog() {
    let mut watchdog = Watchdog::new(SPEC);
    let hangs = |now_ms: u64, heartbeat: &Heartbeat| {
        heartbeat.frame(at(now_ms), PlateTime::from_secs(now_ms as f64 * 1e-3), true, false);
        heartbeat.note_publish(at(now_ms), !(2000..2400).contains(&now_ms) && now_ms < 4000);
    };
    let found = first_found(&mut watchdog, 1000, 9000, hangs, |_| STRICT);
    assert_eq!(found, fault(4510, StopCause::EventsBlocked, "no event could be stored for 0.5 s"));
}

#[test]
fn a_journal_that_waits_for_the_disk_is_reported() {
    let heartbeat = Heartbeat::default();
    let first = |since_ms: u64| {
        let mut watchdog = Watchdog::new(SPEC);
        (2000..4000).step_by(10).find_map(|now_ms| {
            heartbeat.frame(at(now_ms), PlateTime::ZERO, true, false);
            Some((now_ms, watchdog.check(at(now_ms), &heartbeat, STRICT, Some(at(now_ms.min(since_ms))))?))
        })
    };
    assert_eq!(first(u64::MAX), None);
    assert_eq!(first(3000), fault(3510, StopCause::JournalBlocked, "the journal could not be written for 0.5 s"));
}

#[test]
fn suspended_process_is_not_blamed() {
    let (mut watchdog, heartbeat) = (Watchdog::new(SPEC), Heartbeat::default());
    heartbeat.frame(at(1000), PlateTime::ZERO, true, false);
    assert_eq!(watchdog.check(at(1000), &heartbeat, STRICT, None), None);
    assert_eq!(watchdog.check(at(61_000), &heartbeat, STRICT, None), None);
    let later = (61_010..).step_by(10).find(|&ms| watchdog.check(at(ms), &heartbeat, STRICT, None).is_some());
    assert_eq!(later, Some(61_510), "but then frames should come again");
    watchdog.rest();
    assert_eq!(watchdog.check(at(61_520), &heartbeat, STRICT, None), None, "a first look only looks");
}

/// One frame a second, each late, and no plan within the limit for one.
fn crawls(now_ms: u64, heartbeat: &Heartbeat) {
    if now_ms.is_multiple_of(20_000) {
        heartbeat.frame(at(now_ms), PlateTime::from_secs(now_ms as f64 * 1e-6), true, true);
    }
}

#[test]
fn slow_run_is_left_alone_under_relaxed_deadlines() {
    let late = |policy| {
        let misses = |now_ms| now_ms / 10;
        move |now_ms| WatchdogDeadlines { misses: misses(now_ms), worst_frames: 1200, policy, real_time: true }
    };
    let mut watchdog = Watchdog::new(SPEC);
    assert_eq!(first_found(&mut watchdog, 20_000, 200_000, crawls, late(DeadlinePolicy::Relaxed)), None);
    let mut watchdog = Watchdog::new(SPEC);
    let found = first_found(&mut watchdog, 20_000, 200_000, crawls, late(DeadlinePolicy::Strict));
    assert_eq!(found, slow(20_010, "control came 1200 frames late"));
}

#[test]
fn planner_that_never_returns_is_reported_under_relaxed_deadlines() {
    for deadlines in [RELAXED, WatchdogDeadlines { real_time: false, ..RELAXED }] {
        let mut watchdog = Watchdog::new(SPEC);
        let found = first_found(&mut watchdog, 1000, 90_000, frames_until(2000), |_| deadlines);
        assert_eq!(found, fault(32_010, StopCause::Hung, "no frame came for 30.0 s: the controller hangs"));
    }
}

#[test]
fn suspended_time_is_not_counted_as_a_hang() {
    let (mut watchdog, heartbeat) = (Watchdog::new(SPEC), Heartbeat::default());
    heartbeat.frame(at(1000), PlateTime::ZERO, true, true);
    // suspended for a minute, then on a machine so busy that the watchdog itself checks twice a second
    let checks_ms = [1000, 61_000].into_iter().chain((61_500..).step_by(500).take(280));
    let found = checks_ms.map(|now_ms| watchdog.check(at(now_ms), &heartbeat, RELAXED, None)).find(Option::is_some);
    assert_eq!(found, None, "of 500 ms no more than 100 ms are counted");
    let hung_ms =
        (201_010..).step_by(10).find(|&now_ms| watchdog.check(at(now_ms), &heartbeat, RELAXED, None).is_some());
    assert_eq!(hung_ms, Some(203_010), "but they are counted, however busy the machine is");
}

#[test]
fn journal_that_waits_for_the_disk_ends_a_relaxed_run_as_a_hang_does() {
    let heartbeat = Heartbeat::default();
    let mut watchdog = Watchdog::new(SPEC);
    let found = (2000..90_000).step_by(10).find_map(|now_ms| {
        heartbeat.frame(at(now_ms), PlateTime::ZERO, true, false);
        Some((now_ms, watchdog.check(at(now_ms), &heartbeat, RELAXED, Some(at(now_ms.min(3000))))?))
    });
    assert_eq!(found, fault(33_010, StopCause::JournalBlocked, "the journal could not be written for 30.0 s"));
}

#[test]
fn camera_of_a_low_rate_may_miss_a_few_frames() {
    let each_second = |shows_part: fn(u64) -> bool| {
        move |now_ms: u64, heartbeat: &Heartbeat| {
            if now_ms.is_multiple_of(1000) {
                let at_plate = PlateTime::from_secs(now_ms as f64 * 1e-3);
                heartbeat.frame(at(now_ms), at_plate, shows_part(now_ms), false);
            }
        }
    };
    let found = |frame_hz: f64, shows_part: fn(u64) -> bool| {
        let mut watchdog = Watchdog::with_camera(SPEC, frame_hz);
        first_found(&mut watchdog, 1000, 20_000, each_second(shows_part), |_| STRICT)
    };
    assert_eq!(found(1.0, |ms| ms != 5000), None);
    let reason = "no part was seen for 4.0 s of plate time";
    assert_eq!(found(1.0, |ms| ms < 5000), fault(8000, StopCause::NoPartSeen, reason));
    assert_eq!(found(60.0, |_| true).unwrap().1.cause, StopCause::DeadlineMissed, "no frame for half a second");
}
