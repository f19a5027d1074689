//! The identification of one person's parameters, as in `plantar fit`.

use crate::batch::{Table, table};
use crate::exception;
use crate::options::Options;
use crate::recordings::Recording;
use crate::threads;
use anyhow::Context;
use arrow_pyarrow::PyArrowType;
use fit::interval::RESAMPLES;
use fit::quality::Evaluated;
use fit::sensitivity::predicted_nrmse;
use fit::steps::isolate;
use fit::{Method, Study, results};
use parameters::InsoleSize;
use plantar::Region;
use plantar::pipeline::contact::ContactRule;
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use recording::VirtualInsole;
use std::path::PathBuf;
use std::sync::Arc;
use study::table::{Row, Value};
use study::virtual_insole;

/// The result of an identification.
#[pyclass(frozen, module = "plantar._core")]
pub struct Fitted {
    study: Study,
    size: InsoleSize,
}

/// Identifies a person's parameters from recordings. `participant` is the name of the person; the default is that of the first
/// recording. Also returns notes for the user.
#[pyfunction]
pub fn identify(
    py: Python,
    recordings: Vec<PyRef<Recording>>,
    participant: Option<String>,
    options: Options,
) -> PyResult<(Fitted, Vec<String>)> {
    let recordings: Vec<(Arc<recording::Recording>, PathBuf)> =
        recordings.iter().map(|recording| (recording.inner.clone(), recording.path.clone())).collect();
    let (search, contact, size) = (options.search()?, options.contact(None)?, options.size()?);
    let stance = options.stance()?;
    let identified = move || -> anyhow::Result<(Fitted, Vec<String>)> {
        let participant = participant.unwrap_or_else(|| name_of_person(&recordings));
        let (tissue, notes) = search.tissue(&|path| std::fs::read(path))?;
        let mut study = Study::new(participant, contact, search.options(&tissue, RESAMPLES)?);
        // The error with counted cells requires a second search, which would take too long with the method of the paper.
        let is_counted = study.options.method == Method::Projection;
        let counted = ContactRule { full_kpa: 0.0, ..contact };
        let mut counted_steps = Vec::new();
        for (index, (recording, path)) in recordings.iter().enumerate() {
            let name = path.display().to_string();
            let problem = || format!("{name}: the recording cannot be evaluated");
            let insole = |rule: ContactRule| -> anyhow::Result<VirtualInsole> {
                let mut insole = virtual_insole(&(&**recording).into(), rule, stance).with_context(problem)?;
                options.subtract_zero(&mut insole)?;
                Ok(insole)
            };
            study.add(name.clone(), &**recording, &insole(contact)?, &mut |_| ()).with_context(problem)?;
            if is_counted {
                let insole = insole(counted)?;
                let scans = insole.scans(&**recording);
                counted_steps.extend(isolate(&insole, scans, index, &mut |_| ()).with_context(problem)?.0);
            }
        }
        study.fit(&|_| ());
        if is_counted {
            study.counted_nrmse = predicted_nrmse(&counted_steps, &study.options);
        }
        for (fit, measurements) in study.fits.iter_mut().zip(tissue.0) {
            if let Ok(fit) = fit {
                fit.defects.extend(measurements.rejected.iter().map(ToString::to_string));
            }
        }
        Ok((Fitted { study, size }, notes))
    };
    threads::begin()?;
    py.detach(identified).map_err(exception)
}

/// The name of a person, from the first recording, as the command line chooses it.
fn name_of_person(recordings: &[(Arc<recording::Recording>, PathBuf)]) -> String {
    let stem = recordings.first().and_then(|(_, path)| path.file_stem()).unwrap_or_default().to_string_lossy();
    let has_one_side = recordings.iter().all(|(recording, _)| recording.side == recordings[0].0.side);
    if has_one_side { stem.into_owned() } else { recording::without_side(&stem).into() }
}

#[pymethods]
impl Fitted {
    /// All results, as JSON.
    fn json(&self) -> String {
        results::to_json(&self.study).to_string()
    }

    /// The parameter file. An error if no region was fitted: the file would contain typical values as those of the person.
    fn toml(&self) -> PyResult<String> {
        if self.study.fits.iter().all(Result::is_err) {
            return Err(PyValueError::new_err(
                "no region could be fitted, so there are no parameters; `results` contains the reasons",
            ));
        }
        Ok(results::to_toml(&self.study, self.size))
    }

    /// The report as an HTML file.
    fn html(&self, py: Python) -> String {
        py.detach(|| report::html(&self.study))
    }

    /// The measured force and the model force of each fitted region in each step. The time starts with the contact of the region.
    fn curves(&self, py: Python) -> PyResult<Table> {
        py.detach(|| {
            let mut rows: Vec<Row> = Vec::new();
            for (region, fit) in Region::ALL.into_iter().zip(&self.study.fits) {
                let Ok(fit) = fit else { continue };
                for &index in &fit.steps {
                    let step = &self.study.steps[index];
                    let curves = &step.regions[region as usize];
                    let Some(result) = Evaluated::new(curves, self.study.options.filter, &fit.law) else { continue };
                    let samples = result.area_mm2.iter().zip(&result.measured_n).zip(&result.model_n).enumerate();
                    rows.extend(samples.map(|(i, ((area_mm2, measured_n), model_n))| {
                        row(step, region, i as f64 * result.sample_s, *area_mm2, *measured_n, *model_n)
                    }));
                }
            }
            let columns = match self.study.steps.first() {
                Some(step) => row(step, Region::Heel, 0.0, 0.0, 0.0, 0.0),
                None => return Err(PyValueError::new_err("there is no complete step: record a walk of several steps")),
            };
            Ok(PyArrowType(table(&columns, &rows)?))
        })
    }
}

/// A row with one sample of the curves of a region. `t_s` is the time since the start of the region's contact.
fn row(step: &fit::Step, region: Region, t_s: f64, area_mm2: f64, measured_n: f64, model_n: f64) -> Row {
    // A recording has fewer steps than an i32 can count.
    let integer = |count: usize| Value::Integer(i32::try_from(count).ok());
    vec![
        ("recording", integer(step.recording)),
        ("step", integer(step.number as usize)),
        ("region", region.name().into()),
        ("t_s", t_s.into()),
        ("area_mm2", area_mm2.into()),
        ("measured_force_n", measured_n.into()),
        ("model_force_n", model_n.into()),
    ]
}
