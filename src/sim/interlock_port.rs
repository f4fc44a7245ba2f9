use upm_core::rig::{Interlock, InterlockGuard, RigFault, Trip};
use upm_core::time::PlateTime;

/// The rig's side of its interlock. A rig without an interlock is never stopped from outside.
#[derive(Debug, Default)]
pub(super) struct InterlockPort {
    fitted: Option<InterlockGuard>,
    driving: bool,
    cut: bool,
}

impl InterlockPort {
    pub(super) fn attach(&mut self, interlock: &Interlock, now: PlateTime) -> Result<(), RigFault> {
        match interlock.attach(now) {
            Some(fitted) => self.fitted = Some(fitted),
            None => return Err(RigFault::Device("the interlock is fitted to another rig".into())),
        }
        Ok(())
    }

    pub(super) fn tripped(&self) -> Option<Trip> {
        self.fitted.as_ref().and_then(|fitted| fitted.tripped())
    }

    /// Returns `Err` once tripped.
    pub(super) fn check(&self) -> Result<(), RigFault> {
        self.tripped().map_or(Ok(()), |trip| Err(RigFault::Stopped(trip)))
    }

    /// Marks the start of a pulse; refused once tripped.
    pub(super) fn energize(&mut self) -> Result<(), RigFault> {
        self.fitted.as_ref().map_or(Ok(()), |fitted| fitted.energize()).map_err(RigFault::Stopped)?;
        self.driving = true;
        Ok(())
    }

    pub(super) fn is_driving(&self) -> bool {
        self.driving
    }

    /// Reports a step at `now` to the interlock; true when the motors must be cut in it.
    #[inline]
    pub(super) fn should_cut(&mut self, now: PlateTime) -> bool {
        let tripped = self.fitted.as_ref().is_some_and(|fitted| fitted.step(now).is_some());
        tripped && !std::mem::replace(&mut self.cut, true)
    }

    /// Trips because the lease expired at `now`; an earlier trip stays in force.
    pub(super) fn lease_expired(&mut self, now: PlateTime) -> Trip {
        self.cut = true;
        let Some(fitted) = &self.fitted else { return Trip::Lease };
        fitted.step(now);
        fitted.trip(Trip::Lease);
        fitted.tripped().unwrap_or(Trip::Lease)
    }

    /// Reports that the motors are at zero from `now` on.
    pub(super) fn motors_off(&mut self, now: PlateTime) {
        if std::mem::take(&mut self.driving)
            && let Some(fitted) = &self.fitted
        {
            fitted.motors_off(now);
        }
    }
}
