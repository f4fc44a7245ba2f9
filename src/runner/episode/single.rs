use std::sync::Arc;

use rand_distr::{Distribution, StandardUniform};
use sha2::{Digest, Sha256};

use super::actions::ActionPlanner;
use super::params::EpisodeParams;
use super::plate::SteppedPlate;
use super::types::{ActionKind, EpisodeTask, StepOutcome};
use crate::config::{Assignment, Diagnostic, Path, PlacedPart, TaskSpec, free_place, place_parts};
use crate::run::{RunError, task};
use upm_control::GainEstimator;
use upm_core::geometry::Vec2;
use upm_core::random::{Rng, Streams};
use upm_core::rig::{Rig, RigError};
use upm_core::signal::Frame;
use upm_core::units::mm_from_m;
use upm_planning::planner::{PartState, PlanningMethod};
use upm_planning::task::Task;

/// A plate with its task, stepped by actions. Equal parameters, seeds and actions give equal journals.
pub struct Episode {
    params: Arc<EpisodeParams>,
    seed: u64,
    plate: SteppedPlate,
    planner: ActionPlanner,
    /// Learned from steps that are planned here, and from any action in a state in which the expert was asked.
    gains: GainEstimator,
    /// Target of each part, m.
    targets_m: Vec<Vec2>,
    draws: Rng,
    /// The expert's task, once it is asked.
    task: Option<Box<dyn Task + Send>>,
    /// The expert's action in this state, once it is asked.
    expert: Option<Vec<f64>>,
    outcome: StepOutcome,
    journal: Sha256,
}

impl Episode {
    /// The first episode with `seed`.
    ///
    /// # Errors
    /// Parts or targets that find no places.
    pub fn new(params: &Arc<EpisodeParams>, seed: u64) -> Result<Self, RunError> {
        Self::begin(params, seed, Sha256::new())
    }

    fn begin(params: &Arc<EpisodeParams>, seed: u64, journal: Sha256) -> Result<Self, RunError> {
        let job = params.job.clone().with_seed(seed);
        let mut episode = Self {
            params: Arc::clone(params),
            seed,
            plate: SteppedPlate::new(&job)?,
            planner: params.planner()?,
            gains: GainEstimator::new(params.parts(), 0.5 * job.rig.model.plate_side_m),
            targets_m: Vec::new(),
            draws: Streams::new(seed).stream("episode targets"),
            task: None,
            expert: None,
            outcome: StepOutcome::default(),
            journal: journal.chain_update(seed.to_le_bytes()),
        };
        episode.targets_m = if params.is_drawn {
            // the start places of another seed
            let drawn = job.with_seed(StandardUniform.sample(&mut episode.draws));
            place_parts(&drawn, Streams::new(seed))?.iter().map(|part| part.position_m).collect()
        } else {
            episode.task_of(&params.job.task).next(episode.plate.rig.now(), &episode.plate.seen_m).targets_m
        };
        let (mean_distance_m, plate_time_s) = (episode.mean_distance_m(), episode.plate.rig.now().secs());
        episode.outcome = StepOutcome { mean_distance_m, plate_time_s, was_reset: true, ..StepOutcome::default() };
        episode.record(&[]);
        Ok(episode)
    }

    /// Begins a new episode: with `seed`, as [`Self::new`], or without one with a seed that follows from the last one,
    /// whose journal goes on.
    ///
    /// # Errors
    /// As [`Self::new`]; the present episode stays.
    pub fn reset(&mut self, seed: Option<u64>) -> Result<(), RunError> {
        let next = || StandardUniform.sample(&mut Streams::new(self.seed).stream("next episode"));
        let journal = if seed.is_some() { Sha256::new() } else { self.journal.clone() };
        *self = Self::begin(&self.params, seed.unwrap_or_else(next), journal)?;
        Ok(())
    }

