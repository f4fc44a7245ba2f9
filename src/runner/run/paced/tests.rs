use std::cell::{Cell, RefCell};

use proptest::prelude::*;

use super::*;
use upm_core::rig::Trip;
use upm_core::signal::Envelope;

const PERIOD_NS: u64 = 16_666_667;
const PERIOD: Duration = Duration::from_nanos(PERIOD_NS);

/// A clock, and a rig with one frame per period whose capture takes a given time on that clock.
#[derive(Debug, Default)]
struct World {
    clock_ns: Cell<u64>,
    plate_ns: Cell<u64>,
    capture_takes: Cell<Duration>,
    calls: RefCell<Vec<String>>,
    interlock: Interlock,
    stats: PacingStats,
    trip_in_nap: Cell<bool>,
    deadlines: DeadlinePolicy,
}

impl World {
    fn at(clock_s: u64) -> Self {
        let world = Self::default();
        world.clock_ns.set(clock_s * 1_000_000_000);
        world
    }

    fn strict() -> Self {
        Self { deadlines: DeadlinePolicy::Strict, ..Self::default() }
    }

    fn spend(&self, time: Duration) {
        self.clock_ns.set(self.clock_ns.get() + time.as_nanos() as u64);
    }

    fn called(&self, what: &str) -> usize {
        self.calls.borrow().iter().filter(|call| call.starts_with(what)).count()
    }

    /// Runs `work` on the paced rig.
    fn paced<T>(&self, work: impl FnOnce(&mut RealTimeRig<'_>) -> T) -> T {
        let mut rig = MadeUp { world: self, settled_at: PlateTime::ZERO };
        let sleep = |time: Duration| {
            self.spend(time);
            if self.trip_in_nap.get() {
                self.interlock.trip(Trip::EStop);
            }
        };
        let (stats, interlock, deadlines) = (&self.stats, &self.interlock, self.deadlines);
        work(&mut RealTimeRig::new(
            &mut rig,
            PaceClock { clock: self, sleep: &sleep, stats, interlock, frame_hz: 60.0, deadlines },
        ))
    }
}

impl Clock for World {
    fn elapsed(&self) -> Duration {
        Duration::from_nanos(self.clock_ns.get())
    }
}

struct MadeUp<'a> {
    world: &'a World,
    settled_at: PlateTime,
}

impl Rig for MadeUp<'_> {
    fn now(&self) -> PlateTime {
        PlateTime::from_nanos(self.world.plate_ns.get())
    }

    fn play(&mut self, drive: &Drive) -> Result<(), RigError> {
        self.settled_at = self.now() + drive.envelope.total_s();
        Ok(())
    }

    fn settled_at(&self) -> PlateTime {
        self.settled_at
    }

    fn capture(&mut self, _: &mut Frame) -> Result<(), RigError> {
        self.world.spend(self.world.capture_takes.get());
        self.world.plate_ns.set(self.world.plate_ns.get() + PERIOD_NS);
        Ok(())
    }

    fn trace(&self) -> AccelTrace {
        AccelTrace::default()
    }

    fn stop(&mut self) {
        self.world.calls.borrow_mut().push("stop".into());
    }

    fn pass(&mut self, until: PlateTime) -> Result<(), RigError> {
        self.world.calls.borrow_mut().push(format!("pass {}", until.nanos()));
        Err(RigError::Stopped(Trip::Lease))
    }
}

/// A pulse that sounds for 0.3 s and rests as long.
fn pulse() -> Drive {
    let envelope = Envelope { attack_s: 0.05, sustain_s: 0.2, rest_s: 0.3 };
    Drive { base_radps: 377.0, envelope, ..Drive::default() }
}

fn capture(rig: &mut RealTimeRig<'_>) -> Result<(), RigError> {
    rig.capture(&mut Frame::new(1, 1))
}

