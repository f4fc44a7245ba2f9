//! Segments of a motion without pauses that come too late to the rig.

use serde_json::json;

use super::in_memory::InMemoryRun;
use super::testing::{as_its_rig, job_in_configs};
use crate::config::JobSpec;
use upm_core::job::{CameraMode, Outcome};
use upm_core::rig::{Rig, RigError};
use upm_core::signal::{AccelTrace, Drive, Frame};
use upm_core::time::PlateTime;
use upm_sim::SimRig;

/// The take-over that is late, counted from 1.
const LATE: usize = 5;

/// A rig to which one segment comes late, by so many periods.
struct LateRig {
    rig: SimRig,
    late_periods: f64,
    /// Start of the present segment.
    began: PlateTime,
    /// A letter for each call: played, taken over, taken over a period late, refused, motors stopped.
    calls: String,
}

impl Rig for LateRig {
    as_its_rig! { now takes_over settled_at capture trace }

    fn play(&mut self, drive: &Drive) -> Result<(), RigError> {
        self.calls.push('p');
        self.began = self.now();
        self.rig.play(drive)
    }

    fn take_over(&mut self, drive: &Drive) -> Result<PlateTime, RigError> {
        let period_s = drive.envelope.attack_s;
        if self.calls.matches('t').count() + 1 == LATE && !self.calls.contains(['l', 'r']) {
            let until = self.began + self.late_periods * period_s;
            while self.now() < until {
                self.rig.capture(&mut Frame::new(1, 1))?;
            }
        }
        let begins = self.rig.take_over(drive);
        self.calls.push(match &begins {
            Ok(begins) if begins.secs_since(self.began) > 1.5 * period_s => 'l',
            Ok(_) => 't',
            Err(_) => 'r',
        });
        self.began = begins.clone().unwrap_or(self.began);
        begins
    }

    fn stop(&mut self) {
        self.calls.push('s');
        self.rig.stop();
    }
}

/// The calls of a run.
fn run(late_periods: f64) -> String {
    let job = json!({
        "name": "late", "seed": 3, "rig": "rigs/upm-2.json", "planner": "moving_field",
        "parts": [{"kind": "penny", "count": 4}],
        "task": {"type": "arrange", "targets_mm": [[-80.0, -60.0], [80.0, -60.0], [-80.0, 60.0], [80.0, 60.0]]},
    });
    let job: JobSpec = job_in_configs(&job).with_camera(CameraMode::Positions);
    let late = |rig| LateRig { rig, late_periods, began: PlateTime::ZERO, calls: String::new() };
    let (report, rig) = InMemoryRun::new(&job).unwrap().run_on(late).unwrap();
    assert_eq!(report.outcome, Outcome::Completed, "{}: {}", report.reason, rig.calls);
    assert_eq!(report.work.collisions, Some(0), "{}", rig.calls);
    rig.calls
}

#[test]
fn motion_plays_for_a_second_period_while_the_next_segment_is_late() {
    let calls = run(1.2);
    // the parts are where they are expected: the next segments follow, and nothing is stopped
    assert!(calls.contains("lttt"), "{calls}");
}

#[test]
fn motion_fades_out_where_the_next_segment_comes_too_late() {
    let calls = run(2.1);
    assert!(calls.contains("rpt"), "{calls}");
}
