//! Evaluates a recording with the insole's own code, as `plantar replay` does.

use crate::batch::{Table, numbers, table};
use crate::exception;
use crate::options::{OPTION_NAMES, Options};
use crate::recordings::Recording;
use anyhow::Context;
use arrow_pyarrow::PyArrowType;
use fit::contacts::ContactCollector;
use parameters::{Identified, InsoleSize, Parameters};
use plantar::faults::Faults;
use plantar::insole::Insole;
use plantar::pipeline::tissue::Tissue;
use plantar::protocol::{Bout, Step};
use plantar::{Real, Region};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use recording::{MAX_CELLS, Scan, VirtualInsole};
use std::path::PathBuf;
use study::records::{bout_columns, bout_row, completed_step, step_columns, step_row};
use study::{frames, virtual_insole, walk};

/// The result of a replay.
struct Replayed {
    steps: Vec<Step>,
    bouts: Vec<Bout>,
    /// Notes for the user: those of [`walk::notes`], and on sensor faults.
    notes: Vec<String>,
    /// The live values: one vector for each of the columns [`frames::column_names`]. The vectors are empty if the values were not
    /// requested. NaN stands for a value that does not exist: with 8 bytes for each value, a long recording fits into memory.
    frames: Vec<Vec<f64>>,
}

/// Computes the steps of a recording as an insole would and, if `with_frames` is true, the live values of every frame. `params`
/// is a parameter file; without one, typical parameters are used. `precision` is `f32` or `f64`. Returns the tables of the steps
/// and of the load bouts, the table of the frames if it was requested, and notes for the user.
#[pyfunction]
pub fn replay(
    py: Python,
    recording: &Recording,
    options: Options,
    params: Option<PathBuf>,
    precision: &str,
    with_frames: bool,
) -> PyResult<(Table, Table, Option<Table>, Vec<String>)> {
    options.check_replay()?;
    let parameters = match &params {
        Some(path) => Parameters::read(path).map_err(exception)?,
        None => Parameters::typical(options.size()?),
    };
    let (contact, stance) = (options.contact(Some(&parameters))?, options.stance()?);
    let mut notes: Vec<String> = parameters.typical_note().into_iter().collect();
    if params.is_none() {
        notes.extend(options.size()?.extrapolation_note());
    }
    if let Some(identified) = parameters.identified.as_ref().filter(|identified| identified.contact != contact) {
        notes.push(format!(
            "the parameters were identified with another contact rule (contact_on_kpa {}, contact_off_kpa {}, \
             contact_full_kpa {}): model force and deformation are not valid",
            identified.contact.on_kpa, identified.contact.off_kpa, identified.contact.full_kpa
        ));
    }
    let side = recording.inner.side;
    if let Some(identified) = parameters.identified.as_ref().filter(|identified| identified.is_of_other_foot(side)) {
        notes.push(format!(
            "the parameters were identified from the {} foot, but the recording is of the {} foot: model force and \
             deformation may not be valid",
            identified.side,
            side.name()
        ));
    }
    notes.extend(parameters.identified.as_ref().and_then(Identified::invalid_for_steps));
    let run = match precision {
        "f32" => run::<f32>,
        "f64" => run::<f64>,
        other => return Err(PyValueError::new_err(format!("precision = \"{other}\": expected \"f32\" or \"f64\""))),
    };
    let (inner, path) = (&*recording.inner, recording.path.display().to_string());
    py.detach(|| {
        let replayed = || {
            let mut insole = virtual_insole(&inner.into(), contact, stance)?;
            options.subtract_zero(&mut insole)?;
            run(inner, &insole, &parameters.tissue(), with_frames)
        };
        let Replayed { steps, bouts, notes: of_recording, frames } =
            replayed().with_context(|| format!("{path}: the recording cannot be evaluated")).map_err(exception)?;
        // Parameters of a file state no size.
        let size = if params.is_none() { options.size()? } else { InsoleSize::default() };
        let of_parameters = parameters.inapplicable_note(size, &steps);
        notes.extend(of_recording.iter().chain(&of_parameters).map(|note| format!("{path}: {note}")));
        let regions = || 0..Region::ALL.len();
        let rows: Vec<_> = steps.iter().flat_map(|step| regions().map(|i| step_row(step, i))).collect();
        let steps = PyArrowType(table(&step_columns(), &rows)?);
        let rows: Vec<_> = bouts.iter().flat_map(|bout| regions().map(|i| bout_row(bout, i))).collect();
        let bouts = PyArrowType(table(&bout_columns(), &rows)?);
        let frames = if with_frames { Some(PyArrowType(numbers(&frames::column_names(), frames)?)) } else { None };
        Ok((steps, bouts, frames, notes))
    })
}

