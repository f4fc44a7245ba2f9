//! Objects of the caller's, and their exceptions.

use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex};

use pyo3::prelude::*;

/// The first exception of the caller's code.
pub type Raised = Arc<Mutex<Option<PyErr>>>;

/// An object of the caller's.
pub struct Caller {
    object: Py<PyAny>,
    stop: Arc<AtomicBool>,
    raised: Raised,
}

impl Caller {
    /// The object for a run that `stop` ends.
    pub fn new(object: Py<PyAny>, stop: &Arc<AtomicBool>, raised: &Raised) -> Self {
        Self { object, stop: Arc::clone(stop), raised: Arc::clone(raised) }
    }

    /// The result of `call`; an exception ends the run.
    pub fn call<T>(&self, call: impl FnOnce(&Bound<'_, PyAny>) -> PyResult<T>) -> Result<T, String> {
        Python::attach(|py| call(self.object.bind(py)).map_err(|error| self.keep(py, error)))
    }

    fn keep(&self, py: Python<'_>, error: PyErr) -> String {
        let text = error.value(py).to_string();
        self.stop.store(true, Ordering::Relaxed);
        if let Ok(mut raised) = self.raised.lock() {
            raised.get_or_insert(error);
        }
        text
    }
}
