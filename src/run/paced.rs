use std::time::Duration;

use crate::rig::{Rig, RigFault};
use crate::signal::{AccelTrace, Drive, Frame};
use crate::time::{Clock, PlateTime};

/// A rig whose plate time never runs ahead of the clock: for watching a simulated plate as if it stood there.
pub(super) struct Paced<'a> {
    rig: &'a mut dyn Rig,
    clock: &'a dyn Clock,
}

impl<'a> Paced<'a> {
    pub(super) fn new(rig: &'a mut dyn Rig, clock: &'a dyn Clock) -> Self {
        Self { rig, clock }
    }
}

impl Rig for Paced<'_> {
    fn now(&self) -> PlateTime {
        self.rig.now()
    }

    fn play(&mut self, drive: &Drive) -> Result<(), RigFault> {
        self.rig.play(drive)
    }

    fn quiet_at(&self) -> PlateTime {
        self.rig.quiet_at()
    }

    fn capture(&mut self, frame: &mut Frame) -> Result<(), RigFault> {
        self.rig.capture(frame)?;
        let due = Duration::from_nanos(self.rig.now().nanos());
        std::thread::sleep(due.saturating_sub(self.clock.elapsed()));
        Ok(())
    }

    fn trace(&self) -> AccelTrace {
        self.rig.trace()
    }

    fn stop(&mut self) {
        self.rig.stop();
    }
}
