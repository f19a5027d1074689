//! A participant of a study, and the evaluation of this person's recordings.

use crate::batch::{Table, table};
use crate::exception;
use crate::options::Options;
use crate::recordings::Recording;
use crate::threads;
use arrow_pyarrow::PyArrowType;
use fit::agreement;
use fit::trials;
use parameters::Participant;
use plantar::Region;
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use std::io;
use std::path::{Path, PathBuf};
use study::fits;
use study::table::{Row, STEPS_FILE, Value};

/// A participant and the options for this person.
#[pyclass(frozen, module = "plantar._core")]
pub struct Person(study::Person);

/// The fitted values of one recording.
#[pyclass(frozen, module = "plantar._core")]
pub struct Trial {
    trial: trials::Trial,
    /// The defects of the fits, with the names of recording and region.
    #[pyo3(get)]
    defects: Vec<String>,
}

#[pymethods]
impl Person {
    /// A participant without a folder and therefore without `participant.toml`, with the zero file of the options.
    #[new]
    fn new(py: Python, options: Options) -> PyResult<Self> {
        let settings = Participant { zero: options.zero.clone(), ..Participant::default() };
        let (search, contact, stance) = (options.search()?, options.contact(None)?, options.stance()?);
        py.detach(|| study::Person::new(settings, &search, contact, stance, &|path| std::fs::read(path)))
            .map(Self)
            .map_err(exception)
    }

    /// The participant in a folder, with the settings in its `participant.toml`, if there is one. `read` returns the content of a
    /// file, and must raise a `FileNotFoundError` if there is none.
    #[staticmethod]
    fn open(folder: PathBuf, options: Options, read: Bound<'_, PyAny>) -> PyResult<Self> {
        let read = |path: &Path| -> io::Result<Vec<u8>> {
            let content = read.call1((path.to_string_lossy(),)).and_then(|content| content.extract::<Vec<u8>>());
            content.map_err(io::Error::from)
        };
        let (search, contact, stance) = (options.search()?, options.contact(None)?, options.stance()?);
        study::Person::open(&folder, &search, contact, stance, &read).map(Self).map_err(exception)
    }

    /// A note on each value of the tissue measurements that is out of range and therefore not used.
    #[getter]
    fn notes(&self) -> Vec<String> {
        self.0.notes.clone()
    }

    /// Everything that determines the rows of this person, except the recordings and the version of the program, as text.
    #[getter]
    fn description(&self) -> String {
        self.0.description()
    }

    /// Fits each step of a recording separately: one row for each region of each step.
    fn rows(&self, py: Python, recording: &Recording) -> PyResult<Table> {
        threads::begin()?;
        py.detach(|| {
            let rows = fits::rows(&self.0, &*recording.inner, &recording.path).map_err(exception)?;
            Ok(PyArrowType(table(&fits::columns(&self.0), &rows)?))
        })
    }

    /// Fits one set of parameters for each region to all steps of a recording together.
    fn trial(&self, py: Python, recording: &Recording) -> PyResult<Trial> {
        threads::begin()?;
        let (trial, defects) =
            py.detach(|| fits::trial(&self.0, &*recording.inner, &recording.path)).map_err(exception)?;
        let defects = defects.iter().map(|defect| format!("{}, {defect}", trial.name)).collect();
        Ok(Trial { trial, defects })
    }
}

/// The path of a participant's file, relative to the folder of the study's table.
#[pyfunction]
pub fn steps_path(participant: &str) -> String {
    format!("{}/{STEPS_FILE}", study::table::partition(participant))
}

/// The repeatability of the trials of people: one row for each foot, variable and region that can be compared. `least_people` is
/// 1 for the trials of one person, and otherwise 2. Also returns the reasons why people are left out.
#[pyfunction]
pub fn repeatability(
    py: Python,
    people: Vec<(String, Vec<PyRef<Trial>>)>,
    least_people: usize,
) -> PyResult<(Table, Vec<String>)> {
    let people: Vec<(String, Vec<trials::Trial>)> =
        people.into_iter().map(|(name, all)| (name, all.iter().map(|trial| trial.trial.clone()).collect())).collect();
    let people: Vec<(&str, &[trials::Trial])> = people.iter().map(|(name, all)| (name.as_str(), &all[..])).collect();
    let (feet, _) = py.detach(|| agreement::repeatability(&people, least_people));
    let left_out = agreement::left_out(&people, least_people);
    let mut rows: Vec<Row> = Vec::new();
    for foot in &feet {
        for row in &foot.rows {
            for (region, agreement) in Region::ALL.into_iter().zip(&row.regions) {
                let Some(agreement) = agreement else { continue };
                let count = |count: usize| Value::Integer(i32::try_from(count).ok());
                rows.push(vec![
                    ("side", foot.side.name().into()),
                    ("variable", Value::Text(Some(row.variable.name().into_owned()))),
                    ("region", region.name().into()),
                    ("people", count(agreement.people)),
                    ("trials", count(foot.trials)),
                    ("mean", agreement.mean.into()),
                    ("icc_2_1", Value::Real(agreement.icc)),
                    ("sem", agreement.sem.into()),
                    ("mdc_95", agreement.mdc.into()),
                ]);
            }
        }
    }
    match rows.first() {
        Some(first) => Ok((PyArrowType(table(first, &rows)?), left_out)),
        None => {
            let people = match least_people {
                1 => String::new(),
                least => format!("{least} or more people with "),
            };
            Err(PyValueError::new_err(format!(
                "{people}two or more usable recordings of the same foot are needed: record another trial"
            )))
        }
    }
}
