//! A rig of the caller's, which plays samples as a sound card does, and a simulated plate that can be driven so.

use numpy::{PyArray2, PyArrayMethods, PyReadonlyArray2, PyUntypedArrayMethods};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

use super::caller::Caller;
use crate::job::Job;
use crate::refusal::{refusal, said};
use upm::rig::{Rig, RigError};
use upm::run::{RunSetup, library_and_places};
use upm::signal::{AccelTrace, CHANNELS, Drive, Frame, MOTORS};
use upm::sim::SimRig;
use upm::time::PlateTime;

/// A rig whose methods are those of `upm.Rig`.
pub struct PyRig {
    of: Caller,
    settled_at: PlateTime,
    rest_s: f64,
}

impl PyRig {
    pub fn new(of: Caller) -> Self {
        Self { of, settled_at: PlateTime::ZERO, rest_s: 0.0 }
    }

    fn device<T>(&self, call: impl FnOnce(&Bound<'_, PyAny>) -> PyResult<T>) -> Result<T, RigError> {
        self.of.call(call).map_err(RigError::Device)
    }
}

impl Rig for PyRig {
    fn now(&self) -> PlateTime {
        PlateTime::from_secs(self.device(|rig| rig.call_method0("now_s")?.extract()).unwrap_or(0.0))
    }

    fn play(&mut self, drive: &Drive) -> Result<(), RigError> {
        let (driven_s, rest_s) = (drive.envelope.driven_s(), drive.envelope.rest_s);
        self.device(|rig| {
            let samples = drive.samples(rig.getattr("sample_hz")?.extract()?);
            let rows: Vec<Vec<i16>> = samples.iter().map(|sample| sample.to_vec()).collect();
            rig.call_method1("play", (PyArray2::from_vec2(rig.py(), &rows)?, driven_s, rest_s)).map(drop)
        })?;
        (self.settled_at, self.rest_s) = (self.now() + drive.envelope.total_s(), rest_s);
        Ok(())
    }

    fn settled_at(&self) -> PlateTime {
        self.settled_at
    }

    fn capture(&mut self, frame: &mut Frame) -> Result<(), RigError> {
        self.device(|rig| {
            let (image, index, exposed_at_s): (PyReadonlyArray2<'_, u8>, u64, f64) =
                rig.call_method0("capture")?.extract()?;
            let [height, width] = *image.shape() else {
                return Err(PyValueError::new_err("capture: expected a picture of shape (height, width)"));
            };
            (frame.width, frame.height, frame.index) = (width, height, index);
            frame.exposed_at = PlateTime::from_secs(exposed_at_s);
            frame.pixels.clear();
            frame.pixels.extend(image.as_array());
            Ok(())
        })
    }

    fn trace(&self) -> AccelTrace {
        let read = self.device(|rig| {
            let counts: PyReadonlyArray2<'_, i16> = rig.call_method0("trace")?.extract()?;
            if counts.shape()[1] != CHANNELS {
                return Err(PyValueError::new_err(format!("trace: expected shape (n, 4), found {:?}", counts.shape())));
            }
            let counts = counts.as_array();
            Ok(AccelTrace {
                sample_hz: rig.getattr("accelerometer_hz")?.extract()?,
                first_sample_s: 0.0,
                mps2_per_count: rig.getattr("accelerometer_mps2_per_count")?.extract()?,
                count_limit: rig.getattr("accelerometer_count_limit")?.extract()?,
                counts: std::array::from_fn(|channel| counts.column(channel).to_vec()),
            })
        });
        read.unwrap_or_default()
    }

    fn stop(&mut self) {
        let now = self.now();
        self.device(|rig| rig.call_method0("stop").map(drop)).ok();
        self.settled_at = self.settled_at.min(now + self.rest_s);
    }
}

/// The simulated plate of a job, driven through arrays.
#[pyclass(module = "upm._upm")]
pub struct SimulatedPlate {
    rig: SimRig,
    frame: Frame,
}

fn rig_refusal(error: &RigError) -> PyErr {
    refusal(vec![error.to_string()])
}

#[pymethods]
impl SimulatedPlate {
    /// The plate of `job` with its parts at their start.
    #[new]
    fn new(py: Python<'_>, job: &Job) -> PyResult<Self> {
        let made = py.detach(|| {
            let setup = RunSetup::new(&job.0, &library_and_places(&job.0)?)?;
            let [width, height] = setup.model.frame_size_px;
            Ok(Self { rig: setup.rig, frame: Frame::new(width, height) })
        });
        made.map_err(said)
    }

    #[getter]
    fn sample_hz(&self) -> f64 {
        self.rig.sample_hz()
    }

    #[getter]
    fn accelerometer_hz(&self) -> f64 {
        self.rig.trace().sample_hz
    }

    #[getter]
    fn accelerometer_mps2_per_count(&self) -> f64 {
        self.rig.trace().mps2_per_count
    }

    #[getter]
    fn accelerometer_count_limit(&self) -> i16 {
        self.rig.trace().count_limit
    }

    fn now_s(&self) -> f64 {
        self.rig.now().secs()
    }

    fn play(&mut self, samples: PyReadonlyArray2<'_, i16>, driven_s: f64, rest_s: f64) -> PyResult<()> {
        if samples.shape()[1] != MOTORS {
            return Err(PyValueError::new_err(format!("samples: expected shape (n, 4), found {:?}", samples.shape())));
        }
        let samples = samples.as_array();
        let rows = samples.rows().into_iter().map(|row| std::array::from_fn(|motor| row[motor]));
        self.rig.play_samples(rows.collect(), driven_s, rest_s).map_err(|error| rig_refusal(&error))
    }

    fn capture<'py>(&mut self, py: Python<'py>) -> PyResult<(Bound<'py, PyArray2<u8>>, u64, f64)> {
        py.detach(|| self.rig.capture(&mut self.frame)).map_err(|error| rig_refusal(&error))?;
        let Frame { width, height, pixels, index, exposed_at, .. } = &self.frame;
        let image = numpy::PyArray1::from_slice(py, pixels).reshape([*height, *width])?;
        Ok((image, *index, exposed_at.secs()))
    }

    fn trace<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<i16>>> {
        let trace = self.rig.trace();
        let rows = (0..trace.len()).flat_map(|i| trace.counts.each_ref().map(|channel| channel[i]));
        numpy::PyArray1::from_iter(py, rows).reshape([trace.len(), CHANNELS])
    }

    fn stop(&mut self) {
        self.rig.stop();
    }
}
