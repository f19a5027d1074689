//! The threads that compute. A process that is forked from one with such threads has none of them, and would wait for them
//! without end.

use pyo3::exceptions::PyRuntimeError;
use pyo3::{PyResult, pyfunction};
use std::sync::atomic::{AtomicBool, Ordering};

/// True once a function has used the threads, in this process or in one from which it was forked.
static ARE_USED: AtomicBool = AtomicBool::new(false);
/// True if this process was forked after that.
static ARE_LOST: AtomicBool = AtomicBool::new(false);

/// To be called by each function that computes on several threads, before it does so. An error if the threads are lost.
pub fn begin() -> PyResult<()> {
    if ARE_LOST.load(Ordering::Relaxed) {
        return Err(PyRuntimeError::new_err(
            "plantar was used before this process was forked, so its threads are missing here: start processes with the method \
             \"spawn\" or \"forkserver\", as with multiprocessing.get_context(\"spawn\")",
        ));
    }
    ARE_USED.store(true, Ordering::Relaxed);
    Ok(())
}

/// To be called in a process that was forked.
#[pyfunction]
pub fn after_fork() {
    ARE_LOST.store(ARE_USED.load(Ordering::Relaxed), Ordering::Relaxed);
}
