use std::sync::Arc;

use super::params::EpisodeParams;
use super::single::Episode;
use super::types::StepOutcome;
use crate::config::{Diagnostic, Path};
use crate::run::RunError;
use upm_core::background::on_threads;

/// Most episodes that are stepped together.
const MOST_EPISODES: usize = 4096;

/// Episodes that are stepped together, on all cores that the process may use. Their results depend neither on the
/// number of threads nor on that of the episodes: number i with seed s is [`Episode`] with seed s + i.
///
/// Autoreset is Gymnasium's NEXT_STEP: the step after an end ignores its action and begins a new episode.
pub struct Episodes {
    params: Arc<EpisodeParams>,
    /// The episodes.
    pub episodes: Vec<Episode>,
    threads: usize,
}

impl Episodes {
    /// `number` episodes with the seeds from `seed` on, on `threads` threads; 0 is one for each core.
    ///
    /// # Errors
    /// As [`Episode::new`]; no episode, or too many.
    pub fn new(params: &Arc<EpisodeParams>, number: usize, seed: u64, threads: usize) -> Result<Self, RunError> {
        if !(1..=MOST_EPISODES).contains(&number) {
            return Err(Diagnostic::new("episodes", Path::root(), number, format!("1 to {MOST_EPISODES}")).into());
        }
        let begin = |i: usize| Episode::new(params, seed.wrapping_add(i as u64));
        let episodes = on_threads(threads, 0..number, &|_| (), begin).into_iter().collect::<Result<_, _>>()?;
        Ok(Self { params: Arc::clone(params), episodes, threads })
    }

    /// Begins new episodes: with the seeds from `seed` on, or with seeds that follow from the last ones.
    ///
    /// # Errors
    /// As [`Episode::new`].
    pub fn reset(&mut self, seed: Option<u64>) -> Result<(), RunError> {
        let reset = |(i, episode): (usize, &mut Episode)| episode.reset(seed.map(|seed| seed.wrapping_add(i as u64)));
        on_threads(self.threads, self.episodes.iter_mut().enumerate(), &|_| (), reset).into_iter().collect()
    }

    /// Steps every episode by its part of `actions`.
    ///
    /// # Errors
    /// Actions as in [`Episode::step`], the index counted over all of them: nothing has moved. A drive that a rig
    /// refuses.
    pub fn step(&mut self, actions: &[f64]) -> Result<Vec<StepOutcome>, RunError> {
        self.params.check_actions(actions, self.episodes.len())?;
        let step = |(episode, action): (&mut Episode, &[f64])| {
            if episode.outcome().is_last() {
                episode.reset(None)?;
                return Ok(*episode.outcome());
            }
            episode.play(action)
        };
        let all = self.episodes.iter_mut().zip(actions.chunks_exact(self.params.action_bounds.len()));
        on_threads(self.threads, all, &|_| (), step).into_iter().collect()
    }

    /// Writes the observations of all, one after another; those beyond the end of `out` are left out.
    pub fn observe(&self, out: &mut [f64]) {
        let out = out.chunks_mut(self.params.observation_len());
        self.episodes.iter().zip(out).for_each(|(episode, out)| episode.observe(out));
    }

    /// The planners' actions, one after another.
    pub fn expert(&mut self) -> Vec<f64> {
        on_threads(self.threads, self.episodes.iter_mut(), &|_| (), Episode::expert).concat()
    }
}
