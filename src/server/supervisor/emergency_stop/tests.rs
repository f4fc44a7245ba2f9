//! The state table of the module, checked against a model that numbers the stops.

use std::cell::Cell;
use std::sync::Barrier;
use std::thread;
use std::time::Duration;

use proptest::prelude::*;

use super::*;
use crate::store::StoreError;
use upm_core::rig::InterlockGuard;
use upm_core::time::PlateTime;

#[derive(Clone, Copy, Debug)]
enum ModelStep {
    Stop,
    /// Only the first step of a stop.
    Trip,
    TakeToken,
    /// A reset with the token taken so many before the last; whether it is allowed, and when another stop intervenes.
    Reset {
        token: usize,
        allowed: bool,
        stop: Option<ModelMoment>,
    },
    Attach,
    Detach,
    Keep,
    Restart,
}

#[derive(Clone, Copy, Debug, PartialEq)]
enum ModelMoment {
    Allowing,
    Pausing,
}

fn step() -> impl Strategy<Value = ModelStep> {
    let moment = prop_oneof![Just(ModelMoment::Allowing), Just(ModelMoment::Pausing)];
    let reset = (0..3_usize, prop::bool::weighted(0.9), prop::option::weighted(0.2, moment));
    prop_oneof![
        3 => Just(ModelStep::Stop),
        1 => Just(ModelStep::Trip),
        3 => Just(ModelStep::TakeToken),
        5 => reset.prop_map(|(token, allowed, stop)| ModelStep::Reset { token, allowed, stop }),
        1 => Just(ModelStep::Attach),
        2 => Just(ModelStep::Detach),
        2 => Just(ModelStep::Keep),
        1 => Just(ModelStep::Restart),
    ]
}

/// The state table as a model.
#[derive(Debug)]
struct Model {
    state: StopState,
    /// Number of the newest stop or reset.
    change: u32,
    /// State that the next start reads.
    on_disk: bool,
    attached: bool,
    pauses: u32,
}

impl Model {
    fn is_latched(&self) -> bool {
        self.state == StopState::Held
    }

    fn stop(&mut self) -> bool {
        let changed = !self.is_latched();
        self.state = StopState::Held;
        self.change += 1;
        changed
    }

    /// A reset of the stop numbered `token`.
    fn reset(&mut self, token: u32, allowed: bool, stop: Option<ModelMoment>) -> Result<(), ResetError> {
        match self.state {
            StopState::Held if token == self.change => {}
            StopState::Held => return Err(ResetError::StoppedAgain),
            StopState::Tripping => return Err(ResetError::StillStopping),
            _ => return Err(ResetError::NotStopped),
        }
        if stop == Some(ModelMoment::Allowing) {
            self.stop();
        }
        if !allowed {
            return Err(REFUSED);
        }
        if self.attached {
            return Err(ResetError::StillStopping);
        }
        self.pauses += 1;
        if stop == Some(ModelMoment::Pausing) {
            self.stop();
        }
        if stop.is_some() {
            return Err(ResetError::StoppedAgain);
        }
        (self.state, self.on_disk) = (StopState::Released, false);
        self.change += 1;
        Ok(())
    }
}

const LONG: Duration = Duration::from_secs(60);
const REFUSED: ResetError = ResetError::NotPersisted(StoreError::Full);

/// The emergency stop of a plate whose latch is in `folder`.
fn stop_in(folder: &tempfile::TempDir) -> EmergencyStop {
    let latch = Latch::open(folder.path(), "one", false).unwrap();
    EmergencyStop::new(latch, Interlock::default(), Arc::default())
}

proptest! {
    #[test]
    fn every_step_follows_the_state_table(steps in prop::collection::vec(step(), 1..60)) {
        let folder = tempfile::tempdir().unwrap();
        let mut stop = stop_in(&folder);
        let mut attached: Option<InterlockGuard> = None;
        let mut tokens: Vec<(StopToken, u32)> = Vec::new();
        let mut model =
            Model { state: StopState::Released, change: 0, on_disk: false, attached: false, pauses: 0 };
        for step in steps {
            let pauses = model.pauses;
            match step {
                ModelStep::Stop => prop_assert_eq!(stop.stop(), model.stop()),
                ModelStep::Trip => {
                    stop.interlock.trip(Trip::EStop);
                    if !model.is_latched() {
                        model.state = StopState::Tripping;
                    }
                }
                ModelStep::TakeToken => match (stop.held(), model.state) {
                    (Ok(held), StopState::Held) => tokens.push((held, model.change)),
                    (Err(ResetError::StillStopping), StopState::Tripping) => {}
                    (Err(ResetError::NotStopped), StopState::Released) => {}
                    (found, _) => prop_assert!(false, "{found:?} in {model:?}"),
                },
                ModelStep::Reset { token, allowed, stop: moment } => {
                    let Some(&(held, change)) = tokens.iter().rev().nth(token) else { continue };
                    let paused = Cell::new(0);
                    let stop_at = |at| (moment == Some(at)).then(|| stop.stop());
                    let allow = || {
                        stop_at(ModelMoment::Allowing);
                        if allowed { Ok(()) } else { Err(REFUSED) }
                    };
                    let pause = || {
                        paused.set(paused.get() + 1);
                        stop_at(ModelMoment::Pausing);
                    };
                    let reset = stop.reset(held, allow, pause);
                    prop_assert_eq!(reset, model.reset(change, allowed, moment));
                    prop_assert_eq!(paused.get(), model.pauses - pauses, "it is paused before it may move");
                }
                ModelStep::Attach => {
                    attached = attached.or_else(|| stop.interlock.attach(PlateTime::ZERO));
                    model.attached = true;
                }
                ModelStep::Detach => (attached, model.attached) = (None, false),
                ModelStep::Keep => {
                    prop_assert_eq!(stop.persist(), model.is_latched());
                    model.on_disk = model.is_latched();
                }
                ModelStep::Restart => {
                    (attached, model.attached) = (None, false);
                    stop = stop_in(&folder);
                    tokens.clear();
                    model.state = if model.on_disk { StopState::Held } else { StopState::Released };
                    model.change = 0;
                }
            }
            prop_assert_eq!(stop.state(), model.state);
            prop_assert_eq!(stop.holds(), model.state != StopState::Released);
            prop_assert_eq!(stop.cause().is_some(), stop.holds());
            prop_assert_eq!(stop.interlock.tripped(), stop.holds().then_some(Trip::EStop), "motors move when none holds");
        }
        drop(attached);
    }
}

#[test]
fn wait_ends_when_the_motors_are_off() {
    let folder = tempfile::tempdir().unwrap();
    let stop = stop_in(&folder);
    let _fitted = stop.interlock.attach(PlateTime::ZERO);
    stop.interlock.energize().unwrap();
    let start = Barrier::new(2);
    thread::scope(|scope| {
        let silent = scope.spawn(|| {
            start.wait();
            stop.interlock.wait_until_motors_off(LONG)
        });
        stop.stop();
        start.wait();
        assert_eq!(stop.interlock.wait_until_motors_off(Duration::from_millis(1)), None, "it sounds");
        stop.interlock.motors_off(PlateTime::from_secs(0.001));
        assert!(silent.join().unwrap().is_some());
    });
}
