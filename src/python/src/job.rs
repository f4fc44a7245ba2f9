//! Jobs, from files and texts.

use std::path::PathBuf;

use pyo3::prelude::*;

use super::refusal::said;
use upm::config::{JobSpec, Origin};
use upm::job::CameraMode;
use upm::run::job_library;

/// A job that was read and checked, with its rig.
#[pyclass(frozen, module = "upm._upm")]
pub struct Job(pub JobSpec);

#[pymethods]
impl Job {
    /// The job in `text`, JSON; files that it names are looked for in `folder`. `name` stands in refusals.
    #[new]
    fn new(py: Python<'_>, text: &str, folder: PathBuf, name: String) -> PyResult<Self> {
        let origin = Origin { file: name, folder: Some(folder) };
        py.detach(|| JobSpec::from_json(text, &origin, None)).map(Self).map_err(|faults| said(faults.into()))
    }

    /// The same job with another seed.
    fn with_seed(&self, seed: u64) -> Self {
        Self(self.0.clone().with_seed(seed))
    }

    /// The same job with frames of pixels, or with the parts' measured places in their stead.
    fn with_pixels(&self, has_pixels: bool) -> Self {
        Self(self.0.clone().with_camera(if has_pixels { CameraMode::Pixels } else { CameraMode::Positions }))
    }

    /// The same job with faults of the rig, as the command line takes them.
    fn with_faults(&self, faults: Vec<String>) -> PyResult<Self> {
        self.0.clone().with_faults(&faults).map(Self).map_err(|faults| said(faults.into()))
    }

    /// The job with all defaults written out, JSON.
    fn effective(&self) -> String {
        self.0.effective().to_string()
    }

    /// Its COR library, JSON.
    fn library(&self) -> PyResult<String> {
        job_library(&self.0).map(|library| library.to_json()).map_err(|faults| said(faults.into()))
    }

    #[getter]
    fn name(&self) -> &str {
        &self.0.name
    }

    #[getter]
    fn seed(&self) -> u64 {
        self.0.seed()
    }
}
