//! Knocks against the plate of a simulated rig, as the rig's file asks for them.

use rand_distr::{Distribution, StandardUniform};

use crate::config::Knocks;
use upm_core::random::Streams;
use upm_core::time::PlateTime;
use upm_core::units::written_mm;
use upm_sim::faults::{FaultKind, FaultSpec, FaultyComponent};

/// The knocks of a run of at most `until_s` of plate time, from a separate random stream.
pub(super) fn drawn(knocks: &Knocks, until_s: f64, streams: &Streams) -> Vec<FaultSpec> {
    let mut noise = streams.stream("knocks");
    let mut draw = || -> f64 { StandardUniform.sample(&mut noise) };
    let (mut at_s, mut drawn) = (0.0, Vec::new());
    loop {
        at_s += knocks.every_s * (0.5 + draw());
        if at_s >= until_s {
            return drawn;
        }
        let strength = 0.5 + draw();
        let [x_mm, y_mm] = [knocks.push_m.x, knocks.push_m.y].map(|m| strength * written_mm(m));
        drawn.push(FaultSpec {
            component: FaultyComponent::Plate,
            kind: FaultKind::Bumped,
            values: [x_mm, y_mm, 0.0],
            from: PlateTime::from_secs(at_s),
            // it happens once, at its onset
            to: Some(PlateTime::from_secs(at_s)),
        });
    }
}

#[cfg(test)]
mod tests {
    use std::path::Path;
    use std::sync::Arc;
    use std::sync::atomic::AtomicBool;

    use super::super::job_library;
    use super::super::setup::RunSetup;
    use super::*;
    use crate::config::JobSpec;
    use upm_control::{CycleFacts, RunIo, Sink};
    use upm_core::job::{CameraMode, Outcome};
    use upm_core::rig::Rig;
    use upm_core::time::MonotonicClock;
    use upm_planning::cor_library::Library;
    use upm_sim::faults::Faulty;

    fn hold_4(seed: u64) -> (JobSpec, Arc<Library>) {
        let path = Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../../configs/hold-4.json"));
        let job = JobSpec::load(path).unwrap().with_seed(seed).with_camera(CameraMode::Positions);
        let library = job_library(&job).unwrap();
        (job, library)
    }

    #[test]
    fn knocks_have_the_configured_rate_and_strength() {
        let knocks = Knocks { every_s: 1.5, push_m: upm_core::geometry::Vec2::new(0.6e-3, -0.8e-3) };
        let drawn = |seed| drawn(&knocks, 1500.0, &Streams::new(seed));
        let all = drawn(3);
        assert!((960..1040).contains(&all.len()), "{}", all.len());
        for pair in all.windows(2) {
            let apart_s = pair[1].from.secs_since(pair[0].from);
            assert!((0.749..2.251).contains(&apart_s), "{apart_s}");
        }
        for FaultSpec { values: [x_mm, y_mm, _], .. } in &all {
            assert!((0.3..0.9).contains(x_mm) && (y_mm + x_mm * 0.8 / 0.6).abs() < 1e-9, "{x_mm} {y_mm}");
        }
        assert_eq!(all, drawn(3));
        assert_ne!(all, drawn(4));
    }

    /// Largest distance of a part from its start after 10 s without any pulse, mm.
    fn left_alone_mm(seed: u64) -> f64 {
        let (job, library) = hold_4(seed);
        let RunSetup { mut rig, truth, placed, faults, streams, .. } = RunSetup::new(&job, &library).unwrap();
        let mut rig = Faulty::new(&mut rig, &faults, streams, &std::thread::sleep);
        let mut frame = upm_core::signal::Frame::new(1, 1);
        while rig.now() < PlateTime::from_secs(10.0) {
            rig.capture(&mut frame).unwrap();
        }
        let truth = truth.read();
        let apart = placed
            .iter()
            .zip(&truth.parts)
            .map(|(start, end)| (end.part_in_table.position_m - start.position_m).norm());
        1e3 * apart.fold(0.0, f64::max)
    }

    /// Cycles that brought parts back.
    #[derive(Default)]
    struct Corrections(usize);

    impl Sink for Corrections {
        fn cycle(&mut self, facts: &CycleFacts) {
            self.0 += usize::from(!facts.plan.pulses.is_empty());
        }
    }

    #[test]
    fn parts_of_the_shipped_job_stay_only_because_they_are_held() {
        for seed in 1..=3 {
            let left_mm = left_alone_mm(seed);
            assert!(left_mm > 2.0, "seed {seed}: {left_mm} mm off, four times the tolerance at least");
            let (job, library) = hold_4(seed);
            let RunSetup { mut rig, truth, model, mut task, params, placed, faults, streams, .. } =
                RunSetup::new(&job, &library).unwrap();
            let mut rig = Faulty::new(&mut rig, &faults, streams, &std::thread::sleep);
            let mut sink = Corrections::default();
            let no = AtomicBool::new(false);
            let clock = MonotonicClock::new();
            let (rig, sink, clock) = (&mut rig, &mut sink, &clock);
            let io = RunIo { rig, model: &model, sink, clock, stop: &no, give_way: &no, planner: None };
            let end = upm_control::run(io, &library, task.as_mut(), &params);
            assert_eq!(end.ending.outcome, Outcome::Completed, "seed {seed}: {}", end.ending.reason);
            let truth = truth.read();
            let held = placed.iter().zip(&truth.parts);
            let held_mm = held.map(|(start, end)| 1e3 * (end.part_in_table.position_m - start.position_m).norm());
            let held_mm = held_mm.fold(0.0, f64::max);
            assert!(held_mm < 0.5 && sink.0 >= 5, "seed {seed}: {held_mm} mm off after {} corrections", sink.0);
        }
    }
}
