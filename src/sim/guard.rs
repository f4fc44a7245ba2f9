use upm_core::rig::{Fitted, Interlock, RigFault, Trip};
use upm_core::time::PlateTime;

/// The rig's side of its interlock. A rig without an interlock is never stopped from outside.
#[derive(Debug, Default)]
pub(super) struct Guard {
    fitted: Option<Fitted>,
    sounding: bool,
    cut: bool,
}

impl Guard {
    pub(super) fn fit(&mut self, interlock: &Interlock, now: PlateTime) -> Result<(), RigFault> {
        match interlock.fit(now) {
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
    pub(super) fn sound(&mut self) -> Result<(), RigFault> {
        self.fitted.as_ref().map_or(Ok(()), |fitted| fitted.sound()).map_err(RigFault::Stopped)?;
        self.sounding = true;
        Ok(())
    }

    pub(super) fn is_sounding(&self) -> bool {
        self.sounding
    }

    /// Reports a step at `now` to the interlock; true when the motors must be cut in it.
    #[inline]
    pub(super) fn cuts(&mut self, now: PlateTime) -> bool {
        let tripped = self.fitted.as_ref().is_some_and(|fitted| fitted.step(now).is_some());
        tripped && !std::mem::replace(&mut self.cut, true)
    }

    /// Trips because the lease expired at `now`; an earlier trip stays in force.
    pub(super) fn lease_ran_out(&mut self, now: PlateTime) -> Trip {
        self.cut = true;
        let Some(fitted) = &self.fitted else { return Trip::Lease };
        fitted.step(now);
        fitted.trip(Trip::Lease);
        fitted.tripped().unwrap_or(Trip::Lease)
    }

    /// Reports that the motors are at zero from `now` on.
    pub(super) fn silent(&mut self, now: PlateTime) {
        if std::mem::take(&mut self.sounding)
            && let Some(fitted) = &self.fitted
        {
            fitted.silent(now);
        }
    }
}
