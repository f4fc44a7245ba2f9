//! Tasks, planners and rigs of the caller's, in Python. An exception in one of them ends the run and is raised after
//! it.

mod caller;
mod rig;

use caller::Caller;
pub use caller::Raised;
pub use rig::SimulatedPlate;

use std::sync::Arc;
use std::sync::atomic::AtomicBool;

use numpy::{PyArray2, PyReadonlyArray2, PyReadonlyArray3, PyUntypedArrayMethods};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

use upm::control::OwnPlanner;
use upm::cor_library::Library;
use upm::geometry::{Twist, Vec2};
use upm::planner::{FieldPulse, PartState, PlannedPulse, Rotation};
use upm::run::OwnParts;
use upm::signal::{Follows, TwistHarmonic, TwistWave};
use upm::task::{Setpoints, Task};
use upm::time::PlateTime;
use upm::units::{m_from_mm, mm_from_m};

/// Task, planner and rig of the caller's, in the place of a job's own.
#[derive(FromPyObject)]
pub struct Own {
    task: Option<Py<PyAny>>,
    planner: Option<Py<PyAny>>,
    rig: Option<Py<PyAny>>,
}

impl Own {
    /// The same for a run that `stop` ends; the first exception is kept in `raised`.
    pub fn parts(self, library: &Arc<Library>, stop: &Arc<AtomicBool>, raised: &Raised) -> OwnParts {
        let caller = |object| Caller::new(object, stop, raised);
        let base_radps = library.fields.as_ref().map_or(0.0, |fields| fields.base_radps);
        OwnParts {
            task: self.task.map(|task| Box::new(PyTask(caller(task))) as _),
            planner: self.planner.map(|planner| {
                Box::new(PyPlanner { of: caller(planner), library: Arc::clone(library), base_radps }) as _
            }),
            rig: self.rig.map(|rig| Box::new(rig::PyRig::new(caller(rig))) as _),
        }
    }
}

/// Places as an array of shape (n, 2), mm.
fn array_mm<'py>(py: Python<'py>, places_m: &[Vec2]) -> PyResult<Bound<'py, PyArray2<f64>>> {
    let rows: Vec<Vec<f64>> = places_m.iter().map(|place_m| vec![mm_from_m(place_m.x), mm_from_m(place_m.y)]).collect();
    if rows.is_empty() { Ok(PyArray2::zeros(py, [0, 2], false)) } else { Ok(PyArray2::from_vec2(py, &rows)?) }
}

/// Places of `count` parts, m, from such an array.
fn places_m(array: &Bound<'_, PyAny>, count: usize) -> PyResult<Vec<Vec2>> {
    let array = array.py().import("numpy")?.call_method1("asarray", (array, "float64"))?;
    let refused = |found: String| PyValueError::new_err(format!("targets: expected shape ({count}, 2), found {found}"));
    let places: PyReadonlyArray2<'_, f64> = array.extract().map_err(|_| refused("another array".into()))?;
    if places.shape() != [count, 2] {
        return Err(refused(format!("{:?}", places.shape())));
    }
    let places = places.as_array();
    let found = places.rows().into_iter().map(|row| Vec2::new(m_from_mm(row[0]), m_from_mm(row[1])));
    let found: Vec<Vec2> = found.collect();
    let is_finite = found.iter().all(|place| place.iter().all(|m| m.is_finite()));
    is_finite.then_some(found).ok_or_else(|| PyValueError::new_err("targets: expected numbers, found NaN or infinity"))
}

/// `task(at_s, places_mm)` returns targets, or `None` once it is done.
struct PyTask(Caller);

impl Task for PyTask {
    fn next(&mut self, now: PlateTime, parts_in_table_m: &[Vec2]) -> Setpoints {
        let targets = self.0.call(|task| {
            let answer = task.call1((now.secs(), array_mm(task.py(), parts_in_table_m)?))?;
            if answer.is_none() { Ok(None) } else { places_m(&answer, parts_in_table_m.len()).map(Some) }
        });
        let targets_m = targets.unwrap_or_else(|_| Some(parts_in_table_m.to_vec()));
        let done = targets_m.is_none();
        let targets_m = targets_m.unwrap_or_else(|| parts_in_table_m.to_vec());
        let phase = if done { "the caller's task is done" } else { "the caller's task" }.to_owned();
        Setpoints { subgoals_m: targets_m.clone(), targets_m, phase, done, ..Setpoints::default() }
    }
}

/// `planner(places_mm, targets_mm)` returns pulses.
struct PyPlanner {
    of: Caller,
    library: Arc<Library>,
    base_radps: f64,
}

/// A pulse, as the Python half of the module passes it on.
#[derive(FromPyObject)]
enum Pulse<'py> {
    /// Entry of the library and distance, mm.
    Rotation(usize, f64),
    /// Coefficients of cos and sin of each harmonic, shape (harmonics, 2, 3), mm/s and rad/s, and time at full height,
    /// s.
    Motion(PyReadonlyArray3<'py, f64>, f64),
}

impl PyPlanner {
    fn pulse(&self, pulse: Pulse<'_>, at_m: &[Vec2]) -> PyResult<PlannedPulse> {
        match pulse {
            Pulse::Rotation(entry, distance_mm) => {
                let rotation = Rotation::carrying(&self.library, entry, m_from_mm(distance_mm), at_m);
                rotation.map(PlannedPulse::Rotation).map_err(PyValueError::new_err)
            }
            Pulse::Motion(coefficients, sustain_s) => {
                let [_, 2, 3] = *coefficients.shape() else {
                    let found = coefficients.shape();
                    return Err(PyValueError::new_err(format!("motion: expected shape (n, 2, 3), found {found:?}")));
                };
                let coefficients = coefficients.as_array();
                let twist = |k: usize, of: usize| {
                    let at = |axis| coefficients[[k, of, axis]];
                    Twist::new(m_from_mm(at(0)), m_from_mm(at(1)), at(2))
                };
                let harmonic = |k| TwistHarmonic { cos: twist(k, 0), sin: twist(k, 1) };
                let harmonics = (0..coefficients.shape()[0]).map(harmonic).collect();
                let wave = TwistWave { base_radps: self.base_radps, harmonics };
                Ok(PlannedPulse::Field(FieldPulse { wave, follows: Follows::Displacement, sustain_s }))
            }
        }
    }
}

impl OwnPlanner for PyPlanner {
    fn plan(&mut self, parts: &[PartState]) -> Result<Vec<PlannedPulse>, String> {
        let at_m: Vec<Vec2> = parts.iter().map(|part| part.position_m).collect();
        let to_m: Vec<Vec2> = parts.iter().map(|part| part.position_m + part.step_m).collect();
        self.of.call(|planner| {
            let (at_mm, to_mm) = (array_mm(planner.py(), &at_m)?, array_mm(planner.py(), &to_m)?);
            let pulses = planner.call1((at_mm, to_mm))?;
            pulses.try_iter()?.map(|pulse| self.pulse(pulse?.extract()?, &at_m)).collect()
        })
    }
}
