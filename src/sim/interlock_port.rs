use upm_core::rig::{Interlock, InterlockGuard, RigError, Trip};
use upm_core::time::PlateTime;

/// The rig's side of its interlock. A rig without an interlock is never stopped from outside.
#[derive(Debug, Default)]
pub(super) struct InterlockPort {
    guard: Option<InterlockGuard>,
    pub(super) driving: bool,
    cut: bool,
}

impl InterlockPort {
    pub(super) fn attach(&mut self, interlock: &Interlock, now: PlateTime) -> Result<(), RigError> {
        let refused = || RigError::Device("the interlock is fitted to another rig".into());
        self.guard = Some(interlock.attach(now).ok_or_else(refused)?);
        Ok(())
    }

    /// Returns `Err` once tripped.
    pub(super) fn check(&self) -> Result<(), RigError> {
        let trip = self.guard.as_ref().and_then(|guard| guard.tripped());
        trip.map_or(Ok(()), |trip| Err(RigError::Stopped(trip)))
    }

    /// Marks the start of a pulse; refused once tripped.
    pub(super) fn energize(&mut self) -> Result<(), RigError> {
        self.guard.as_ref().map_or(Ok(()), |guard| guard.energize()).map_err(RigError::Stopped)?;
        self.driving = true;
        Ok(())
    }

    /// Reports a step at `now` to the interlock; true when the motors must be cut in it.
    #[inline]
    pub(super) fn should_cut(&mut self, now: PlateTime) -> bool {
        let tripped = self.guard.as_ref().is_some_and(|guard| guard.step(now).is_some());
        tripped && !std::mem::replace(&mut self.cut, true)
    }

    /// Trips because the lease expired at `now`; an earlier trip stays in force.
    pub(super) fn lease_expired(&mut self, now: PlateTime) -> Trip {
        self.cut = true;
        let Some(guard) = &self.guard else { return Trip::Lease };
        guard.step(now);
        guard.trip(Trip::Lease);
        guard.tripped().unwrap_or(Trip::Lease)
    }

    /// Reports that the motors are at zero from `now` on.
    pub(super) fn motors_off(&mut self, now: PlateTime) {
        if std::mem::take(&mut self.driving)
            && let Some(guard) = &self.guard
        {
            guard.motors_off(now);
        }
    }
}
