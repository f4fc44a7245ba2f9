use super::*;

const SPEC: WatchdogSpec =
    WatchdogSpec { hung: Duration::from_secs(30), no_part_s: 0.5, blocked: Duration::from_millis(500) };

fn watchdog() -> Watchdog {
    Watchdog::with_camera(SPEC, 60.0)
}

fn at(ms: u64) -> Duration {
    Duration::from_millis(ms)
}

/// Checks every tick from `from_ms` on; the time and the fault of the first that is found.
fn first_found(
    watchdog: &mut Watchdog,
    from_ms: u64,
    until_ms: u64,
    beat: impl Fn(u64, &Heartbeat),
) -> Option<(u64, ExternalStop)> {
    let heartbeat = Heartbeat::default();
    (from_ms..until_ms).step_by(10).find_map(|now_ms| {
        beat(now_ms, &heartbeat);
        Some((now_ms, watchdog.check(at(now_ms), &heartbeat, None)?))
    })
}

/// The fault of a run with the remedy of its cause.
fn fault(at_ms: u64, cause: StopCause, what: &str) -> Option<(u64, ExternalStop)> {
    let reason = format!("{what}; {}", cause.remedy().unwrap());
    Some((at_ms, ExternalStop { cause, reason }))
}

fn frames_until(last_ms: u64) -> impl Fn(u64, &Heartbeat) {
    move |now_ms, heartbeat| {
        if now_ms <= last_ms {
            heartbeat.frame(at(now_ms), PlateTime::from_secs(now_ms as f64 * 1e-3), true);
        }
    }
}

#[test]
fn a_run_that_goes_on_is_left_alone() {
    assert_eq!(first_found(&mut watchdog(), 1000, 90_000, frames_until(u64::MAX)), None);
    assert_eq!(first_found(&mut watchdog(), 1000, 90_000, |_, _| {}), None, "it has not begun");
}

#[test]
fn controller_that_takes_no_frame_is_reported() {
    let found = first_found(&mut watchdog(), 1000, 90_000, frames_until(2000));
    assert_eq!(found, fault(32_010, StopCause::Found(Finding::Hung), "no frame came for 30.0 s: the controller hangs"));
}

#[test]
fn unseen_parts_are_reported() {
    let blind = |now_ms: u64, heartbeat: &Heartbeat| {
        heartbeat.frame(at(now_ms), PlateTime::from_secs(now_ms as f64 * 1e-3), now_ms < 3000);
    };
    let found = first_found(&mut watchdog(), 1000, 9000, blind);
    assert_eq!(found, fault(3500, StopCause::Found(Finding::NoPartSeen), "no part was seen for 0.5 s of plate time"));
}

#[test]
fn a_journal_that_waits_for_the_disk_is_reported() {
    let heartbeat = Heartbeat::default();
    let first = |since_ms: u64| {
        let mut watchdog = watchdog();
        (2000..4000).step_by(10).find_map(|now_ms| {
            heartbeat.frame(at(now_ms), PlateTime::ZERO, true);
            Some((now_ms, watchdog.check(at(now_ms), &heartbeat, Some(at(now_ms.min(since_ms))))?))
        })
    };
    assert_eq!(first(u64::MAX), None);
    assert_eq!(
        first(3000),
        fault(3510, StopCause::Found(Finding::JournalBlocked), "the journal could not be written for 0.5 s")
    );
}

#[test]
fn suspended_time_is_not_counted() {
    let (mut watchdog, heartbeat) = (watchdog(), Heartbeat::default());
    heartbeat.frame(at(1000), PlateTime::ZERO, true);
    // suspended for a minute, then on a machine so busy that the watchdog itself checks twice a second
    let checks_ms = [1000, 1010, 61_000].into_iter().chain((61_500..).step_by(500).take(280));
    let found = checks_ms.map(|now_ms| watchdog.check(at(now_ms), &heartbeat, None)).find(Option::is_some);
    assert_eq!(found, None, "of 500 ms no more than 100 ms are counted");
    let hung_ms = (201_010..).step_by(10).find(|&now_ms| watchdog.check(at(now_ms), &heartbeat, None).is_some());
    assert_eq!(hung_ms, Some(202_910), "but they are counted, however busy the machine is");
    watchdog.rest();
    assert_eq!(watchdog.check(at(203_000), &heartbeat, None), None, "a first look only looks");
}

#[test]
fn camera_of_a_low_rate_may_miss_a_few_frames() {
    let found = |shows_part: fn(u64) -> bool| {
        let each_second = move |now_ms: u64, heartbeat: &Heartbeat| {
            if now_ms.is_multiple_of(1000) {
                heartbeat.frame(at(now_ms), PlateTime::from_secs(now_ms as f64 * 1e-3), shows_part(now_ms));
            }
        };
        first_found(&mut Watchdog::with_camera(SPEC, 1.0), 1000, 20_000, each_second)
    };
    assert_eq!(found(|ms| ms != 5000), None);
    let reason = "no part was seen for 4.0 s of plate time";
    assert_eq!(found(|ms| ms < 5000), fault(8000, StopCause::Found(Finding::NoPartSeen), reason));
}
