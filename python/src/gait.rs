//! The measures of gait, as in `plantar gait`.

use crate::batch::{Table, table};
use crate::exception;
use crate::options::{OPTION_NAMES, Options};
use crate::recordings::Recording;
use anyhow::{Context, bail};
use arrow_pyarrow::PyArrowType;
use client::gait::Length;
use plantar::pipeline::contact::ContactRule;
use pyo3::prelude::*;
use study::virtual_insole;
use study::walk::{self, RecordedWalk, check_pair, stride_columns, stride_rows};

/// The measures of a walk.
#[pyclass(frozen, module = "plantar._core")]
pub struct Gait(client::gait::Gait);

/// Computes the measures from one recording, or from those of both feet. Also returns notes for the user.
#[pyfunction]
pub fn gait(py: Python, recordings: Vec<PyRef<Recording>>, options: Options) -> PyResult<(Gait, Vec<String>)> {
    options.check_gait()?;
    let recordings: Vec<_> = recordings.iter().map(|each| (each.inner.clone(), each.path.clone())).collect();
    let stance = options.stance()?;
    let computed = move || -> anyhow::Result<(Gait, Vec<String>)> {
        let mut notes = Vec::new();
        let mut walks = Vec::new();
        for (i, (recording, path)) in recordings.iter().enumerate() {
            let name = path.display();
            if recordings[..i].iter().any(|(before, _)| before.side == recording.side) {
                bail!("{name}: a second recording of the {} foot: give one for each foot", recording.side.name());
            }
            let found = || {
                let mut insole = virtual_insole(&(&**recording).into(), ContactRule::COUNTED, stance)?;
                options.subtract_zero(&mut insole)?;
                RecordedWalk::find(&insole, (&**recording).into(), &mut |_| ())
            };
            let walk = found().with_context(|| format!("{name}: the recording cannot be evaluated"))?;
            notes.extend(walk.notes(&OPTION_NAMES).iter().map(|note| format!("{name}: {note}")));
            walks.push(walk);
        }
        if walks.iter().all(|walk| walk.steps.is_empty()) {
            bail!("no steps: {}", notes.join("; "));
        }
        let mut has_common_clock = true;
        if let [(first, _), (second, _)] = &recordings[..] {
            notes.extend(check_pair([first, second])?);
            has_common_clock = !first.layout.is_of_insole() && !second.layout.is_of_insole();
            if !has_common_clock {
                notes.push(
                    "the feet are not compared: the times of recordings of the cells of insoles are those of each insole's own \
                     clock; `plantar gait` compares the feet from the folders of `plantar record`"
                        .into(),
                );
            }
        }
        Ok((Gait(walk::gait(&walks, has_common_clock)), notes))
    };
    py.detach(computed).map_err(exception)
}

#[pymethods]
impl Gait {
    /// The measures as JSON, without the speed.
    fn json(&self) -> String {
        self.0.to_json(None).to_string()
    }

    /// One row for each stride in use.
    fn strides(&self) -> PyResult<Table> {
        Ok(PyArrowType(table(&stride_columns(), &stride_rows(&self.0))?))
    }

    /// The walking speed, m/s, from the mean length of a stride, m.
    fn speed_of_strides_m_s(&self, stride_length_m: f64) -> Option<f64> {
        self.0.speed_m_s(Length::Stride(stride_length_m))
    }

    /// The walking speed, m/s, from the distance from the first to the last heel strike, m.
    fn speed_of_walk_m_s(&self, distance_m: f64) -> Option<f64> {
        self.0.speed_m_s(Length::Walk(distance_m))
    }
}
