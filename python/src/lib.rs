//! The compiled part of the Python package `plantar`. The classes and functions of this module are wrapped by the modules in
//! `python/package`, which have the documentation for users. Calls that read recordings, fit, replay or wait for an insole
//! release the global interpreter lock, so that other Python threads continue.

mod batch;
mod fitting;
mod gait;
mod insole;
mod options;
mod person;
mod recordings;
mod replay;
mod threads;

use pyo3::PyErr;
use pyo3::exceptions::PyValueError;
use std::io;

#[pyo3::pymodule]
mod _core {
    #[pymodule_export]
    use super::fitting::{Fitted, identify};
    #[pymodule_export]
    use super::gait::{Gait, gait};
    #[pymodule_export]
    use super::insole::Insole;
    #[pymodule_export]
    use super::person::{Person, Trial, repeatability, steps_path};
    #[pymodule_export]
    use super::recordings::{Recording, note_unless_same_sensor};
    #[pymodule_export]
    use super::replay::replay;
    #[pymodule_export]
    use super::threads::after_fork;

    #[pymodule_export]
    #[allow(non_upper_case_globals, reason = "the name of the constant in Python")]
    const version: &str = env!("PLANTAR_VERSION");
}

/// The Python exception of an error: an `OSError` of the right kind if a file could not be read, otherwise a `ValueError`.
fn exception(error: impl Into<anyhow::Error>) -> PyErr {
    let error: anyhow::Error = error.into();
    let message = format!("{error:#}");
    let kind = error.chain().find_map(|cause| match cause.downcast_ref() {
        Some(recording::Error::Io { reason, .. }) => Some(reason.kind()),
        _ => match cause.downcast_ref() {
            Some(parameters::Error::Io(_, reason)) => Some(reason.kind()),
            _ => cause.downcast_ref::<io::Error>().map(io::Error::kind),
        },
    });
    match kind {
        Some(kind) => io::Error::new(kind, message).into(),
        None => PyValueError::new_err(message),
    }
}
