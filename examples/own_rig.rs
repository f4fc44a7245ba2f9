//! A custom rig that wraps another, logs every pulse and refuses those that are too strong. A driver of real hardware
//! implements the same seven methods.
//!
//! ```text
//! cargo run --example own_rig
//! ```
#![allow(clippy::print_stdout)] // an example talks to its reader

use std::path::Path;

use upm::config::JobSpec;
use upm::rig::{Rig, RigError};
use upm::run::{InMemoryRun, RunError};
use upm::signal::{AccelTrace, Drive, Frame};
use upm::time::PlateTime;

/// Rig that logs the pulses of `rig` and refuses those stronger than `limit_counts`.
struct Logged<R> {
    rig: R,
    limit_counts: f64,
    pulses: u64,
    frames: u64,
}

impl<R: Rig> Rig for Logged<R> {
    fn play(&mut self, drive: &Drive) -> Result<(), RigError> {
        let (peak_counts, limit_counts) = (drive.peak_counts(), self.limit_counts);
        if peak_counts > limit_counts {
            return Err(RigError::DriveTooStrong { peak_counts, limit_counts });
        }
        self.pulses += 1;
        let (at_s, sustain_s) = (self.now().secs(), drive.envelope.sustain_s);
        println!("{at_s:8.3} s  pulse {}, sustained {sustain_s:.3} s, peak {peak_counts:.0} counts", self.pulses);
        self.rig.play(drive)
    }

    fn capture(&mut self, frame: &mut Frame) -> Result<(), RigError> {
        self.frames += 1;
        self.rig.capture(frame)
    }

    fn now(&self) -> PlateTime {
        self.rig.now()
    }

    fn settled_at(&self) -> PlateTime {
        self.rig.settled_at()
    }

    fn trace(&self) -> AccelTrace {
        self.rig.trace()
    }

    fn stop(&mut self) {
        self.rig.stop();
    }

    fn pass(&mut self, until: PlateTime) -> Result<(), RigError> {
        self.rig.pass(until)
    }
}

fn main() -> Result<(), RunError> {
    let job = JobSpec::load(Path::new("configs/arrange-2.json"))?;
    let limit_counts = job.rig.model.count_limit;
    let logged = |rig| Logged { rig, limit_counts, pulses: 0, frames: 0 };
    let (report, rig) = InMemoryRun::new(&job)?.run_on(logged)?;

    println!("{}: {}", report.outcome.code(), report.reason);
    println!("{} pulses and {} frames passed through the rig", rig.pulses, rig.frames);
    Ok(())
}
