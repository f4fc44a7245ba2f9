//! Work beside the interpreter: Python's other threads go on, and Ctrl-C ends it in good order.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{self, RecvTimeoutError};
use std::thread;
use std::time::Duration;

use pyo3::exceptions::PyRuntimeError;
use pyo3::prelude::*;

/// Time after which Ctrl-C is noticed at the latest: soon for a person.
const CHECKED_EVERY: Duration = Duration::from_millis(50);

/// Does `work` on another thread. A signal's exception sets the flag that `work` gets, and is raised once `work` has
/// ended.
pub fn until_done<T: Send>(py: Python<'_>, work: impl FnOnce(&Arc<AtomicBool>) -> T + Send) -> PyResult<T> {
    let stop = Arc::new(AtomicBool::new(false));
    py.detach(|| {
        thread::scope(|scope| {
            let (done, waiting) = mpsc::sync_channel(1);
            let flag = &stop;
            scope.spawn(move || done.send(work(flag)));
            let mut raised = None;
            loop {
                match waiting.recv_timeout(CHECKED_EVERY) {
                    Ok(result) => return raised.map_or(Ok(result), Err),
                    Err(RecvTimeoutError::Disconnected) => {
                        return Err(
                            raised.unwrap_or_else(|| PyRuntimeError::new_err("the work ended without a result"))
                        );
                    }
                    Err(RecvTimeoutError::Timeout) if raised.is_none() => {
                        raised = Python::attach(|py| py.check_signals()).err();
                        stop.store(raised.is_some(), Ordering::Relaxed);
                    }
                    Err(RecvTimeoutError::Timeout) => {}
                }
            }
        })
    })
}
