//! Plates that are stepped together, for learning environments.

use std::path::PathBuf;
use std::sync::{Arc, Mutex, PoisonError};

use numpy::{PyArray1, PyArray2, PyArrayMethods, PyReadonlyArray1};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use pyo3::types::PyDict;

use super::refusal::said;
use upm::config::Origin;
use upm::episode::{Episode, EpisodeParams, Episodes, StepOutcome};
use upm::signal::Frame;
use upm::units::mm_from_m;

/// Plates of one description.
#[pyclass(module = "upm._upm")]
pub struct Plates {
    params: Arc<EpisodeParams>,
    /// Never waited for: each method has the plates for itself.
    episodes: Mutex<Episodes>,
}

type Matrix<'py, T> = Bound<'py, PyArray2<T>>;

impl Plates {
    fn episodes(&mut self) -> &mut Episodes {
        self.episodes.get_mut().unwrap_or_else(PoisonError::into_inner)
    }
}

#[pymethods]
impl Plates {
    /// `number` plates of the description in `text`, JSON, with the seeds from `seed` on, on `threads` threads; 0 is
    /// one for each core.
    #[new]
    fn new(
        py: Python<'_>,
        text: &str,
        folder: PathBuf,
        name: String,
        number_seed_threads: (usize, u64, usize),
    ) -> PyResult<Self> {
        let (number, seed, threads) = number_seed_threads;
        let made = py.detach(|| {
            let params = Arc::new(EpisodeParams::from_json(text, &Origin { file: name, folder: Some(folder) })?);
            Ok(Self { episodes: Mutex::new(Episodes::new(&params, number, seed, threads)?), params })
        });
        made.map_err(said)
    }

    fn reset(&mut self, py: Python<'_>, seed: Option<u64>) -> PyResult<()> {
        py.detach(|| self.episodes().reset(seed)).map_err(said)
    }

    /// Steps every plate by its part of `actions`: what became of each, by name.
    fn step<'py>(&mut self, py: Python<'py>, actions: PyReadonlyArray1<'py, f64>) -> PyResult<Bound<'py, PyDict>> {
        let actions = actions.as_slice().map_err(|error| PyValueError::new_err(error.to_string()))?;
        let all = py.detach(|| self.episodes().step(actions)).map_err(said)?;
        let outcomes = PyDict::new(py);
        put(&outcomes, &all, "reward", |one| one.reward)?;
        put(&outcomes, &all, "terminated", |one| one.terminated)?;
        put(&outcomes, &all, "truncated", |one| one.truncated)?;
        put(&outcomes, &all, "is_success", |one| one.is_success)?;
        put(&outcomes, &all, "collisions", |one| one.collisions)?;
        put(&outcomes, &all, "arrived", |one| one.arrived as u64)?;
        put(&outcomes, &all, "mean_distance_mm", |one| mm_from_m(one.mean_distance_m))?;
        put(&outcomes, &all, "plate_time_s", |one| one.plate_time_s)?;
        Ok(outcomes)
    }

    /// Observations, a row for each plate.
    fn observe<'py>(&mut self, py: Python<'py>) -> PyResult<Matrix<'py, f64>> {
        let shape = [self.episodes().episodes.len(), self.params.observation_len()];
        let mut observed = vec![0.0; shape[0] * shape[1]];
        self.episodes().observe(&mut observed);
        PyArray1::from_vec(py, observed).reshape(shape)
    }

    /// Our planner's actions, a row for each plate.
    fn expert<'py>(&mut self, py: Python<'py>) -> PyResult<Matrix<'py, f64>> {
        let shape = [self.episodes().episodes.len(), self.params.action_bounds.len()];
        PyArray1::from_vec(py, py.detach(|| self.episodes().expert())).reshape(shape)
    }

    /// Least and largest value of each number of an action.
    fn action_bounds<'py>(&self, py: Python<'py>) -> PyResult<Matrix<'py, f64>> {
        let bounds = &self.params.action_bounds;
        PyArray1::from_iter(py, bounds.iter().copied().flatten()).reshape([bounds.len(), 2])
    }

    /// Hash of each plate's journal since it got its last seed.
    fn journal_hashes(&mut self) -> Vec<String> {
        self.episodes().episodes.iter().map(Episode::journal_hash).collect()
    }

    /// The picture of plate number `index`, and its targets in it, px.
    fn picture<'py>(&mut self, py: Python<'py>, index: usize) -> PyResult<(Matrix<'py, u8>, Matrix<'py, f64>)> {
        let beyond = || PyValueError::new_err(format!("no plate has the number {index}"));
        let episode = self.episodes().episodes.get_mut(index).ok_or_else(beyond)?;
        let (Frame { width, height, pixels, .. }, targets_px) = py.detach(|| episode.picture());
        let targets_px = PyArray1::from_iter(py, targets_px.iter().flat_map(|at_px| [at_px.x, at_px.y]));
        let rows = targets_px.len()? / 2;
        Ok((PyArray1::from_vec(py, pixels).reshape([height, width])?, targets_px.reshape([rows, 2])?))
    }

    #[getter]
    fn parts(&self) -> usize {
        self.params.parts()
    }

    #[getter]
    fn plate_side_mm(&self) -> f64 {
        mm_from_m(self.params.job.rig.model.plate_side_m)
    }
}

/// Puts a figure of each of `all` plates into `outcomes`, an array called `name`.
fn put<T: numpy::Element>(
    outcomes: &Bound<'_, PyDict>,
    all: &[StepOutcome],
    name: &str,
    of: fn(&StepOutcome) -> T,
) -> PyResult<()> {
    outcomes.set_item(name, PyArray1::from_iter(outcomes.py(), all.iter().map(of)))
}