#[test]
fn the_first_frame_starts_the_clock_and_every_frame_takes_its_period() {
    let world = World::at(5);
    world.paced(|rig| {
        for frame in 1..100 {
            capture(rig).unwrap();
            world.spend(Duration::from_millis(frame % 16));
            assert!(world.clock_ns.get() - 5_000_000_000 >= frame * PERIOD_NS);
        }
    });
    assert_eq!(world.plate_ns.get(), 99 * PERIOD_NS);
    assert_eq!(world.clock_ns.get() - 5_000_000_000, 99 * PERIOD_NS + 3_000_000);
    assert_eq!((world.stats.misses(), world.stats.report(0).worst_late_frames), (0, 0));
}

#[test]
fn delay_over_a_frame_misses_a_deadline_and_is_not_made_up() {
    let world = World::at(0);
    world.paced(|rig| {
        capture(rig).unwrap();
        world.spend(Duration::from_millis(40));
        let from_ns = world.clock_ns.get();
        (0..10).for_each(|_| capture(rig).unwrap());
        assert_eq!(world.clock_ns.get() - from_ns, 10 * PERIOD_NS);
    });
    let stats = &world.stats;
    assert_eq!((stats.misses(), stats.report(0).worst_late_frames), (1, 2));
    assert_eq!(stats.behind(), Duration::from_millis(40));
    assert_eq!(world.called("pass"), 0);
}

#[test]
fn control_away_in_the_rest_after_a_pulse_keeps_the_lease() {
    let world = World::strict();
    world.paced(|rig| {
        capture(rig).unwrap();
        rig.play(&pulse()).unwrap();
        (0..19).for_each(|_| capture(rig).unwrap());
        assert!(rig.now() < rig.settled_at());
        world.spend(Duration::from_secs(1));
        capture(rig).unwrap();
    });
    assert_eq!((world.stats.misses(), world.called("pass")), (1, 0));
}

#[test]
fn a_trip_ends_the_wait_and_stops_the_rig_at_once() {
    let world = World::at(0);
    world.trip_in_nap.set(true);
    // a slow camera: the wait is far longer than a nap
    let fault = world.paced(|rig| {
        rig.late();
        world.plate_ns.set(10_000_000_000);
        capture(rig)
    });
    assert_eq!(fault, Err(RigError::Stopped(Trip::EStop)));
    assert!(world.elapsed() <= LONGEST_SLEEP && world.called("stop") == 1);
}

#[test]
fn stopped_clock_does_not_block_a_capture() {
    let (world, clock) = (World::at(0), upm_core::time::StoppedClock);
    let mut rig = MadeUp { world: &world, settled_at: PlateTime::ZERO };
    let (stats, interlock, deadlines) = (&world.stats, &world.interlock, DeadlinePolicy::Strict);
    let pace = PaceClock { clock: &clock, sleep: &|_| (), stats, interlock, frame_hz: 60.0, deadlines };
    capture(&mut RealTimeRig::new(&mut rig, pace)).unwrap();
}

proptest! {
    #[test]
    fn plate_time_never_runs_ahead_and_never_makes_up_for_more_than_a_frame(
        works_ms in proptest::collection::vec((0u64..60, 0u64..30), 1..60),
    ) {
        let world = World::at(3);
        world.paced(|rig| {
            capture(rig).unwrap();
            let (start_ns, start_plate_ns) = (world.clock_ns.get(), world.plate_ns.get());
            for (between_ms, within_ms) in works_ms {
                world.spend(Duration::from_millis(between_ms));
                world.capture_takes.set(Duration::from_millis(within_ms));
                let before_ns = world.clock_ns.get();
                capture(rig).unwrap();
                let (clock_ns, plate_ns) = (world.clock_ns.get() - start_ns, world.plate_ns.get() - start_plate_ns);
                prop_assert!(clock_ns >= plate_ns, "{clock_ns} {plate_ns}");
                // one frame late at most when it began, so one frame may pass at once, not two
                let late = time(i128::from(before_ns) - i128::from(world.plate_ns.get()) - rig.epoch_ns.unwrap());
                prop_assert!(late <= PERIOD, "{late:?}");
            }
            Ok(())
        })?;
    }
}