    /// Plays `action` until the parts are seen at rest.
    ///
    /// # Errors
    /// An action of another length or out of [`EpisodeParams::action_bounds`], and one after the end: nothing has
    /// moved. A drive that the rig refuses.
    pub fn step(&mut self, action: &[f64]) -> Result<StepOutcome, RunError> {
        self.params.check_actions(action, 1)?;
        if self.outcome.is_last() {
            return Err(Diagnostic::new("action", Path::root(), "one after the end", "a reset").into());
        }
        self.play(action)
    }

    /// As [`Self::step`], for an action that was checked.
    pub(super) fn play(&mut self, action: &[f64]) -> Result<StepOutcome, RunError> {
        let (at_rest, collisions) = (self.states(&[]), self.plate.truth.collisions);
        let pulse = self.planner.pulse(action, &at_rest);
        let undriven = || RigError::BadDrive("the library does not drive this action".into());
        let drive = pulse.as_ref().map(|pulse| pulse.drive(&self.params.library).ok_or_else(undriven)).transpose()?;
        let before_m = self.mean_distance_m();
        self.plate.play(drive.as_ref())?;
        // planning a step reads the gains, and so does the expert
        let is_planned = self.expert.take().is_some() || self.params.action == ActionKind::Steps;
        if let Some(pulse) = pulse.filter(|_| is_planned) {
            let forecast = |parts: &[PartState]| self.planner.forecast(parts, &pulse);
            self.gains.learn_pulse(&pulse, &at_rest, &self.plate.seen_m, &forecast);
        }
        let closer = (before_m - self.mean_distance_m()) / (0.5 * self.params.job.rig.model.plate_side_m);
        let has_fallen = !self.plate.truth.parts.iter().all(|part| part.on_plate);
        let is_stream = self.params.task == EpisodeTask::Stream;
        let arrived = if is_stream && !has_fallen { self.renew_targets() } else { 0 };
        let is_success = arrived > 0 || !is_stream && !has_fallen && self.is_done();
        let bonus = if is_stream { arrived as f64 } else { f64::from(u8::from(is_success)) };
        let terminated = has_fallen || is_success && !is_stream;
        let plate_time_s = self.plate.rig.now().secs();
        self.outcome = StepOutcome {
            reward: if has_fallen { -1.0 } else { closer + bonus },
            terminated,
            truncated: !terminated && plate_time_s >= self.params.job.plate_time_limit_s,
            is_success,
            collisions: self.plate.truth.collisions - collisions,
            arrived,
            mean_distance_m: self.mean_distance_m(),
            plate_time_s,
            was_reset: false,
        };
        self.record(action);
        Ok(self.outcome)
    }

    /// Outcome of the last step; that of a reset before the first.
    pub fn outcome(&self) -> &StepOutcome {
        &self.outcome
    }

    /// Seed of the episode.
    pub fn seed(&self) -> u64 {
        self.seed
    }

    /// Writes the observation ([`EpisodeParams::observation_len`]); numbers beyond the end of `out` are left out.
    pub fn observe(&self, out: &mut [f64]) {
        let SteppedPlate { seen_m, velocities_mps, .. } = &self.plate;
        let all = seen_m.iter().chain(&self.targets_m).chain(velocities_mps).flat_map(|m| [m.x, m.y]);
        out.iter_mut().zip(all).for_each(|(out, m)| *out = mm_from_m(m));
    }

    /// The planner's action in this state: zero where it finds none, or all parts have arrived.
    pub fn expert(&mut self) -> Vec<f64> {
        if let Some(action) = &self.expert {
            return action.clone();
        }
        let mut task = self.task.take().unwrap_or_else(|| {
            let targets_m = self.targets_m.iter().copied().map(Some).collect();
            self.task_of(&TaskSpec::Arrange { targets_m, assignment: Assignment::Fixed })
        });
        let wanted = task.next(self.plate.rig.now(), &self.plate.seen_m);
        let subgoals_m = if wanted.done { &self.plate.seen_m } else { &wanted.subgoals_m };
        let action = self.planner.expert(&self.states(subgoals_m), wanted.stride_m);
        self.task = Some(task);
        self.expert.insert(action).clone()
    }