/// Evaluates a recording with a virtual insole that computes with `R`. The live values are computed only if `with_frames` is
/// true.
fn run<R: Real>(
    recording: &recording::Recording,
    virtual_insole: &VirtualInsole,
    tissue: &Tissue,
    with_frames: bool,
) -> anyhow::Result<Replayed> {
    let mut insole = Box::new(Insole::<R, MAX_CELLS>::new());
    insole.set_up(virtual_insole.setup, virtual_insole.cells.iter().copied())?;
    insole.set_tissue(tissue)?;
    let (mut steps, mut columns, mut row) = (Vec::new(), vec![Vec::new(); frames::column_names().len()], Vec::new());
    let (mut bouts, mut others) = (Vec::new(), ContactCollector::new(&virtual_insole.setup));
    let mut scans = virtual_insole.scans(recording);
    let mut add_step = |toe_off: bool, insole: &mut Insole<R, MAX_CELLS>| {
        steps.extend(completed_step(toe_off, insole));
    };
    // The repetitions of the last frame, which have no time, are not evaluated: their load was not recorded.
    while let Some(Scan { index, t_s: Some(t_s), codes }) = scans.next_scan()? {
        let toe_off = insole.frame(index as u32, codes);
        others.frame(t_s, toe_off, &insole);
        add_step(toe_off, &mut insole);
        // As on the insole, steps and load bouts are numbered in one sequence. Taking a bout advances the number of the next
        // step.
        bouts.extend(insole.take_bout().as_ref().map(Bout::new));
        if with_frames {
            row.clear();
            frames::push_row(&mut row, t_s, &insole, virtual_insole.setup.contact);
            columns.iter_mut().zip(&row).for_each(|(column, value)| column.push(value.unwrap_or(f64::NAN)));
        }
    }
    let toe_off = insole.end_stance();
    add_step(toe_off, &mut insole);
    bouts.extend(std::iter::from_fn(|| insole.end_bout()).map(|bout| Bout::new(&bout)));
    let stance = &virtual_insole.setup.stance;
    let mut notes = walk::notes(&others.end(&insole), &steps, stance, &OPTION_NAMES);
    notes.extend(fault_note(insole.faults()));
    Ok(Replayed { steps, bouts, notes, frames: columns })
}

/// The faults of the sensor and the number of masked cells of each region; `None` without any.
fn fault_note(faults: &Faults) -> Option<String> {
    let listed = faults.list.iter().map(|fault| format!("{} {}", fault.place, fault.kind.name()));
    let masked = Region::ALL.iter().zip(faults.masked_cells).filter(|(_, cells)| *cells > 0);
    let masked = masked.map(|(region, cells)| format!("{} {cells}", region.name()));
    let lists: [(_, Vec<_>); 2] = [("sensor faults", listed.collect()), ("masked cells", masked.collect())];
    let lists = lists.iter().filter(|(_, list)| !list.is_empty());
    let texts: Vec<_> = lists.map(|(name, list)| format!("{name}: {}", list.join(", "))).collect();
    (!texts.is_empty()).then(|| texts.join("; "))
}