    /// The camera's picture of the plate at rest, and the targets in it, px.
    pub fn picture(&mut self) -> (Frame, Vec<Vec2>) {
        let SteppedPlate { rig, truth, .. } = &mut self.plate;
        let picture = rig.picture();
        let image_of = |target_m: &Vec2| rig.image_from_table(truth.plate_in_table.apply(*target_m), 0.0);
        (picture, self.targets_m.iter().map(image_of).collect())
    }

    /// SHA-256 over the seed, every action and the bits of all true positions since the last seed was given, in
    /// hexadecimal digits.
    pub fn journal_hash(&self) -> String {
        format!("{:x}", self.journal.clone().finalize())
    }

    fn record(&mut self, action: &[f64]) {
        let places = self.plate.true_m().flat_map(|place_m| [place_m.x, place_m.y]);
        let numbers = action.iter().copied().chain(places);
        // each update costs, however short it is
        self.journal.update(numbers.flat_map(|number| number.to_bits().to_le_bytes()).collect::<Vec<u8>>());
        self.journal.update(self.plate.rig.now().nanos().to_le_bytes());
    }

    fn task_of(&self, spec: &TaskSpec) -> Box<dyn Task + Send> {
        let EpisodeParams { job, library, .. } = &*self.params;
        let by_rotations = self.params.action == ActionKind::Pulse;
        let method = if by_rotations { PlanningMethod::CorSequence } else { PlanningMethod::SynthesizedField };
        task(job, spec, library, &self.plate.parts, method)
    }

    /// The parts with their steps to `subgoals_m`, where there are any.
    fn states(&self, subgoals_m: &[Vec2]) -> Vec<PartState> {
        let state = |(i, (position_m, part)): (usize, (&Vec2, &PlacedPart))| PartState {
            position_m: *position_m,
            step_m: subgoals_m.get(i).map_or_else(Vec2::zeros, |subgoal_m| subgoal_m - position_m),
            radius_m: part.params.radius_m,
            gain: self.gains.get(i, *position_m),
        };
        self.plate.seen_m.iter().zip(&self.plate.parts).enumerate().map(state).collect()
    }

    fn distances_m(&self) -> impl Iterator<Item = f64> {
        self.plate.true_m().zip(&self.targets_m).map(|(place_m, target_m)| (target_m - place_m).norm())
    }

    fn mean_distance_m(&self) -> f64 {
        self.distances_m().sum::<f64>() / self.targets_m.len().max(1) as f64
    }

    /// True if every part is in its bin or, without bins, at its target.
    fn is_done(&self) -> bool {
        let job = &self.params.job;
        let TaskSpec::Sort { bins } = &job.task else {
            return self.distances_m().all(|distance_m| distance_m <= job.tolerance_m);
        };
        self.plate.true_m().zip(&self.plate.parts).enumerate().all(|(index, (place_m, part))| {
            bins.iter().any(|bin| bin.parts.contains(&index) && bin.inside_m(place_m, part.params.radius_m) >= 0.0)
        })
    }

    /// New targets for the parts that have arrived; returns their number. A target stays where there is no other place.
    fn renew_targets(&mut self) -> usize {
        let arrived: Vec<bool> =
            self.distances_m().map(|distance_m| distance_m <= self.params.job.tolerance_m).collect();
        let Self { plate, targets_m, draws, params, .. } = self;
        let (radius_m, mut renewed) = (|part: usize| plate.parts[part].params.radius_m, 0);
        for part in (0..arrived.len()).filter(|part| arrived[*part]) {
            let others =
                (0..arrived.len()).filter(|other| *other != part).map(|other| (targets_m[other], radius_m(other)));
            if let Some(target_m) = free_place(radius_m(part), others, 0.5 * params.job.rig.model.plate_side_m, draws) {
                (targets_m[part], self.task) = (target_m, None);
                renewed += 1;
            }
        }
        renewed
    }
}
